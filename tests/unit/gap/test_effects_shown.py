"""What the layers of a diagnosis could show in logs, before it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from layers.torque.force_loop_truth import log_set as loop_logs
from layers.valve.cylinder_truth import log_set as cylinder_logs
from layers.valve.cylinder_truth import strokes
from plant_logs import real

from hqpipe.errors import IdentificationError
from hqpipe.gap.answer.layer_experiment import experiment_for
from hqpipe.gap.effects_shown import effects_shown
from hqpipe.layers.actuator import Actuator
from hqpipe.layers.joint_motion import JointMotion

OFFSETS = ("position_bias", "torque_bias")


@pytest.fixture
def logs(make_logs):
    return make_logs(seconds=6.0)


def test_a_loop_with_a_torque_sensor_shows_delays_and_mixes_up_offsets(logs):
    (layer,) = effects_shown(logs)
    assert layer.layer == "actuator" and layer.joints == ("LFR", "LFP")
    delay = next(e for e in layer.effects if (e.joint, e.effect) == ("LFR", "command_delay"))
    assert delay.shows and delay.least.unit == "s" and 0.0 < delay.least.value <= delay.least_beside_base_error.value
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


@pytest.fixture(scope="module")
def force_loop():
    (layer,) = effects_shown(loop_logs(trials=2))
    return layer


@pytest.fixture(scope="module")
def cylinder():
    commands = [strokes(20.0, 0.01, seed, (0.2, 1.0)) for seed in (1, 2)]
    (layer,) = effects_shown(cylinder_logs(commands, 0.01, spring=6e4))
    return layer


@pytest.mark.parametrize("mode", ["force_loop", "cylinder"])
def test_only_a_position_loop_says_what_is_not_sought(mode, request):
    layer = request.getfixturevalue(mode)
    assert layer.layer == "actuator" and layer.effects and layer.not_sought == {}


@pytest.mark.parametrize("mode", ["force_loop", "cylinder"])
@pytest.mark.parametrize("effect", ["flow_saturation", "orifice_flow"])
def test_limits_have_sizes_that_fall(mode, effect, request):
    shown = next(e for e in request.getfixturevalue(mode).effects if e.effect == effect)
    assert shown.falls and shown.usual is not None
    assert not shown.shows or shown.least.value >= shown.least_beside_base_error.value > 0.0


def test_what_does_not_show_has_an_experiment(force_loop, cylinder):
    hidden = [e for layer in (force_loop, cylinder) for e in layer.effects if not e.shows]
    assert hidden and all(e.experiment for e in hidden)
    assert "two supplies" in experiment_for("torque_limit", "servo") == experiment_for("voltage_sag", "servo")


def resting(logs, joint):
    """The logs with one joint at rest."""

    def still(trial):
        t, channels = trial.trajectory, {}
        for name in ("position", "velocity", "effort", "position_command"):
            channels[name] = getattr(t, name).copy()
            channels[name][:, t.joints.index(joint)] = 0.0
        return replace(trial, trajectory=replace(t, **channels))

    return replace(logs, trials=tuple(still(trial) for trial in logs.trials))


def test_what_is_left_out_is_said(logs):
    (layer,) = effects_shown(resting(logs, "LFP"))
    assert layer.joints == ("LFR",)
    assert any(item.joints == ("LFP",) and item.reason for item in layer.left_out)
    short = replace(logs.trials[0], file="short.parquet", trajectory=logs.trials[0].trajectory.section(0, 20))
    (layer,) = effects_shown(replace(logs, trials=(*logs.trials, short)))
    assert any(item.trials == ("short.parquet",) and "shorter" in item.reason for item in layer.left_out)


def test_an_overflowing_joint_is_left_out_with_the_reason(logs, monkeypatch):
    def overflowing(self, log_set, window_s=None, without=()):
        joints = joints_of(self, log_set, window_s, without)
        model = joints.models[0]
        object.__setattr__(model, "error", lambda values, heldout=False: np.full(len(model.fit.time), np.inf))
        return joints

    joints_of = Actuator.joints
    monkeypatch.setattr(Actuator, "joints", overflowing)
    (layer,) = effects_shown(logs)
    assert layer.joints == ("LFP",) == tuple(dict.fromkeys(e.joint for e in layer.effects))
    assert [(item.joints, item.reason) for item in layer.left_out] == [
        (("LFR",), "the base model's prediction overflows")
    ]


def test_a_refused_layer_beside_another_one_has_the_reason(logs, monkeypatch):
    def refuse(self, log_set, window_s=None, without=()):
        raise IdentificationError("no joint can be judged", fix="record more")

    monkeypatch.setattr(JointMotion, "joints", refuse)
    law, motion = effects_shown(replace(logs, effort_source=None))
    assert law.reason is None and law.effects
    assert (motion.layer, motion.reason, motion.effects) == ("joint_motion", "no joint can be judged: record more", ())
    monkeypatch.setattr(Actuator, "joints", refuse)
    with pytest.raises(IdentificationError, match="no joint can be judged"):
        effects_shown(replace(logs, effort_source=None))
