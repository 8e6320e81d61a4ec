"""Intervals cover the truth, also where errors are correlated in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted_logs import STEPS, data_of, logs_of, planted, size

from hqpipe.effects import EFFECTS
from hqpipe.effects.effect import SIMPLIFIED
from hqpipe.effects.layout import slot
from hqpipe.gap.estimate import SIMPLIFIED_ROWS, Z95, Estimate, agree, covariance_of, estimates, pooled, stated
from hqpipe.gap.joint_data import joint_data
from hqpipe.gap.set_fit import JointFitter

FITS = 60
SET = ("valve_deadband",)


@pytest.fixture(scope="module")
def fits():
    """60 joints with the same deadband; their torque readings wander slowly (AR(1), 30 ms) by 6 N·m."""
    run = planted.simulate(6.0, [size(*SET)] * FITS, 0.0, 11)
    rng = np.random.default_rng(0)
    white = rng.standard_normal(run.torque.shape)
    pole = np.exp(-1.0 / 30.0)
    for k in range(1, len(white)):
        white[k] = pole * white[k - 1] + np.sqrt(1.0 - pole**2) * white[k]
    t = planted.trajectory(planted.Planted(run.time, run.command, run.position, run.velocity, run.torque + 6.0 * white))
    data = [joint_data([t], [t.section(0, 1000)], j, "position", STEPS, 3.0) for j in range(FITS)]
    return [(d, JointFitter(d).fit(SET)) for d in data]


def test_intervals_cover_the_truth_in_spite_of_correlated_errors(fits):
    found = [estimates(data, fit, "valve_deadband")["half_width"] for data, fit in fits]
    covered = np.mean([e.low <= 0.02 <= e.high for e in found])
    assert covered >= 0.87, "95 % but for the scatter of 60 draws"
    values = np.array([e.value for e in found])
    assert abs(values.mean() - 0.02) < 3.0 * values.std() / np.sqrt(FITS) + 1e-4
    claimed = np.median([e.deviation for e in found])
    assert 0.7 * values.std() < claimed < 1.5 * values.std()


def test_intervals_of_independent_samples_would_be_too_narrow(fits):
    """What the block sums are for: the plain Gauss-Newton interval takes every sample for an observation."""
    covered = []
    for _, fit in fits:
        at = int(np.flatnonzero(fit.free == slot("valve_deadband", "half_width"))[0])
        half = 1.96 * np.sqrt(np.linalg.pinv(fit.hessian)[at, at] * fit.loss)
        covered.append(abs(fit.row[fit.free[at]] - 0.02) <= half)
    assert np.mean(covered) < 0.8


def test_half_a_second_is_one_observation(fits):
    data, fit = fits[0]
    found = covariance_of(data, fit)
    covariance, blocks = found.now, found.blocks
    assert len(data.fit.signals.first) == 59 and blocks == 12
    assert covariance.shape == (6, 6) and np.linalg.eigvalsh(covariance).min() > -1e-12


def test_inverse_parameters_come_in_their_own_unit():
    logs = logs_of([size("flow_saturation")], seconds=4.0)
    trials = [t.trajectory for t in logs.trials]
    data = joint_data(trials[:1], trials[1:], 0, "position", STEPS, 3.0)
    found = estimates(data, JointFitter(data).fit(("flow_saturation",)), "flow_saturation")["limit"]
    assert found.low < found.value < found.high
    assert found.low <= 0.06 <= found.high and found.value == pytest.approx(0.06, rel=0.03)


def test_what_lies_at_absent_is_left_out():
    logs = logs_of([{}], seconds=4.0)
    trials = [t.trajectory for t in logs.trials]
    data = joint_data(trials[:1], trials[1:], 0, "position", STEPS, 3.0)
    fit = JointFitter(data).fit(("flow_saturation",))
    fit.row[slot("flow_saturation", "limit")] = 0.0
    assert "limit" not in estimates(data, fit, "flow_saturation")


def test_droop_comes_as_loss_per_speed():
    logs = logs_of([size("supply_droop")] * 3, seconds=6.0)
    trials = [t.trajectory for t in logs.trials]
    data = joint_data(trials[:1], trials[1:], 0, "position", STEPS, 3.0)
    found = estimates(data, JointFitter(data).fit(("supply_droop",)), "supply_droop")
    assert found["droop"].value == pytest.approx(0.1, rel=0.1)
    assert found["recovery_s"].value == pytest.approx(0.15, rel=0.2)


def parts(*values, deviation=0.1):
    return [Estimate(v, v - 1.96 * deviation, v + 1.96 * deviation, deviation) for v in values]


def test_pooled_value_is_weighted_and_narrower():
    same = pooled(parts(1.0, 1.05, 0.95, 1.0))
    assert same.value == pytest.approx(1.0) and same.deviation == pytest.approx(0.05)
    assert same.high - same.low == pytest.approx(2 * 1.96 * 0.05)
    sharp = Estimate(2.0, 1.98, 2.02, 0.01)
    assert pooled([*parts(1.0), sharp]).value == pytest.approx(2.0, abs=0.02)


def test_joints_that_disagree_widen_the_interval():
    wide, narrow = pooled(parts(0.0, 1.0, 2.0)), pooled(parts(1.0, 1.0, 1.0))
    assert wide.deviation > 5.0 * narrow.deviation
    assert wide.low < 1.0 < wide.high


def test_stated_interval_holds_what_the_formula_simplifies():
    narrow = Estimate(0.002, 0.00199, 0.00201, 0.000005)
    slope, delay = (EFFECTS[name].parameters[0] for name in ("position_dependent_stiffness", "command_delay"))
    share, rows = stated(narrow, slope, 1e-3), stated(narrow, delay, 1e-3)
    assert share.value == rows.value == narrow.value
    assert share.high - share.value == pytest.approx(np.hypot(1e-5, Z95 * SIMPLIFIED * 0.002))
    model = np.hypot(SIMPLIFIED * 0.002, SIMPLIFIED_ROWS * 1e-3)
    assert rows.value - rows.low == pytest.approx(np.hypot(1e-5, Z95 * model))
    wide = Estimate(1.0, 0.2, 3.0, 0.5)
    assert stated(narrow, replace(slope, simplified=0.1), 1e-3).low == pytest.approx(
        0.002 * (1.0 - 0.1 * Z95), rel=1e-3
    )
    assert stated(wide, slope, 1e-3).high == pytest.approx(3.0, rel=1e-3), "noise that is larger stays as it is"


def test_agreement_is_within_a_quarter_or_within_the_intervals():
    assert agree(parts(1.0, 1.2, 0.8, deviation=1e-3))
    assert not agree(parts(1.0, 1.0, 1.5, deviation=1e-3))
    assert agree(parts(1.0, 1.0, 1.5, deviation=0.5))
    assert not agree(parts(1.0, -1.0, 1.0, deviation=0.1)), "either sign is not one value"


def test_fit_that_would_run_away_has_no_interval():
    data = data_of(logs_of([size("command_delay")], seconds=6.0))
    fit = JointFitter(data).fit(("command_delay",))
    assert "delay_s" in estimates(data, fit, "command_delay")
    row = fit.row.copy()
    row[slot("base", "k2")] = -1e4  # a torque that grows ten thousandfold each sample
    assert estimates(data, replace(fit, row=row), "command_delay") == {}
