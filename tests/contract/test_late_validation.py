"""Parameters that cannot work are refused before the first stage starts, wherever they stand."""

from __future__ import annotations

import json
import math
import typing

import pytest

from hqpipe.cli import run_cli
from hqpipe.errors import ConfigError
from hqpipe.pipeline.config import Configuration
from hqpipe.robots import load_robot
from hqpipe.stages import STAGES

TEXT = STAGES.template.read_text(encoding="utf-8")
ROBOT = load_robot("hydraulic_quadruped").folder


@pytest.fixture
def resolve(tmp_path):
    def resolve(text: str = TEXT, *, stages=None, **options):
        path = tmp_path / "pipeline.yaml"
        path.write_text(text, encoding="utf-8")
        return Configuration(path, STAGES).resolve(stages or STAGES.values(), robot=ROBOT, **options)

    return resolve


def refused(resolve, *overrides: str) -> ConfigError:
    with pytest.raises(ConfigError) as caught:
        resolve(overrides=overrides)
    assert caught.value.fix and len(str(caught.value)) < 800
    return caught.value


@pytest.mark.parametrize(
    ("override", "field", "part"),
    [
        ("validate.plant={nope: 1}", "validate.plant.nope", "unknown field 'nope'"),
        ("validate.plant={valve: {overlap: 2}}", "validate.plant.valve.overlap", "expected 0 to 0.9 opening, got 2"),
        ("validate.plant.valve.overlap=1.0e+300", "validate.plant.valve.overlap", "expected 0 to 0.9"),
        ("validate.plant.fluid.bulk_modulus=1.0e+300", "validate.plant.fluid.bulk_modulus", "got 1e+300"),
        ("collect.plant={valve: 3}", "collect.plant.valve", "expected a mapping of fields, got 3"),
        ("collect.plant={joints: {LFX: {valve: {delay: 0}}}}", "collect.plant.joints.LFX", "no joint 'LFX'"),
        ("collect.plant={spans: 3}", "collect.plant.spans", "expected a list"),
        ("collect.plant={spans: [{time: [a, b]}]}", "collect.plant.spans.0.time", "expected [start, stop]"),
        (
            "collect.plant={spans: [{time: [0, 1], joints: [{}]}]}",
            "collect.plant.spans.0.joints",
            "the name of a joint",
        ),
        ("collect.plant={effort_source: [1]}", "collect.plant.effort_source", "expected one of pressure"),
        ("collect.plant={body: {payloads: 3}}", "collect.plant.body.payloads", "expected a list"),
        (
            "collect.plant={body: {payloads: [{link: trunc, mass: 3}]}}",
            "collect.plant.body.payloads.0.link",
            "did you mean 'trunk'",
        ),
        (
            "collect.plant={body: {payloads: [{link: trunk, mass: -3}]}}",
            "collect.plant.body.payloads.0.mass",
            "expected 0 to 10000",
        ),
        ("collect.plant={body: {links: {nope: {}}}}", "collect.plant.body.links.nope", "no link 'nope'"),
        ("collect.plant={body: {ground: {friction: true}}}", "collect.plant.body.ground.friction", "got True"),
        ("collect.plant={chain: {mass: 0.2}}", "collect.plant", "too stiff"),
        ("report.plant={nope: 1}", "report.plant.nope", "unknown field"),
        ("compare.plant={nope: 1}", "compare.plant.nope", "unknown field"),
        ("bootstrap.position.engine=foo", "bootstrap.position.engine", "expected one of pybullet, mujoco"),
        ("bootstrap.position.command.vx=[0]", "bootstrap.position.command.vx", "expected [low, high]"),
        ("bootstrap.torque.policy.hidden=[1e9, 1e9]", "bootstrap.torque.policy.hidden", "memory"),
        ("bootstrap.torque.num_envs=1000000000", "bootstrap.torque.num_envs", "expected 1 to 10000"),
        ("bootstrap.torque.nope=1", "bootstrap.torque.nope", "unknown field 'nope'"),
        ("bootstrap.position.seed=1", "bootstrap.position.seed", "seed of its stage"),
        ("bootstrap.position=3", "bootstrap.position", "expected a mapping"),
        ("retrain.training.evaluation.commands=[]", "retrain.training.evaluation.commands", "got []"),
        ("retrain.training.total_steps=1e9", "retrain.training.total_steps", "whole number, written without point"),
        ("retrain.training.total_steps=true", "retrain.training.total_steps", "whole number"),
        ("retrain.training.num_envs=7", "retrain.training.num_envs", "ppo.batch_size: 2400 does not divide"),
        ("retrain.training.ppo.batch_size=7", "retrain.training.ppo.batch_size", "7 does not divide"),
        ("compare.training.ppo.learning_rate=.nan", "compare.training.ppo.learning_rate", "got nan"),
        ("collect.walk_seconds=0.0001", "collect.walk_seconds", "expected 1 to 600"),
        ("collect.walk_seconds=true", "collect.walk_seconds", "expected a valid number, got True"),
        ("collect.stress_seconds=0.1", "collect.stress_seconds", "or 0"),
        ("fit_actuator.window_s=1e300", "fit_actuator.window_s", "expected 0.001 to 10"),
        ("fit_actuator.data_seconds=[-1]", "fit_actuator.data_seconds.0", "expected 0.1 to 1e+06"),
        ("fit_actuator.net_iterations=0", "fit_actuator.net_iterations", "expected 1 to 1e+06"),
        ("fit_actuator.net_iterations=1.5", "fit_actuator.net_iterations", "whole number"),
        ("fit_actuator.rivals=[mlp, mlp]", "fit_actuator.rivals", "more than once"),
        ("fit_actuator.rivals=[lsmt]", "fit_actuator.rivals.0", "got 'lsmt'"),
        ("fit_actuator.strict=1", "fit_actuator.strict", "true or false, got 1"),
        ("fit_actuator.scope=joint", "fit_actuator.scope", "got 'joint'"),
        ("diagnose.without=[backlashh]", "diagnose.without", "did you mean 'backlash'"),
        ("diagnose.without=backlash", "diagnose.without", "expected a list"),
        ("diagnose.window_s=0", "diagnose.window_s", "expected 0.001 to 10"),
        ("export.parity_samples=1000000000", "export.parity_samples", "expected 1 to 1e+06"),
        ("validate.scenarios=[]", "validate.scenarios", "got none"),
        ("validate.scenarios=[forwrd_10]", "validate.scenarios", "did you mean 'forward_10'"),
        ("validate.walk_seeds=1000000000", "validate.walk_seeds", "expected 1 to 1000"),
        ("validate.torque_nrmse=-1", "validate.torque_nrmse", "expected 1e-12 to 1e+06"),
        ("validate.walk_seconds=0", "validate.walk_seconds", "expected 1 to 600"),
        ("compare.controllers=[]", "compare.controllers", "expected names of controllers"),
        ("compare.seeds=0", "compare.seeds", "expected 1 to 1000"),
        ("report.speed=0", "report.speed", "expected 0.01 to 100"),
        ("report.speed=100", "report.speed", "fewer than two frames"),
        ("report.vx=1e300", "report.vx", "expected -10 to 10"),
        ("report.frame_rate=20.5", "report.frame_rate", "got 20.5"),
        ("collect.seed=1.5", "collect.seed", "whole number from 0"),
        ("collect.seed=true", "collect.seed", "whole number from 0"),
    ],
)
def test_the_override_is_named(resolve, override, field, part):
    error = refused(resolve, override)
    assert error.file is None and error.field == field
    assert str(error).startswith(f"--set {override}: ") and part in str(error)


SECTIONS = [
    ("bootstrap", "{position: {engine: foo}}", "position.engine"),
    ("collect", "{plant: {nope: 1}}", "plant.nope"),
    ("fit_actuator", "{window_s: -1}", "window_s"),
    ("diagnose", "{without: [nope]}", "without"),
    ("retrain", "{training: {command: {vx: [0]}}}", "training.command.vx"),
    ("export", "{parity_samples: 0}", "parity_samples"),
    ("validate", "{scenarios: []}", "scenarios"),
    ("compare", "{training: {gait: {duty: 1}}}", "training.gait.duty"),
    ("report", "{width: 1}", "width"),
]


@pytest.mark.parametrize(("section", "wrong", "field"), SECTIONS)
def test_every_section_of_every_profile_is_checked(resolve, section, wrong, field):
    start = TEXT.index("profiles:")
    assert f"  {section}: {{}}" in TEXT
    base = TEXT[:start].replace(f"  {section}: {{}}", f"  {section}: {wrong}") + TEXT[start:]
    other = f"{TEXT}\n  spare:\n    {section}: {wrong}\n"
    for text, above in ((base, "stages"), (other, "profiles.spare")):
        line = next(i for i, each in enumerate(text.splitlines(), 1) if wrong in each)
        for stages in (STAGES.values(), [stage for stage in STAGES.values() if stage.section == section]):
            with pytest.raises(ConfigError) as caught:
                resolve(text, stages=stages, profile="ci")
            assert caught.value.field == f"{above}.{section}.{field}"
            assert str(caught.value).startswith(f"pipeline.yaml:{line}: {caught.value.field}: ")
            assert caught.value.file.endswith("pipeline.yaml") and len(str(caught.value).splitlines()) == 1


def test_a_wrong_value_that_the_profile_hides_is_found(resolve):
    text = TEXT.replace("  validate: {}", "  validate: {walk_seconds: -1}")
    with pytest.raises(ConfigError, match="pipeline.yaml:.*: stages.validate.walk_seconds: expected 1 to 600"):
        resolve(text, profile="ci")
    with pytest.raises(ConfigError, match="stages.validate.walk_seconds"):
        resolve(text, profile="ci", overrides=["validate.walk_seconds=9"])


def test_all_that_is_wrong_is_told_at_once(resolve):
    text = TEXT.replace("  validate: {}", "  validate: {walk_seeds: 0, walk_drift: 0}").replace(
        "  diagnose: {}", "  diagnose: {window_s: 0}"
    )
    with pytest.raises(ConfigError) as caught:
        resolve(text)
    assert len(str(caught.value).splitlines()) == 3 and len(caught.value.to_json()["errors"]) == 3


@pytest.mark.parametrize(
    "arguments", [("run", "all"), ("run", "all", "--dry-run"), ("status",), ("validate", "--dry-run")]
)
def test_no_stage_starts(tmp_path, monkeypatch, capfd, arguments):
    (tmp_path / "pipeline.yaml").write_text(TEXT.replace("  validate: {}", "  validate: {plant: {nope: 1}}"))
    monkeypatch.chdir(tmp_path)
    assert run_cli(STAGES, [*arguments, "--json"]) == 2
    out, err = capfd.readouterr()
    assert json.loads(out)["error"]["field"] == "stages.validate.plant.nope"
    assert "started" not in err and not (tmp_path / "artifacts").exists()


def numbers(annotation) -> bool:
    parts = typing.get_args(annotation)
    return annotation in (int, float) or any(numbers(part) for part in parts if not isinstance(part, int | float | str))


def test_no_number_of_any_stage_may_be_without_bounds():
    found = 0
    for stage in STAGES.values():
        params = stage.load_params()
        for name, field in params.model_fields.items():
            if not numbers(field.annotation) or isinstance(field.default, list | dict):
                continue
            found += 1
            for value in (1e300, -1e300, math.inf, math.nan, True, "1", 10**400, 10**30, -(10**30)):
                with pytest.raises(ValueError, match=name):
                    params(**{name: value})
    assert found > 20


def test_what_is_in_the_file_stays_as_it_is(resolve):
    params = resolve(overrides=["collect.plant={supply: {pressure: 15000000}}"]).stages["collect"].params
    assert params.model_dump()["plant"] == {"supply": {"pressure": 15000000}}
