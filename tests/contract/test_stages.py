"""What every row of the STAGES table promises."""

from __future__ import annotations

import inspect
from pathlib import Path

import click
import pytest

from hqpipe.actuators import files, posterior_file, weights_file
from hqpipe.gap import diagnosis
from hqpipe.pipeline.config import Configuration, StageParams
from hqpipe.pipeline.run_commands import StageCommand
from hqpipe.stages import ACTUATOR, DIAGNOSED, FITTED, MODEL, MODELS, STAGES
from hqpipe.stages.comparison.controllers import ACTUATOR_FOLDERS
from hqpipe.stages.inputs.logs import FIT

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("stage", STAGES.values(), ids=list(STAGES))
def test_stage_has_run_and_parameters_with_defaults(stage):
    params = stage.load_params()
    assert issubclass(params, StageParams)
    assert isinstance(params(), params)
    assert "seed" not in params.model_fields
    assert list(inspect.signature(stage.load_run()).parameters) == ["context"]


@pytest.mark.parametrize("stage", STAGES.values(), ids=list(STAGES))
def test_options_that_set_a_parameter_have_one_and_help(stage):
    rows = [*((option, text) for option, text in stage.switches), *((o, text) for o, _, text in stage.settings)]
    names = [stage.parameter(option) for option, _ in rows]
    assert set(names) <= set(stage.load_params().model_fields) and len(set(names)) == len(names)
    command = StageCommand(stage)
    options = [name for parameter in command.params for name in parameter.opts]
    assert len(set(options)) == len(options) and {option for option, _ in rows} <= set(options)
    told = " ".join(command.get_help(click.Context(command)).split())
    assert all(text in told for _, text in rows)


@pytest.mark.parametrize("stage", STAGES.values(), ids=list(STAGES))
def test_module_is_named_after_the_stage(stage):
    assert stage.module == f"hqpipe.stages.{stage.section}"
    assert (ROOT / "stages" / f"{stage.section}.py").is_file()


@pytest.mark.parametrize("profile", ["ci", "default", "learned", "paper"])
def test_pipeline_yaml_is_valid_in_every_profile(profile):
    configuration = Configuration(ROOT / "pipeline.yaml", STAGES)
    settings = configuration.resolve(STAGES.values(), profile=profile)
    assert list(settings.stages) == list(STAGES)


def test_init_writes_the_pipeline_yaml_of_this_project():
    assert STAGES.template.read_bytes() == (ROOT / "pipeline.yaml").read_bytes()


def test_what_is_read_of_an_actuator_is_what_counts():
    assert MODEL == (files.FILE, weights_file.FILE)
    assert ACTUATOR.files == (*MODEL, posterior_file.FILE) and FITTED.files == (*MODEL, FIT)
    nets = {f"rivals/{folder}/{name}" for folder in ACTUATOR_FOLDERS.values() for name in MODEL}
    assert set(MODELS.files) == {*MODEL, posterior_file.FILE, *nets} and set(DIAGNOSED.files) == {
        *MODEL,
        posterior_file.FILE,
        diagnosis.FILE,
    }
