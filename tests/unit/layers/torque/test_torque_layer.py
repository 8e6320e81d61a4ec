"""What a force loop was built with is recovered, and nothing is named on a sound one; end stops carry no weight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from force_loop_truth import LOOP, log_set

from hqpipe.errors import IdentificationError
from hqpipe.identify.identify import identify
from hqpipe.identify.model import all_parameters
from hqpipe.layers.torque import Torque


def found_in(log_set):
    """Cause → its numbers, and the joint's answer."""
    (found,) = identify(Torque().joints(log_set), workers=1).found
    return {c.effect: {n.name: n.value for n in c.numbers} for c in found.causes}, found


def neutral(model):
    return np.array([p.neutral for p in all_parameters(model)])


def test_a_sound_loop_has_no_cause_and_leaves_the_noise():
    causes, found = found_in(log_set(offset=2.0))
    base = dict(zip([p.name for p in found.model.base], found.base.values, strict=False))
    assert causes == {}
    assert base["rate"] == pytest.approx(LOOP, rel=0.03) and base["offset"] == pytest.approx(2.0, abs=0.2)
    assert np.sqrt(np.mean(found.base.heldout**2)) < 1.3 * found.model.noise[1]


@pytest.mark.parametrize(
    ("machine", "cause", "name", "value"),
    [
        ({"delay": 0.012}, "command_delay", "delay_s", 0.012),
        ({"lag": 0.006}, "valve_lag", "time_constant_s", 0.006),
        ({"band": 6.0}, "valve_deadband", "half_width", 6.0),
        ({"limit": 25.0}, "flow_saturation", "limit", 25.0),
        ({"ratio": 0.2}, "direction_asymmetry", "ratio", 0.2),
    ],
)
def test_what_was_built_in_is_named_with_its_number(machine, cause, name, value):
    causes, _ = found_in(log_set(**machine))
    assert list(causes) == [cause]
    assert causes[cause][name] == pytest.approx(value, rel=0.1, abs=2e-3 if name.endswith("_s") else 0.0)


def test_samples_at_an_end_stop_carry_no_weight():
    logs = log_set(stop=0.2)
    joints = Torque().joints(logs)
    model = joints.models[0]
    record = model.records[0]
    touched = record.position >= 0.2
    assert touched.mean() > 0.05 and not touched[model.windows[0].sample].any()
    assert any("end stop" in text for text in joints.warnings)

    def disturbed(trial):
        t = trial.trajectory
        effort = np.where(t.position >= 0.2, t.effort + 1.0, t.effort)
        return replace(trial, trajectory=replace(t, effort=effort))

    again = replace(logs, trials=tuple(disturbed(trial) for trial in logs.trials))
    other = Torque().joints(again).models[0]
    assert np.array_equal(model.windows[0].sample, other.windows[0].sample)


def test_an_effect_at_neutral_leaves_the_prediction_bit_for_bit():
    logs = log_set(trials=2, seconds=8.0)
    whole = Torque().joints(logs).models[0]
    names = [effect.name for effect in whole.effects]
    bare = replace(whole, effects=())
    for effect in whole.effects:
        alone = replace(whole, effects=(effect,))
        assert np.array_equal(alone.error(neutral(alone)), bare.error(neutral(bare))), effect.name
    assert np.array_equal(whole.error(neutral(whole)), bare.error(neutral(bare)))
    assert len(set(names)) == len(names)


def test_logs_without_a_command_are_refused_with_the_column():
    logs = log_set(trials=2, seconds=2.0)
    bare = tuple(replace(t, trajectory=replace(t.trajectory, effort_command=None)) for t in logs.trials)
    with pytest.raises(IdentificationError, match="effort_command"):
        Torque().joints(replace(logs, trials=bare))


def test_logs_with_few_windows_are_refused():
    with pytest.raises(IdentificationError, match="windows of .* away from its end stops"):
        Torque().joints(log_set(trials=2, seconds=1.5))


@pytest.mark.parametrize(("source", "asked"), [("load_cell", True), (None, True), ("pressure", False)])
def test_friction_is_asked_for_where_the_sensor_could_feel_it(source, asked):
    logs = replace(log_set(trials=2, seconds=8.0), effort_source=source)
    names = {effect.name for effect in Torque().joints(logs).models[0].effects}
    assert ("coulomb_friction" in names) == ("load_dependent_friction" in names) == asked


def test_what_the_drive_keeps_of_its_command_is_told():
    (text,) = Torque().joints(log_set(trials=2, seconds=8.0, leak=0.25)).models[0].notes
    assert text.startswith("the drive holds 80% of a steady command")
    lossless = Torque().joints(log_set(trials=2, seconds=8.0, compensated=1.0)).models[0]
    assert lossless.notes == ()


def test_a_torque_that_is_only_its_command_is_told():
    logs = log_set(trials=2, seconds=4.0)
    echoed = tuple(
        replace(t, trajectory=replace(t.trajectory, effort=t.trajectory.effort_command)) for t in logs.trials
    )
    with pytest.raises(IdentificationError, match="is its command in every sample"):
        Torque().joints(replace(logs, trials=echoed))
