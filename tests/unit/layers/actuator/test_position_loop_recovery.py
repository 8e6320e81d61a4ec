"""What was planted in one of several joints is named with its number, there alone, and nothing in a sound joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from position_loop_logs import DT, changed, planted, planted_logs, with_column

from hqpipe.identify.identify import identify
from hqpipe.identify.model import all_parameters, positions
from hqpipe.layers.actuator import Actuator
from hqpipe.layers.actuator.parameters import LOGGED_SPEED
from hqpipe.machine.layout import BASE, slot

PLANTED = (
    ("valve_deadband", "half_width", 0.02, {"rounding": 0.0}),
    ("command_delay", "delay_s", 0.006, {}),
    ("valve_lag", "time_constant_s", 0.012, {}),
    ("flow_saturation", "limit", 0.06, {}),
    ("orifice_flow", "effort_max_nm", 900.0, {}),
    ("coulomb_friction", "friction_nm", 25.0, {"presliding_rad": 0.002}),
)


@pytest.fixture(scope="module")
def answers():
    """Joint by joint: a sound one, then one with each planted effect."""
    effects = [{}, *({name: {number: value} | beside} for name, number, value, beside in PLANTED)]
    return identify(Actuator().joints(planted_logs(*effects)), workers=2).found


def test_a_sound_joint_beside_six_others_has_no_cause(answers):
    sound = answers[0]
    assert sound.causes == () and sound.unexplained < 0.2
    assert np.sqrt(np.mean(sound.base.heldout**2)) < 1.1 * sound.model.noise[1]


@pytest.mark.parametrize("at", range(len(PLANTED)), ids=[name for name, *_ in PLANTED])
def test_what_was_planted_is_named_with_its_number(answers, at):
    name, number, value, _ = PLANTED[at]
    found = answers[at + 1]
    assert [cause.effect for cause in found.causes] == [name]
    cause = found.causes[0]
    first = cause.numbers[0]
    assert first.name == number and cause.probability > 0.9
    assert found.model.reported(name, number, first.value)[1] == pytest.approx(value, rel=0.1)
    assert np.sqrt(np.mean(found.named.heldout**2)) < 1.2 * found.model.noise[1]


def test_of_two_joints_that_have_one_effect_between_them_only_the_one_is_named():
    logs = planted_logs({}, {"valve_deadband": {"half_width": 0.02}}, seed=3, seconds=4.0)
    sound, worn = identify(Actuator().joints(logs)).found
    assert sound.causes == () and [cause.effect for cause in worn.causes] == ["valve_deadband"]


def test_a_slow_integrator_is_named_too():
    """0.1 1/s: less than a tenth of what is usual, yet most of what the base leaves."""
    (found,) = identify(Actuator().joints(planted_logs({"integral_action": {"ki": 0.1}}, seed=4))).found
    assert [cause.effect for cause in found.causes] == ["integral_action"]
    assert found.causes[0].numbers[0].value == pytest.approx(0.1, rel=0.2)


def on_a_linkage(log_set, slope, curve):
    """The motions of a log set, moved by forces with an arm that changes with the position."""
    rng = np.random.default_rng(8)

    def driven(t):
        arm = 1.0 + slope * t.position + curve * t.position**2
        error, speed = t.position_command - t.position, np.diff(t.position, axis=0) / DT
        force = [t.effort[0] / arm[0]]
        for k in range(t.samples - 1):
            g, f, e = planted.GAINS, force[-1], error[k]
            gained = g["k1"] * e - g["k3"] * speed[k] * arm[k] + g["k4"] * np.maximum(-f * np.sign(e), 0.0) * e
            force.append((1.0 - g["k2"]) * f + gained)
        return replace(t, effort=np.array(force) * arm + 3.0 * rng.standard_normal(t.effort.shape))

    return changed(log_set, driven)


def test_an_arm_that_changes_with_the_position_is_part_of_the_law_and_no_cause():
    (found,) = identify(Actuator().joints(on_a_linkage(planted_logs({}), 0.5, -0.7))).found
    assert found.causes == () and found.unexplained < 0.2
    row, position = found.model.row(found.base.values), found.model.fit.position
    arm = relative_arm_of(row, position)
    expected = 1.0 + 0.5 * position - 0.7 * position**2
    np.testing.assert_allclose(arm / arm.mean(), expected / expected.mean(), atol=0.01)


def test_sides_that_differ_a_little_do_not_shift_an_offset_of_the_position():
    sides = {"orifice_flow": {"effort_max_nm": 500.0}, "direction_asymmetry": {"areas": 0.004}}
    logs = planted_logs({**sides, "position_bias": {"rad": 0.004}}, noise=1.0, seconds=10.0, fit=3)
    (found,) = identify(Actuator().joints(logs)).found
    assert {cause.effect for cause in found.causes} == {"orifice_flow", "position_bias"}
    (offset,) = next(cause for cause in found.causes if cause.effect == "position_bias").numbers
    assert offset.value == pytest.approx(0.004, abs=4e-5)
    assert offset.ci95[0] < 0.004 < offset.ci95[1] and offset.ci95[1] - offset.ci95[0] < 4e-4
    uncorrected = found.kept.values[positions(found.model, ["position_bias"])[len(found.model.base)]]
    assert abs(uncorrected - 0.004) > 1e-4, "what the sides do, and the model of a simulator keeps"


def relative_arm_of(row, position):
    offset = position - row[slot("setting", "middle")]
    return 1.0 + row[slot("setting", "arm_slope")] * offset + row[slot("setting", "arm_curve")] * offset**2


def every_row(log_set, rows):
    """The log set with one row of so many."""

    def thinned(trial):
        t = trial.trajectory
        channels = {name: values[::rows] for name, values in t.channels().items()}
        return replace(trial, trajectory=replace(t, time=t.time[::rows], **channels))

    return replace(log_set, trials=tuple(map(thinned, log_set.trials)), rate_hz=log_set.rate_hz / rows)


@pytest.mark.parametrize("rows", [2, 5, 10])
def test_a_log_slower_than_the_controller_tells_the_same(rows):
    effects = [{}, {"command_delay": {"delay_s": 0.006}}, {"valve_deadband": {"half_width": 0.02, "rounding": 0.0}}]
    sound, late, lapped = identify(Actuator().joints(every_row(planted_logs(*effects, seconds=10.0), rows))).found
    assert sound.causes == ()
    for found, name, value in ((late, "command_delay", 0.006), (lapped, "valve_deadband", 0.02)):
        assert [cause.effect for cause in found.causes] == [name]
        number = found.causes[0].numbers[0]
        assert found.model.reported(name, number.name, number.value)[1] == pytest.approx(value, rel=0.1)
    assert found.model.row(found.kept.values)[slot("setting", "sample_time")] == pytest.approx(DT)
    for k, name in enumerate(BASE):
        assert sound.base.values[k] == pytest.approx(planted.GAINS[name], rel=0.05, abs=1e-3), name


@pytest.mark.parametrize("rows", [3, 4])
def test_steps_of_the_command_between_rows_tell_a_delay_from_a_lag(rows):
    """The target is held for 10 ms, which is no whole number of rows."""
    late = {"command_delay": {"delay_s": 0.0051}, "valve_lag": {"time_constant_s": 0.004}}
    (found,) = identify(Actuator().joints(every_row(planted_logs(late, seconds=8.0), rows))).found
    numbers = {cause.effect: cause.numbers[0].value for cause in found.causes}
    assert numbers == {
        "command_delay": pytest.approx(0.0051, abs=0.0003),
        "valve_lag": pytest.approx(0.004, abs=0.0003),
    }


def share_of_the_logged_speed(log_set):
    (found,) = identify(Actuator().joints(log_set)).found
    names = [p.name for p in found.model.base]
    return found.base.values[names.index(LOGGED_SPEED)], found


def test_a_coarse_encoder_beside_a_good_speed_has_the_logged_speed_believed():
    step = 2e-3  # rad, of the encoder; the valve's controller and the oil know the true position
    logs = with_column(planted_logs({}, seconds=4.0), "position", 0, lambda t: step * np.round(t.position[:, 0] / step))
    share, _ = share_of_the_logged_speed(logs)
    assert share > 0.9


def test_a_noisy_speed_beside_a_good_encoder_is_not_believed():
    rng = np.random.default_rng(5)
    logs = with_column(
        planted_logs({}, seconds=3.0), "velocity", 0, lambda t: t.velocity[:, 0] + 0.3 * rng.standard_normal(t.samples)
    )
    share, found = share_of_the_logged_speed(logs)
    assert share < 0.1 and found.causes == ()


def gain_that_jumps(share, factor):
    """Logs in which the gain is another one after a share of each trial; the sample at the jump was not recorded."""
    before, after = planted_logs({}, seconds=3.0 * share), planted_logs({}, seconds=3.0 * (1.0 - share), gains=factor)
    trials = []
    for trial, later in zip(before.trials, after.trials, strict=True):
        t, u = trial.trajectory, later.trajectory
        names = ("position", "velocity", "effort", "position_command")
        joined = {name: np.concatenate([getattr(t, name), getattr(u, name)]) for name in names}
        observed = np.ones(joined["effort"].shape, dtype=bool)
        observed[t.samples] = False
        whole = replace(t, time=np.arange(len(observed)) * DT, observed=observed, **joined)
        trials.append(replace(trial, trajectory=whole))
    return replace(before, trials=tuple(trials))


def test_a_gain_that_jumps_is_better_described_by_the_shape_of_a_jump_than_by_a_drift():
    """Beside the true numbers of the base."""
    model = Actuator().joints(gain_that_jumps(0.5, {"k1": [1.25]})).models[0]
    values = np.array([p.neutral for p in all_parameters(model)])
    values[:4] = [540.0, 0.05, 21.6, 0.36]  # see planted_effects.GAINS
    error, left = model.error(values), {}
    for name in ("gain_drift", "sudden_change"):
        columns = []
        for index in positions(model, [name])[len(model.base) :]:
            moved = values.copy()
            moved[index] += all_parameters(model)[index].spread
            columns.append(model.error(moved) - error)
        numbers = np.linalg.lstsq(np.array(columns).T, error, rcond=None)[0]
        left[name] = np.mean((error - np.array(columns).T @ numbers) ** 2) / np.mean(error**2)
    assert left["sudden_change"] < 0.05 and left["gain_drift"] > 0.1


@pytest.mark.parametrize("share", [0.25, 0.4, 0.6])
def test_a_gain_that_jumps_is_no_drift(share):
    (found,) = identify(Actuator().joints(gain_that_jumps(share, {"k1": [1.25]}))).found
    assert "gain_drift" not in [cause.effect for cause in found.causes]
    assert max(found.shapes, key=found.shapes.get) == "time"
