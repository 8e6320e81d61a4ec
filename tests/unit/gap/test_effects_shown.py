"""What the layers of a diagnosis could show in logs, before it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plant_logs import real

from hqpipe.errors import IdentificationError
from hqpipe.gap.effects_shown import effects_shown

OFFSETS = ("position_bias", "torque_bias")


@pytest.fixture
def logs(make_logs):
    return make_logs(seconds=6.0)


def test_a_loop_with_a_torque_sensor_shows_delays_and_mixes_up_offsets(logs):
    (layer,) = effects_shown(logs)
    assert layer.layer == "actuator" and layer.joints == ("LFR", "LFP")
    delay = next(e for e in layer.effects if (e.joint, e.effect) == ("LFR", "command_delay"))
    assert delay.shows and delay.least.unit == "s" and 0.0 < delay.least.value <= delay.beside.value
    pair = next(pair for pair in layer.pairs if pair.effects == OFFSETS)
    assert pair.joints == layer.joints and "chamber pressures" in pair.experiment
    assert "torque_scale" in layer.not_sought


def test_pressures_tell_an_offset_of_the_sensor_from_one_of_the_command(logs):
    def piped(trial):
        pressure = 1e7 + 1e4 * trial.trajectory.effort
        return replace(trial, trajectory=replace(trial.trajectory, pressure_a=pressure, pressure_b=2e7 - pressure))

    (layer,) = effects_shown(replace(logs, trials=tuple(piped(trial) for trial in logs.trials)))
    assert OFFSETS not in [pair.effects for pair in layer.pairs]
    assert all(OFFSETS[0] not in e.alike for e in layer.effects if e.effect == OFFSETS[1])


def test_friction_is_sought_in_front_of_a_load_cell_only(logs):
    (layer,) = effects_shown(replace(logs, effort_source="pressure"))
    assert "load_cell" in layer.not_sought["coulomb_friction"]


def test_a_limit_falls_with_the_size_of_its_effect(logs):
    (layer,) = effects_shown(logs)
    limit = next(e for e in layer.effects if e.effect == "flow_saturation")
    assert limit.falls and not any(e.falls for e in layer.effects if e.effect == "backlash")


def test_a_record_at_rest_cannot_be_diagnosed(logs):
    def still(trial):
        rest = np.zeros_like(trial.trajectory.position)
        return replace(
            trial,
            trajectory=replace(trial.trajectory, position=rest, velocity=rest, effort=rest, position_command=rest),
        )

    with pytest.raises(IdentificationError):
        effects_shown(replace(logs, trials=tuple(still(trial) for trial in logs.trials)))


def test_strokes_of_one_speed_do_not_tell_dry_from_viscous_friction():
    (layer,) = effects_shown(real("cranfield_ref"))
    assert ("coulomb_friction", "viscous_friction") in [pair.effects for pair in layer.pairs]
