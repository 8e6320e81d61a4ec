"""Windows of an actuator with effects, against the plain kernel and against independent numpy data."""

from __future__ import annotations

import numpy as np
import pytest
from machine.augmented_rows import ALONE, EXACT, STEPS, planted, row, signals_of, trial
from machine.signal_windows import windows_of
from scipy.signal import lfilter

from hqpipe.actuators.loops.actuator_step import HYDRAULIC
from hqpipe.actuators.loops.free_run import free_run
from hqpipe.logs.trajectory import Trajectory
from hqpipe.machine import EFFECTS
from hqpipe.machine.chain import residual_windows
from hqpipe.machine.compose.shared import remembered
from hqpipe.machine.layout import slot

# What a window finds by bisection (integrator), solves by two rounds (friction under load) or reads between
# samples (skew) stays small against the torque of 300 N·m.
LEFT = {"integral_action": 1e-3, "load_dependent_friction": 1.0, "channel_skew": 0.1}
IN_THE_LOOP = [name for name, effect in EFFECTS.items() if effect.blocks and not effect.multiplies]


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def predicted(p, signals):
    return residual_windows(p, signals) + signals.target[1:]


def test_row_without_effects_is_the_plain_model():
    t = trial()
    gains = np.array([[*planted.GAINS.values(), 1.0, 400.0]] * len(t.joints))
    p = row({})
    p[slot("setting", "effort_limit")] = 400.0
    expected = free_run(HYDRAULIC, gains, t.effort, t.position_command, t.position, t.velocity, STEPS)
    for j in (0, 3, len(t.joints) - 1):
        signals = windows_of([t], j, STEPS, logged_speed=True)
        at = signals.first[None, :] + np.arange(1, STEPS + 1)[:, None]
        np.testing.assert_allclose(predicted(p, signals), expected[at, j], atol=EXACT)
    assert np.abs(expected).max() == 400.0, "the limit must be reached"


@pytest.mark.parametrize("effect", planted.TYPICAL)
def test_its_own_row_predicts_independent_data(effect):
    signals = signals_of(effect)
    left = rms(residual_windows(row({effect: planted.TYPICAL[effect]}), signals))
    base = rms(residual_windows(row({}), signals))
    assert left < LEFT.get(effect, EXACT)
    assert base > 4.0 and base > 20.0 * left


@pytest.mark.parametrize(
    "others", [(), ("valve_deadband",), ("direction_asymmetry",), ("position_dependent_stiffness",)]
)
def test_an_integrator_that_ran_before_the_log_began_is_found_where_it_stands(others):
    """The same with effects that bend the opening or its flow, so that the balance of a linear valve would be wrong."""
    effects = {name: planted.TYPICAL[name] for name in ("integral_action", *others)}
    late = planted.trajectory(planted.simulate(6.0, [effects], 0.0, 9)).section(2000, 6000)
    signals = windows_of([late], 0, STEPS)
    rest = row({name: planted.TYPICAL[name] for name in others})
    assert rms(residual_windows(row(effects), signals)) < 1e-3 < 1e-4 * rms(residual_windows(rest, signals))


@pytest.mark.parametrize("offset", ["position_bias", "torque_bias"])
def test_an_integrator_that_reaches_no_limit_takes_up_an_offset(offset):
    """So no log of such a joint says anything of it, and the score of the diagnosis does not ask for it. Impacts, which k4
    makes a product of torque and opening, would show a little of an offset of the torque."""
    errors = []
    for integrator in ({"ki": 0.5}, planted.TYPICAL["integral_action"]):
        effects = {"integral_action": integrator, offset: planted.TYPICAL[offset]}
        late = planted.trajectory(planted.simulate(6.0, [effects], 0.0, 9, gains={"k4": [0.0]})).section(2000, 6000)
        alone = row({"integral_action": integrator}, k4=0.0)
        errors.append(rms(residual_windows(alone, windows_of([late], 0, STEPS))))
    assert errors[0] < 1e-3 < 1e-3 * errors[1]


def test_an_integrator_without_a_limit_is_found_at_every_gain():
    """Where more of a start is always worth as much, the search for it may meet it to the last bit, and then ends."""
    effects = {"integral_action": {"ki": 0.05}, "orifice_flow": planted.TYPICAL["orifice_flow"]}
    late = planted.trajectory(planted.simulate(6.0, [effects], 0.0, 9)).section(2000, 6000)
    signals, p, errors = windows_of([late], 0, STEPS), row(effects, k4=0.0), []
    for gain in np.linspace(0.045, 0.055, 1500):
        p[slot("integral_action", "ki")] = gain
        errors.append(rms(residual_windows(p, signals)))
    assert np.max(errors) < 1.2 * np.min(errors)


def test_an_integrator_is_found_where_it_stands_on_a_sagging_supply():
    effects = {name: planted.TYPICAL[name] for name in ("integral_action", "supply_droop")}
    late = planted.trajectory(planted.simulate(6.0, [effects] * 3, 0.0, 9)).section(2000, 6000)
    signals = windows_of([late], 0, STEPS)
    rest = row({"supply_droop": planted.TYPICAL["supply_droop"]})
    after = slice(round(5 * planted.TYPICAL["supply_droop"]["recovery_s"] / planted.DT) // STEPS, None)
    left, without = (residual_windows(p, signals)[:, after] for p in (row(effects), rest))
    assert rms(left) < 0.03 * rms(without)


def some_of(signals, windows):
    return signals._replace(first=signals.first[windows], target=np.ascontiguousarray(signals.target[:, windows]))


@pytest.mark.parametrize("effect", ["coulomb_friction", "stribeck_friction", "load_dependent_friction", "backlash"])
@pytest.mark.parametrize("windows", [[25], [3, 4, 11, 30], [30, 11, 4]])
def test_a_window_does_not_hang_on_which_others_there_are(effect, windows):
    """What friction and slack remember of the log before it is the same, from wherever it is followed."""
    signals, p = signals_of(effect), row({effect: planted.TYPICAL[effect]})
    whole = residual_windows(p, signals)[:, windows]
    np.testing.assert_allclose(residual_windows(p, some_of(signals, windows)), whole, atol=1e-6)


@pytest.mark.parametrize("effect", ["coulomb_friction", "position_dependent_stiffness", "backlash"])
def test_a_trial_does_not_hang_on_which_others_there_are(effect):
    """More of them, and of other lengths, than are followed side by side."""
    ends = [(0, 1200), (1200, 1900), (500, 4000), (2000, 2500), (0, 900), (900, 3000)]
    trials = [trial().section(first, last) for first, last in ends]
    p, j = row({effect: planted.TYPICAL[effect]}), ALONE.index(effect)
    alone = [residual_windows(p, windows_of([t], j, STEPS)) for t in trials]
    np.testing.assert_array_equal(residual_windows(p, windows_of(trials, j, STEPS)), np.concatenate(alone, axis=1))


@pytest.mark.parametrize("effect", ["coulomb_friction", "stribeck_friction", "load_dependent_friction"])
def test_what_friction_has_forgotten_is_not_followed(effect):
    """A long log costs no more than what leads to its windows: what lies further back may be anything."""
    signals, p = signals_of(effect), row({effect: planted.TYPICAL[effect]})
    late = some_of(signals, [30])
    expected = residual_windows(p, late)
    effort = signals.effort.copy()
    effort[: signals.first[10]] = np.nan
    np.testing.assert_array_equal(residual_windows(p, late._replace(effort=effort)), expected)


def test_a_state_is_followed_from_where_it_must_have_been_at_an_end():
    moves = np.full(100, 0.5)
    assert remembered(moves, 0, 80) == 80 - 16, (
        "it went from end to end, whatever else moved it less than three times as far"
    )
    assert remembered(moves, 70, 80) == 70
    moves[40:] = 0.0  # a joint that rests forgets nothing
    assert remembered(moves, 0, 80) == 40 - 16
    moves[40:] = 3.0 * (-1.0) ** np.arange(60)  # nor does one that trembles
    assert remembered(moves, 0, 80) == 40 - 16 + 6


def test_effects_together_predict_independent_data():
    names = [name for name in planted.TYPICAL if name not in (*LEFT, "backlash")]
    sizes = {name: dict(planted.TYPICAL[name]) for name in names}
    sizes["flow_saturation"]["limit"] = 0.1
    data = planted.trajectory(planted.simulate(4.0, [sizes, sizes], 0.0, 5, middle=0.1))
    signals = windows_of([data], 0, STEPS, logged_speed=True)
    assert rms(residual_windows(row(sizes, middle=0.1), signals)) < EXACT
    for name in names:
        fewer = {key: value for key, value in sizes.items() if key != name}
        assert rms(residual_windows(row(fewer, middle=0.1), signals)) > 0.5, name


def test_friction_acts_at_the_speed_of_its_sample():
    """A mean speed of the step that begins at a row belongs half a sample later; a smooth motion shows it."""
    time = np.arange(2000) * planted.DT
    q, qd = 0.3 * np.sin(8.0 * time), 2.4 * np.cos(8.0 * time)
    t = planted.trajectory(planted.Planted(time, q[:, None], q[:, None], qd[:, None], np.zeros((2000, 1))))
    friction = row({"viscous_friction": {"nm_s_per_rad": 20.0}}, k1=0.0, k2=1.0, k3=0.0, k4=0.0)
    friction[slot("setting", "speed_late")] = 0.5
    means = windows_of([t], 0, STEPS)
    at = means.first[None, :] + np.arange(1, STEPS + 1)[:, None]
    np.testing.assert_allclose(predicted(friction, means), -20.0 * qd[at], atol=20.0 * 2.4 * 64.0 * planted.DT**2)


CHAIN = ("saturation", "lag", "deadband", "asymmetry", "drift", "underlap")
NAMES = {
    "lag": "valve_lag",
    "deadband": "valve_deadband",
    "saturation": "flow_saturation",
    "asymmetry": "direction_asymmetry",
    "drift": "gain_drift",
    "underlap": "valve_underlap",
}


@pytest.mark.parametrize(
    "first,second", [(0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (1, 3), (2, 3), (0, 5), (1, 5), (4, 5)]
)
def test_order_of_the_command_side(first, second):
    pair = CHAIN[first], CHAIN[second]
    sizes = {NAMES[name]: planted.TYPICAL[NAMES[name]] for name in pair}
    left = {}
    for order in (pair, pair[::-1]):
        data = planted.trajectory(planted.simulate(2.0, [sizes], 0.0, 7, order=order))
        left[order] = rms(residual_windows(row(sizes), windows_of([data], 0, STEPS)))
    assert left[pair] < EXACT
    assert left[pair[::-1]] > 1.0


@pytest.mark.parametrize("rubbing", ["coulomb_friction", "viscous_friction", "load_dependent_friction"])
def test_friction_lies_in_front_of_backlash_and_bias_behind_it(rubbing):
    sizes = {name: planted.TYPICAL[name] for name in ("backlash", rubbing, "torque_bias")}
    signals = windows_of([planted.trajectory(planted.simulate(3.0, [sizes], 0.0, 8))], 0, STEPS)
    assert rms(residual_windows(row(sizes), signals)) < 1.0
    moved = {**sizes, "torque_bias": {"nm": 0.0}}
    assert rms(residual_windows(row(moved), signals)) > 10.0


def test_slack_chain_passes_no_friction():
    time = 1e-3 * np.arange(1000)
    travel, nothing = 1e-3 * time[:, None], np.zeros((1000, 1))
    speed = np.full_like(travel, 1e-3)
    t = Trajectory(time, ("j",), travel, speed, effort=nothing, position_command=travel)
    signals = windows_of([t], 0, STEPS)
    rubbing = {"viscous_friction": {"nm_s_per_rad": 2000.0}}
    assert np.abs(predicted(row(rubbing), signals)).min() > 0.0
    assert np.abs(predicted(row({**rubbing, "backlash": {"gap": 0.1}}), signals)).max() == 0.0


def test_windows_do_not_depend_on_each_other():
    effects = {name: values for name, values in planted.TYPICAL.items() if name != "supply_droop"}
    effects["flow_saturation"] = {"limit": 0.1}
    signals = signals_of(None)
    p = row(effects)
    every = predicted(p, signals)
    kept = np.array([3, 11, 12, 30])
    fewer = signals._replace(first=signals.first[kept], target=np.ascontiguousarray(signals.target[:, kept]))
    np.testing.assert_allclose(predicted(p, fewer), every[:, kept], atol=1e-9)


def test_trials_do_not_leak_into_each_other():
    t = trial()
    alone = predicted(row(planted.TYPICAL), windows_of([t], 0, STEPS))
    both = predicted(row(planted.TYPICAL), windows_of([t, t], 0, STEPS))
    half = alone.shape[1]
    np.testing.assert_allclose(both[:, :half], alone, atol=1e-9)
    np.testing.assert_allclose(both[:, half:], alone, atol=1e-9)


@pytest.fixture(scope="module")
def smooth():
    """A joint on random smooth waves."""
    rng = np.random.default_rng(4)
    time = np.arange(2000) * 1e-3
    rates, phases = rng.uniform(1.0, 6.0, (3, 4, 1)), rng.uniform(0.0, 6.0, (3, 4, 1))
    q, effort, error = np.sin(2 * np.pi * rates * time + phases).sum(axis=1)[:, :, None]
    speed = np.gradient(0.2 * q, 1e-3, axis=0)
    return Trajectory(time, ("j",), 0.2 * q, speed, effort=60.0 * effort, position_command=0.2 * q + 0.05 * error)


@pytest.mark.parametrize("effect", IN_THE_LOOP)
def test_every_effect_changes_the_output(smooth, effect):
    signals = windows_of([smooth], 0, STEPS)
    change = predicted(row({effect: planted.TYPICAL[effect]}), signals) - predicted(row({}), signals)
    assert np.isfinite(change).all()
    assert rms(change) > 1e-3 * rms(signals.target)


def between_springs(oil, transmission, damping):
    """A log of a damped piston between two springs whose joint is hit at any time, and the row of that joint."""
    rng, fine = np.random.default_rng(4), 100
    speed = np.repeat(rng.normal(0.0, 0.3, 50), rng.multinomial(2000 * fine, np.full(50, 0.02)))
    moved = np.cumsum(speed) * planted.DT / fine
    q = moved[::fine]
    e = 0.01 * np.sin(40.0 * np.arange(2000) * planted.DT)
    flow = np.repeat(5e4 * e, fine) * planted.DT / fine
    pushed = np.concatenate([[0.0], np.cumsum(flow)[:-1]])
    drive = pushed + transmission * moved
    share = np.exp(-planted.DT / fine * (oil + transmission) / damping)
    p = lfilter([1.0 - share], [1.0, -share], drive / (oil + transmission))
    x = transmission * (p[::fine] - q)
    time = np.arange(2000) * planted.DT
    t = planted.trajectory(
        planted.Planted(time, (q + e)[:, None], q[:, None], np.gradient(q, time)[:, None], x[:, None])
    )
    left = transmission / (oil + transmission)
    model = row(
        {"viscous_friction": {"nm_s_per_rad": damping * left, "behind_piston": 1.0 - left}},
        k1=left * 5e4 * planted.DT,
        k2=0.0,
        k3=left * oil * planted.DT,
        k4=0.0,
    )
    model[slot("setting", "speed_late")] = 0.5
    return windows_of([t], 0, STEPS), model


def test_a_damped_piston_lags_behind_its_joint():
    signals, model = between_springs(40e3, 120e3, 100.0)
    assert model[slot("viscous_friction", "behind_piston")] == 0.25
    left = {}
    for behind in (0.0, 0.15, 0.25, 0.35):
        model[slot("viscous_friction", "behind_piston")] = behind
        left[behind] = rms(residual_windows(model, signals))
    assert min(left, key=left.get) == 0.25
    assert left[0.25] < 0.4 * left[0.0], "what remains: the speed between two samples in an impact"
