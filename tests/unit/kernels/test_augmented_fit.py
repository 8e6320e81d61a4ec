"""The windowed fit finds the numbers that an independent loop planted."""

from __future__ import annotations

import numpy as np
import pytest
from augmented_rows import STEPS, planted, row, signals_of

from hqpipe.effects import EFFECTS
from hqpipe.effects.layout import FIELDS, WIDTH, slot, slots
from hqpipe.gap.joint_data import cut
from hqpipe.kernels.augmented_columns import ALL
from hqpipe.kernels.augmented_fit import CHANGES, fit_windows, multiply_physics, residual_windows
from hqpipe.kernels.augmented_signals import make_work
from hqpipe.kernels.augmented_windows import simulate

ALONE = np.empty((len(FIELDS), 0), dtype=np.int64)  # nothing is tied to anything
BASE = [slot("base", name) for name in planted.GAINS]
# Shape parameters and small effects are told less sharply by 6 s of log with 3 N·m of noise.
LOOSE = {"limit": 0.15, "rounding": 1.0, "asymmetry_nm": 0.4, "presliding_rad": 0.3, "velocity_rad_s": 0.25}
LOOSE |= {"recovery_s": 0.15}
START = 0.6  # of the truth
NEAR = {"integral_action": 1.2}  # a limit that is not reached has no gradient, so it begins tight


def fitted(effect, signals, outlier=np.inf, iterations=40):
    true = row({effect: planted.TYPICAL[effect]} if effect else {})
    own = [at for at in (slots(effect) if effect else []) if true[at] != 0.0]  # of the rest nothing can be told
    free = np.array([*BASE, *own])
    begin = true.copy()
    begin[BASE] *= 0.9
    begin[free[4:]] *= NEAR.get(effect, START)
    scale = np.abs(true[free])
    lower = np.where(true[free] >= 0.0, 0.0, -np.inf)
    upper = np.where(np.arange(len(free)) == 1, 1.0, np.inf)
    found = fit_windows(begin, signals, free, lower, upper, scale, ALONE, CHANGES, outlier, iterations, 1e-7)
    return found, true, free


@pytest.mark.parametrize("effect", planted.TYPICAL)
def test_planted_numbers_are_recovered(effect):
    signals = signals_of(effect, noise=3.0, seconds=6.0)
    (p, loss, _, residuals), true, _ = fitted(effect, signals)
    for column, parameter in zip(slots(effect), EFFECTS[effect].parameters, strict=True):
        assert p[column] == pytest.approx(true[column], rel=LOOSE.get(parameter.name, 0.06)), parameter.name
    assert p[BASE[0]] == pytest.approx(true[BASE[0]], rel=0.06)
    assert p[BASE[2]] == pytest.approx(true[BASE[2]], rel=0.06)
    assert loss == pytest.approx(np.mean(residual_windows(p, signals) ** 2))
    # from what each step left standing; what an integrator holds is sought from where the last search ended
    np.testing.assert_allclose(residuals, residual_windows(p, signals), rtol=0.0, atol=1e-6)
    assert loss < 1.05 * np.mean(residual_windows(true, signals) ** 2)


def test_exchange_of_oil_shows_where_the_supply_sags():
    sizes = {name: dict(planted.TYPICAL[name]) for name in ("supply_droop", "position_dependent_stiffness")}
    sizes["position_dependent_stiffness"] |= {"exchange": 0.05, "compression": 0.3}
    data = planted.trajectory(planted.simulate(8.0, [sizes] * 3, 0.0, 5))
    signals = cut([data], 0, "position", STEPS).signals
    true, at = row(sizes), [slot("position_dependent_stiffness", name) for name in ("exchange", "compression")]
    begin, free = true.copy(), np.array([*BASE, *at])
    begin[at] *= START
    upper = np.full(6, np.inf)
    p, *_ = fit_windows(begin, signals, free, np.zeros(6), upper, np.abs(true[free]), ALONE, CHANGES, np.inf, 30, 1e-9)
    assert p[at] == pytest.approx([1.0 / 0.05, 0.3], rel=0.05)


def test_sound_joint_gives_its_gains():
    (p, loss, hessian, _), true, _ = fitted(None, signals_of(None, noise=3.0, seconds=6.0))
    np.testing.assert_allclose(p[BASE][:3], true[BASE][:3], rtol=0.02)
    assert loss < 3.0**2 * 2.2, "the noise of the reading, and of the restart"
    assert hessian.shape == (4, 4) and np.linalg.eigvalsh(hessian).min() > 0.0


def test_start_and_data_are_left_alone_and_the_rest_of_the_row_stays():
    signals = signals_of("valve_lag", noise=3.0, seconds=6.0)
    target = signals.target.copy()
    begin = row({"valve_lag": {"time_constant_s": 0.004}, "torque_bias": {"nm": 1.0}})
    copy = begin.copy()
    free = np.array([*BASE, slots("valve_lag")[0]])
    bounds = np.zeros(5), np.full(5, np.inf)
    p, *_ = fit_windows(begin, signals, free, *bounds, np.abs(begin[free]), ALONE, CHANGES, np.inf, 3, 1e-4)
    np.testing.assert_array_equal(begin, copy)
    np.testing.assert_array_equal(signals.target, target)
    held = np.setdiff1d(np.arange(WIDTH), free)
    np.testing.assert_array_equal(p[held], begin[held])
    assert not np.array_equal(p[free], begin[free])


def test_slopes_through_the_lag_of_a_rubbing_piston_are_those_of_whole_runs():
    """They are taken from the slope of the lag alone, so that no other number has all inputs computed anew."""
    signals = signals_of("viscous_friction")
    p = row({"viscous_friction": {"nm_s_per_rad": 25.0, "behind_piston": 0.25}})
    free = np.array([*BASE, *slots("viscous_friction")])
    scale = 0.1 * np.abs(p[free]) + 1e-9
    _, _, hessian, _ = fit_windows(
        p, signals, free, np.zeros(6), np.full(6, np.inf), scale, ALONE, CHANGES, np.inf, 1, 1e-4
    )
    base, slopes = residual_windows(p, signals), []
    for column, size in zip(free, scale, strict=True):
        moved = p.copy()
        moved[column] += 1e-4 * size
        slopes.append((residual_windows(moved, signals) - base).ravel() / (1e-4 * size))
    expected = np.array(slopes) @ np.array(slopes).T
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(hessian / np.outer(size, size), expected / np.outer(size, size), atol=1e-4)


def test_bounds_hold():
    signals = signals_of("valve_lag", noise=3.0, seconds=6.0)
    begin = row({"valve_lag": {"time_constant_s": 0.003}})
    free = np.array([*BASE, slots("valve_lag")[0]])
    upper = np.array([np.inf, 1.0, np.inf, np.inf, 0.005])  # the truth is 12 ms
    p, *_ = fit_windows(begin, signals, free, np.zeros(5), upper, np.abs(begin[free]), ALONE, CHANGES, np.inf, 30, 1e-6)
    assert p[free[-1]] == 0.005


def test_gross_errors_count_linearly():
    signals = signals_of(None, noise=3.0, seconds=6.0)
    target = signals.target.copy()
    target[50::37, ::5] += 2000.0
    spoilt = signals._replace(target=target)
    truth = row({})[BASE]
    robust = fitted(None, spoilt, outlier=20.0)[0][0][BASE]
    plain = fitted(None, spoilt)[0][0][BASE]
    np.testing.assert_allclose(robust[:3], truth[:3], rtol=0.06)
    assert np.abs(plain[:3] / truth[:3] - 1.0).max() > 2.0 * np.abs(robust[:3] / truth[:3] - 1.0).max()


def test_runaway_start_ends_with_a_loss_that_says_so():
    signals = signals_of(None)
    begin = row({}, k1=1e6, k4=1e6)
    free = np.array(BASE)
    _, loss, hessian, _ = fit_windows(
        begin, signals, free, np.zeros(4), np.full(4, np.inf), np.ones(4), ALONE, CHANGES, np.inf, 3, 1e-4
    )
    assert not loss < 1e6 and np.isfinite(hessian).all()


@pytest.mark.parametrize("column", [i for i, (owner, _) in enumerate(FIELDS) if owner != "setting"])
def test_what_a_change_makes_necessary_is_enough(column):
    """The fit computes anew only what `CHANGES` says; anything more would make its slopes wrong."""
    owner, name = FIELDS[column]
    signals = signals_of("valve_lag")
    begin = row({k: v for k, v in planted.TYPICAL.items() if k != "integral_action"})
    moved = begin.copy()
    moved[column] = begin[column] * 1.01 if begin[column] else 1e-3
    work = make_work(signals)
    partly, anew = np.empty((2, signals.steps, len(signals.first)))
    simulate(begin, signals, work, partly, ALL)
    simulate(moved, signals, work, partly, CHANGES[column])
    simulate(moved, signals, make_work(signals), anew, ALL)
    np.testing.assert_allclose(partly, anew, atol=1e-9, err_msg=f"{owner} {name}")


def test_tied_columns_grow_by_one_factor():
    """A joint whose k1, k2, k3 and k4 are all 0.8 of what the fit begins with; leakage alone is lower still."""
    signals = signals_of(None, noise=3.0, seconds=6.0)
    truth = row({})
    begin = truth.copy()
    multiply_physics(begin, np.array([BASE[1]]), 1.0 / 0.7)
    multiply_physics(begin, np.array(BASE), 1.0 / 0.8)
    free = np.array([BASE[1], BASE[2]])
    tied = np.array([[BASE[1], -1, -1, -1], BASE])
    p, *_ = fit_windows(
        begin, signals, free, np.zeros(2), np.full(2, np.inf), 0.1 * begin[free], tied, CHANGES, np.inf, 30, 1e-7
    )
    np.testing.assert_allclose(p[BASE] / truth[BASE], 1.0, rtol=0.02)
    shared = p[BASE] / begin[BASE]
    np.testing.assert_allclose(shared[[0, 3]], shared[2], rtol=1e-12)


def test_more_leakage_takes_more_within_the_sample():
    """An exact sample of τ' = a − x τ: a part of what comes in leaks away before the sample ends."""
    then, now = row({}), row({})
    multiply_physics(now, np.array([BASE[1], -1]), 1.8)
    decay = -np.log(1.0 - then[BASE[1]])
    assert now[BASE[1]] == pytest.approx(1.0 - np.exp(-1.8 * decay))
    kept = [(1.0 - np.exp(-x)) / x for x in (decay, 1.8 * decay)]
    np.testing.assert_allclose(now[[BASE[0], BASE[2], BASE[3]]] / then[[BASE[0], BASE[2], BASE[3]]], kept[1] / kept[0])
    none = row({}, k2=0.0)
    multiply_physics(none, np.array(BASE), 2.0)
    np.testing.assert_allclose(none[BASE], 2.0 * row({}, k2=0.0)[BASE])
