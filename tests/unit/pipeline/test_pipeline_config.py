"""Merging of base ← profile ← --set, and the wording of its errors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import pytest
from pydantic import AfterValidator, BaseModel, Field

from hqpipe.errors import ConfigError, UsageError
from hqpipe.pipeline.config import Configuration, StageParams
from hqpipe.pipeline.stage import Input, Stage, StageTable


class Inner(BaseModel, frozen=True, extra="forbid"):
    rate: float = 1.0
    size: int = 2


class Params(StageParams):
    window_s: float = Field(0.1, gt=0)
    scope: str = "joint"
    inner: Inner = Inner()
    free: dict = {}


TABLE = StageTable(
    [
        Stage("collect", "logs", __name__, "Collect."),
        Stage("fit-it", "fit", __name__, "Fit.", inputs=(Input("logs", "logs", "--logs"),)),
    ],
    template=Path("unused"),
)

TEXT = """\
robot: toy
seed: 1
stages:
  fit_it:
    window_s: 0.2
    inner: {rate: 3, size: 5}
profiles:
  default: {}
  ci:
    fit_it:
      inner: {size: 1}
"""


@pytest.fixture
def resolve(tmp_path):
    def resolve(text: str = TEXT, **options):
        path = tmp_path / "pipeline.yaml"
        path.write_text(text, encoding="utf-8")
        return Configuration(path, TABLE).resolve(TABLE.values(), **options)

    return resolve


def test_layers_merge_field_by_field(resolve):
    params = resolve(profile="ci", overrides=["fit_it.inner.rate=1e-3", "fit-it.scope=all"]).stages["fit-it"].params
    assert params == Params(window_s=0.2, scope="all", inner=Inner(rate=0.001, size=1))


def test_empty_sections_mean_the_defaults(resolve):
    text = "robot: toy\nstages:\n  collect:\n  fit_it: {}\nprofiles:\n  default:\n"
    settings = resolve(text)
    assert settings.stages["collect"].params == Params()
    assert settings.profile == "default" and settings.workers >= 1


def test_seed_of_a_section_wins_over_the_global_one(resolve):
    settings = resolve(TEXT.replace("window_s: 0.2", "seed: 7"), seed=3)
    assert (settings.stages["collect"].seed, settings.stages["fit-it"].seed) == (3, 7)
    assert resolve(overrides=["collect.seed=4"]).stages["collect"].seed == 4


def test_parameters_are_frozen(resolve):
    with pytest.raises(ValueError, match="frozen"):
        resolve().stages["fit-it"].params.window_s = 1.0


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("robot: toy", "robto: toy", ["pipeline.yaml:1", "unknown field 'robto'", "did you mean 'robot'"]),
        ("robot: toy\n", "", ["field 'robot' is missing"]),
        ("seed: 1", "seed: -1", ["pipeline.yaml:2", "seed", "greater than or equal to 0", "got -1"]),
        ("seed: 1", "workers: none", ["pipeline.yaml:2", "expected 'auto' or a number", "got 'none'"]),
        ("seed: 1", "workers: 0", ["expected 'auto' or a number", "got 0"]),
        (
            "  fit_it:\n    w",
            "  fitit:\n    w",
            ["pipeline.yaml:4", "unknown stage 'fitit'", "did you mean 'fit_it'"],
        ),
        ("    fit_it:\n", "    fit:\n", ["pipeline.yaml:10", "profiles.ci", "unknown stage 'fit'"]),
        (
            "window_s: 0.2",
            "windw_s: 0.2",
            [":5: stages.fit_it.windw_s", "did you mean 'window_s'"],
        ),
        (
            "window_s: 0.2",
            "window_s: 0",
            [":5: stages.fit_it.window_s: expected greater than 0, got 0"],
        ),
        ("window_s: 0.2", "window_s: fast", ["pipeline.yaml:5", "expected a valid number", "got 'fast'"]),
        ("window_s: 0.2", "window_s: .nan", ["pipeline.yaml:5", "window_s"]),
        ("rate: 3", "rte: 3", ["pipeline.yaml:6", "stages.fit_it.inner.rte", "did you mean 'rate'"]),
        (
            "window_s: 0.2",
            "window_s: 1\n    window_s: 2",
            ["window_s' stands twice (lines 5 and 6)"],
        ),
        ("window_s: 0.2", "seed: x", ["pipeline.yaml:5", "whole number", "got 'x'"]),
        (
            "  fit_it:\n    w",
            "  fit_it: 3\n  collect:\n    w",
            [":4", "a mapping", "got 3"],
        ),
        ("seed: 1", "seed: [1", ["pipeline.yaml", "not valid YAML"]),
        ("seed: 1", "seed: !!python/object/apply:os.getcwd []", ["not valid YAML"]),
    ],
)
def test_errors_name_line_field_and_mend(resolve, old, new, parts):
    assert old in TEXT
    with pytest.raises(ConfigError) as caught:
        resolve(TEXT.replace(old, new))
    for part in parts:
        assert part in str(caught.value)


def test_error_names_the_layer_that_set_the_value(resolve):
    with pytest.raises(
        ConfigError, match=r"^--set fit_it.window_s=-1: expected greater than 0, got -1: give --set another value$"
    ):
        resolve(overrides=["fit_it.window_s=-1"])
    with pytest.raises(
        ConfigError, match=r"^pipeline.yaml:11: profiles.ci.fit_it.inner.size: expected a whole number, got 'many'"
    ):
        resolve(TEXT.replace("size: 1", "size: many"), profile="ci")


def test_all_errors_of_a_section_are_told_at_once(resolve):
    with pytest.raises(ConfigError) as caught:
        resolve(overrides=["fit_it.window_s=-1", "fit_it.scpe=a"])
    assert len(str(caught.value).splitlines()) == 2


@pytest.mark.parametrize(
    ("override", "part"),
    [
        ("fit_it.window_s", "expected stage.key=value"),
        ("window_s=1", "expected stage.key=value"),
        ("fit_it..x=1", "expected stage.key=value"),
        ("fitit.window_s=1", "did you mean 'fit_it'"),
        ("fit_it.window_s=[1", "not valid YAML"),
    ],
)
def test_override_of_the_wrong_form(resolve, override, part):
    with pytest.raises(UsageError) as caught:
        resolve(overrides=[override])
    assert part in str(caught.value) and override in str(caught.value)


def test_unknown_profile(resolve):
    with pytest.raises(UsageError, match="unknown profile 'cci' – did you mean 'ci'"):
        resolve(profile="cci")


def test_only_the_asked_for_sections_are_validated(tmp_path):
    path = tmp_path / "pipeline.yaml"
    path.write_text(TEXT.replace("window_s: 0.2", "window_s: -1"), encoding="utf-8")
    configuration = Configuration(path, TABLE)
    assert set(configuration.resolve([TABLE["collect"]]).stages) == {"collect"}
    with pytest.raises(ConfigError):
        configuration.resolve([TABLE["fit-it"]])


@pytest.mark.parametrize(
    ("content", "part"), [(b"\xff\xfe", "not UTF-8"), (b"- a\n", "expected fields"), (b"", "robot")]
)
def test_file_that_is_no_mapping(tmp_path, content, part):
    path = tmp_path / "pipeline.yaml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=part):
        Configuration(path, TABLE)


def test_defaults_are_validated_too_so_that_what_they_resolve_to_is_in_the_key():
    class Completed(StageParams):
        training: Annotated[dict, AfterValidator(lambda given: {"steps": 5, **given})] = {}

    assert Completed().training == {"steps": 5}
