"""Which samples and effects the layer offers, and what it says where it cannot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cylinder_truth import log_set, simulate, strokes
from fitting import fitted

from hqpipe.errors import IdentificationError
from hqpipe.identify.model import all_parameters
from hqpipe.layers.valve import Valve
from hqpipe.layers.valve.noise import kept
from hqpipe.layers.valve.record import rest_command
from hqpipe.logs.differentiate import differentiate
from hqpipe.logs.survey.signal import resolution

DT = 0.01


@pytest.fixture(scope="module")
def logs():
    return log_set([strokes(20.0, DT, 1, (0.2, 1.0)), strokes(10.0, DT, 2, (0.2, 1.0))], DT, overlap=0.05)


def changed(logs, **fields):
    """The log set with fields of every trajectory replaced."""
    return replace(logs, trials=tuple(replace(t, trajectory=replace(t.trajectory, **fields)) for t in logs.trials))


def the_joint(logs, **options):
    (model,) = Valve().joints(logs, **options).models
    return model


def neutral(model):
    return np.array([p.neutral for p in all_parameters(model)])


def test_effects_are_inert_at_neutral_bit_for_bit(logs):
    model = the_joint(logs)
    plain = the_joint(logs, without=[effect.name for effect in model.effects])
    assert plain.effects == ()
    assert np.array_equal(model.error(neutral(model)), plain.error(neutral(plain)))


def test_each_effect_changes_the_error_from_its_starting_values(logs):
    model = the_joint(logs)
    values, at = neutral(model), len(model.base)
    before = model.error(values)
    for effect in model.effects:
        moved = values.copy()
        for k, parameter in enumerate(effect.parameters):
            moved[at + k] = parameter.starts[-1] if parameter.starts else parameter.neutral + parameter.spread
        at += len(effect.parameters)
        assert not np.array_equal(model.error(moved), before), effect.name


def test_parameters_lie_within_their_bounds(logs):
    for parameter in all_parameters(the_joint(logs)):
        values = (parameter.neutral, *parameter.starts)
        assert all(parameter.low <= value <= parameter.high for value in values), parameter


def test_the_unit_follows_what_is_predicted_and_the_kind_of_joint(logs):
    assert the_joint(logs).unit == "m"
    assert the_joint(changed(logs, velocity_source="measured")).unit == "m/s"
    assert the_joint(replace(logs, kinds={})).unit == "rad"


def test_a_measured_velocity_is_predicted_itself(logs):
    model = the_joint(changed(logs, velocity_source="measured"))
    assert np.array_equal(model.fit.output, model.fit.velocity)


def test_the_noise_of_a_measured_velocity(logs):
    rng = np.random.default_rng(8)
    trials = tuple(
        replace(
            t,
            trajectory=replace(
                t.trajectory,
                velocity=t.trajectory.velocity + 3e-3 * rng.standard_normal(t.trajectory.velocity.shape),
                velocity_source="measured",
            ),
        )
        for t in logs.trials
    )
    assert the_joint(replace(logs, trials=trials)).noise[0] == pytest.approx(3e-3, rel=0.3)  # the cylinder hardly rests


def test_an_encoder_brought_to_another_clock_keeps_its_step():
    step, rng = 1e-3, np.random.default_rng(6)
    coarse = np.repeat(np.cumsum(rng.integers(-9, 10, 400)), 3) * step
    blended = np.interp(np.arange(0.0, len(coarse) - 1, 1.07), np.arange(len(coarse)), coarse)
    assert resolution(blended) is None and resolution(kept(blended)) == pytest.approx(step, rel=1e-6)


def test_unobserved_samples_are_not_judged(logs):
    observed = {id(t): np.random.default_rng(0).uniform(size=(t.trajectory.samples, 1)) > 0.1 for t in logs.trials}
    trials = tuple(replace(t, trajectory=replace(t.trajectory, observed=observed[id(t)])) for t in logs.trials)
    model = the_joint(replace(logs, trials=trials))
    at = np.round(model.fit.time / DT).astype(int)
    assert observed[id(logs.trials[0])][at, 0].all() and len(at) > 500


@pytest.mark.parametrize("late", [0.05, 0.2])
def test_windows_are_several_times_as_long_as_a_joint_is_late(late):
    command = [strokes(60.0, DT, seed, (0.2, 1.0)) for seed in (1, 2)]
    found = Valve().joints(log_set(command, DT, delay=late))
    assert found.window_s == pytest.approx(5.0 * late, rel=0.2)
    assert found.window_reason.endswith("ms by which rod follows its command")


def test_a_short_log_holds_enough_windows_of_a_slow_joint():
    command = [strokes(12.0, DT, seed, (0.2, 1.0)) for seed in (1, 2)]
    found = Valve().joints(log_set(command, DT, delay=0.2))
    assert 0.4 < found.window_s < 0.6
    assert found.window_reason.startswith("of longer ones the trials hold fewer than 20")
    assert len(found.models[0].windows[0].begin) >= 15


def test_windows_stay_within_their_stretch(logs):
    first, rest = logs.trials[0], logs.trials[1:]
    parts = [replace(first, trajectory=first.trajectory.section(a, a + 450)) for a in (0, 450, 900, 1350)]
    model = the_joint(replace(logs, trials=(*parts, *rest)))
    cut, stretch = model.windows[0], model.records[0].stretch
    assert np.array_equal(stretch[cut.begin[cut.window]], stretch[cut.sample])
    assert (cut.start >= cut.first).all() and (cut.stop - 1 <= cut.last).all()


def test_rest_does_not_outweigh_motion(logs):
    command = np.concatenate([strokes(6.0, DT, 4, (0.2, 1.0)), np.zeros(6000)])
    model = the_joint(log_set([command, command], DT))
    moving = np.abs(model.fit.output - model.fit.held) > 1e-3
    assert moving.mean() > 0.3


def test_something_in_the_way_is_left_out_and_told(logs):
    def stalled(t, a, b):
        # the same motion, interrupted: the rod stands while its command goes on, then continues from where it stood
        position = t.position.copy()
        position[b:] -= position[b] - position[a]
        position[a:b] = position[a]
        return replace(t, position=position)

    command = np.tile(np.concatenate([np.full(150, 0.6), np.full(150, -0.6)]), 10)
    plain = log_set([command, command], DT)
    first = replace(plain.trials[0], trajectory=stalled(plain.trials[0].trajectory, 1270, 1340))
    model = the_joint(replace(plain, trials=(first, *plain.trials[1:])))
    assert any("blocks it" in note for note in model.notes)
    at = np.round(model.fit.time / DT).astype(int)
    assert not np.isin(np.arange(1280, 1330), at).any()


@pytest.mark.parametrize("scale", [-1.0, 400.0])
def test_the_scale_and_sign_of_the_command_do_not_matter(logs, scale):
    trials = tuple(
        replace(t, trajectory=replace(t.trajectory, valve_command=scale * t.trajectory.valve_command + 1500.0))
        for t in logs.trials
    )
    one, (size, _) = fitted(the_joint(logs), "valve_deadband")
    other, (size_too, _) = fitted(the_joint(replace(logs, trials=trials)), "valve_deadband")
    assert other["half_width"] == pytest.approx(abs(scale) * one["half_width"], rel=1e-3)
    assert other["gain"] * scale == pytest.approx(one["gain"], rel=1e-3)
    assert size_too == pytest.approx(size, rel=1e-3)


def test_without_held_out_trials_there_are_no_such_samples(logs):
    model = the_joint(replace(logs, trials=logs.trials[:1]))
    assert len(model.heldout.output) == 0 and len(model.error(neutral(model), heldout=True)) == 0


@pytest.mark.parametrize("inverted", [1.0, -1.0])
def test_the_rest_of_a_command_that_is_mostly_at_one_end(inverted):
    command = np.tile(np.concatenate([np.full(400, 0.8), np.full(250, -0.8)]), 5)
    position, _ = simulate(command, DT)
    velocity = differentiate(inverted * position[:, None], DT)[:, 0]
    assert rest_command(command, velocity) == pytest.approx(0.0, abs=0.05)


def test_a_turning_point_is_no_end_stop():
    time = np.arange(0.0, 40.0, DT)
    command = 0.5 * np.cos(2 * np.pi * 0.4 * time)
    assert the_joint(log_set([command, command], DT)).notes == ()


def test_effects_of_the_load_need_a_load(logs):
    assert "orifice_flow" not in {e.name for e in the_joint(logs).effects}
    pressures = {"pressure_a": 5e6, "pressure_b": 3e6}
    rng = np.random.default_rng(5)
    trials = tuple(
        replace(
            t,
            trajectory=replace(
                t.trajectory,
                **{name: mean * rng.uniform(0.5, 1.5, (t.trajectory.samples, 1)) for name, mean in pressures.items()},
            ),
        )
        for t in logs.trials
    )
    effect = {e.name: e for e in the_joint(replace(logs, trials=trials)).effects}["orifice_flow"]
    assert [(p.name, p.unit) for p in effect.parameters] == [("pressure_max_pa", "Pa"), ("area_ratio", "1")]


def test_a_log_without_a_valve_command_is_refused(logs):
    bare = changed(logs, valve_command=None)
    assert Valve().lacking(logs) == [] and Valve().lacking(bare) == ["valve_command"]
    with pytest.raises(IdentificationError, match="valve_command"):
        Valve().joints(bare)


def test_a_command_that_never_changes_is_refused(logs):
    constant = replace(
        logs,
        trials=tuple(
            replace(t, trajectory=replace(t.trajectory, valve_command=np.zeros((t.trajectory.samples, 1))))
            for t in logs.trials
        ),
    )
    with pytest.raises(IdentificationError, match="rod: its valve command never changes"):
        Valve().joints(constant)


def test_remarks_name_the_edges_and_what_cannot_be_told(logs):
    model = the_joint(logs)
    values = neutral(model)
    names = [p.name for p in all_parameters(model)]
    for name, value in (("neutral", 0.1), ("half_width", 0.3), ("recovery_s", 0.2)):
        values[names.index(name)] = value
    assert model.remarks((), values) == ()
    (edges,) = model.remarks(("valve_deadband",), values)
    assert "-0.2 and 0.4" in edges
    (areas,) = model.remarks(("direction_asymmetry",), values)
    assert "constant load" in areas
    assert model.remarks(("supply_droop",), values) == ()


def test_joints_of_one_log_share_the_row_of_the_command(logs):
    """The joint that answers at once bounds the row's offset, so that a dead time below a sample shows in the other."""
    one = logs.trials
    slow = log_set([t.trajectory.valve_command[:, 0] for t in one], DT, overlap=0.05, delay=0.008).trials
    both = tuple(
        replace(
            a,
            trajectory=replace(
                a.trajectory,
                joints=("rod", "late"),
                **{
                    name: np.column_stack([getattr(a.trajectory, name), getattr(b.trajectory, name)])
                    for name in ("position", "velocity", "valve_command")
                },
            ),
        )
        for a, b in zip(one, slow, strict=True)
    )
    kinds = {"rod": "prismatic", "late": "prismatic"}
    joints = Valve().joints(replace(logs, joints=("rod", "late"), trials=both, kinds=kinds)).models
    alone = the_joint(logs)
    assert all(m.base[-1].high < alone.base[-1].high for m in joints)
    values, _ = fitted(joints[1], "valve_deadband", "command_delay")
    assert values["delay_s"] + values["row_offset_s"] == pytest.approx(0.008 + 0.005, abs=2e-3)
    assert values["delay_s"] > 2e-3
