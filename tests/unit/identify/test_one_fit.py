"""What holds of every fit: it is a function of data, free parameters and bounds alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identify.small_logs import log_set, trajectory
from identify.toy_joint import ToyJoint

from hqpipe.actuators.loops.chamber_windows import replay
from hqpipe.actuators.two_chamber import TwoChamber
from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.model import positions
from hqpipe.identify.paper_model.problem import Problem
from hqpipe.identify.rivals.chamber_model import PARAMETERS, ChamberModel, fitted
from hqpipe.identify.windows import cut_windows, joint_data

GAINS = np.array([400.0, 0.04, 8.0, 0.3])
CHAMBER = np.array([400.0, 9000.0, 25.0, 2e-3, 2.0, 1e-3, 0.3, 5.0, 10.0])
SETTINGS = np.array([[np.inf, 0.0, 1e-3, np.inf]])
LOW, HIGH = np.array([1e-3, 1e-3, 1e-3, 1e-4, 0, 0, 0, 0, 0]), np.array([np.inf] * 3 + [0.05] + [np.inf] * 5)
ALL, EVERY = np.ones(4, bool), np.ones(len(PARAMETERS), bool)


def logs(noise=5.0, samples=2001):
    """One joint whose torque obeys eq. (7), with noise."""
    trial = trajectory(samples, ("hip",))
    error, torque = (trial.position_command - trial.position)[:, 0], np.zeros(samples)
    for k in range(samples - 1):
        h = error[k] * max(-torque[k] * np.sign(error[k]), 0.0)
        torque[k + 1] = torque[k] + GAINS @ [error[k], -torque[k], -trial.velocity[k, 0], h]
    torque += noise * np.random.default_rng(0).normal(size=samples)
    return log_set(replace(trial, effort=torque[:, None]), splits=["fit"]).fit


def paper(trials, **changes):
    data = replace(joint_data(trials, "hip"), **changes)
    return Problem([data], cut_windows(trials, 0.1), np.ones(1), np.full(1, np.inf))


def chambers(trials, **changes):
    data = replace(joint_data(trials, "hip"), **changes)
    return ChamberModel([data], cut_windows(trials, 0.1), SETTINGS, LOW, HIGH)


def chamber_logs():
    """One joint whose torque is that of two chambers, with noise."""
    trials = logs()
    data, torque = joint_data(trials, "hip"), np.zeros(2001)
    row = np.concatenate([CHAMBER, SETTINGS[0]])
    bounds, fresh = np.array([[0, 2000]]), np.ones(1, bool)
    replay(row, np.zeros(2001), data.command, data.command - data.error, data.velocity, bounds, fresh, torque)
    torque += np.random.default_rng(1).normal(size=2001)
    return log_set(replace(trials[0].trajectory, effort=torque[:, None]), splits=["fit"]).fit


def paper_fit(problem, free=ALL):
    return problem.fit(free, problem.starts(free))


def test_a_set_is_never_worse_than_its_parts():
    trials = logs()
    whole = paper_fit(paper(trials)).cost
    for part in (ALL & (np.arange(4) != 3), ALL & (np.arange(4) != 2), ALL & (np.arange(4) < 2)):
        assert whole <= paper_fit(paper(trials), part).cost * (1.0 + 1e-9)
    model = chambers(chamber_logs())
    whole = fitted(model, EVERY, [CHAMBER]).square
    for out in ([7], [8], [5], [7, 8]):
        part, start = EVERY & ~np.isin(np.arange(len(EVERY)), out), CHAMBER.copy()
        start[out] = 0.0
        assert whole <= fitted(model, part, [start]).square * (1.0 + 1e-5)  # the tolerance of a fit with differences


def test_what_was_fitted_before_makes_no_difference():
    trials = logs()
    problem = paper(trials)
    paper_fit(problem, ALL & (np.arange(4) != 3))
    problem.window_errors(2.0 * GAINS)
    np.testing.assert_array_equal(paper_fit(problem).values, paper_fit(paper(trials)).values)
    trials = chamber_logs()
    model = chambers(trials)
    fitted(model, EVERY & (np.arange(len(EVERY)) != 3), [1.2 * CHAMBER])
    np.testing.assert_array_equal(
        fitted(model, EVERY, [CHAMBER]).values, fitted(chambers(trials), EVERY, [CHAMBER]).values
    )
    joint = ToyJoint(truth={"coulomb_friction": 0.3})
    fitter, free = Fitter(joint), positions(joint, ["coulomb_friction"])
    fitter.fit(positions(joint, ["spring", "viscous_friction"]), [fitter.neutral], 0.1)
    again = fitter.fit(free, [fitter.neutral], 0.0)
    np.testing.assert_array_equal(again.values, Fitter(joint).fit(free, [fitter.neutral], 0.0).values)


def test_more_starts_are_never_worse():
    problem = paper(logs())
    far = [GAINS * scale for scale in ([0.3, 2.0, 1.0, 0.0], [2.0, 0.5, 3.0, 1.0])]
    together = problem.fit(ALL, far).cost
    assert together <= min(problem.fit(ALL, [start]).cost for start in far) * (1.0 + 1e-6)


@pytest.mark.parametrize("outlier", [np.inf, 4.0])
def test_exact_sensitivities_are_those_of_differences(outlier):
    """The slope of what is left once every start torque is as good as can be."""
    problem = paper(logs())
    problem.start_weight[:], problem.outlier[:] = 3.0, outlier
    none, at = np.zeros(4, bool), GAINS * [1.05, 0.95, 1.02, 0.9]
    slope = problem.fit(none, [at]).at.gradient
    for i in range(4):
        step = 1e-4 * at[i] * np.eye(4)[i]
        ahead, behind = (problem.fit(none, [at + sign * step]).cost for sign in (1.0, -1.0))
        assert slope[i] == pytest.approx((ahead - behind) / (4.0 * step[i]), rel=1e-2)


def test_normal_equations_of_the_chambers_are_those_of_their_cost():
    model = chambers(chamber_logs())
    model.outlier[:] = 2.5
    solution = fitted(model, EVERY, [CHAMBER])
    slope = model.at(solution).gradient
    known = np.sqrt(np.diag(model.at(solution).hessian))
    assert (np.abs(slope[known > 0] / known[known > 0]) < 0.05 * np.sqrt(solution.square)).all()
    stiffer = solution.values * np.where(np.arange(len(EVERY)) == 1, 1.02, 1.0)
    fitter = Fitter(model)
    error = fitter.error(stiffer)
    jacobian = fitter.jacobian(stiffer, error, np.array([1]), np.array([1.0]))
    ahead, behind = (np.sum(fitter.error(stiffer + s * np.eye(len(EVERY))[1]) ** 2) for s in (5.0, -5.0))
    assert jacobian[:, 0] @ error == pytest.approx((ahead - behind) / 20.0, rel=2e-2)


def test_masked_samples_change_nothing():
    trials = logs()
    data = joint_data(trials, "hip")
    weight = np.ones(len(data.effort))
    weight[[50, 51, 220, 300, 777, 1000, 2000]] = 0.0  # 300 and 1000 start a window
    spoiled = np.where(weight > 0.0, data.effort, 1e5)
    one, other = paper(trials, weight=weight), paper(trials, weight=weight, effort=spoiled)
    np.testing.assert_array_equal(paper_fit(one).values, paper_fit(other).values)
    np.testing.assert_array_equal(one.window_errors(GAINS)[0], other.window_errors(GAINS)[0])
    assert not np.array_equal(paper_fit(one).values, paper_fit(paper(trials)).values)
    last = np.ones(len(weight))
    last[2000] = 0.0  # nothing of the chambers' memory follows from it
    one, other = (chambers(trials, weight=last, effort=e) for e in (data.effort, np.where(last > 0, data.effort, 1e5)))
    np.testing.assert_array_equal(one.error(CHAMBER), other.error(CHAMBER))
    assert len(chambers(trials, weight=weight).error(CHAMBER)) == 2000 - 7 - 200


def test_a_sample_that_counts_twice_is_one_that_was_there_twice():
    trials = logs()
    double = paper(trials, weight=np.full(2001, 2.0))
    problem = paper(trials)
    twice = Problem([joint_data(trials, "hip")] * 2, problem.windows, np.ones(2), np.full(2, np.inf))
    np.testing.assert_allclose(paper_fit(double).values, paper_fit(twice).values, rtol=1e-6)


def test_the_unit_of_the_torque_scales_the_gains():
    trials = logs()
    data = joint_data(trials, "hip")
    kilo = paper_fit(paper(trials, effort=1e-3 * data.effort)).values
    np.testing.assert_allclose(kilo, paper_fit(paper(trials)).values * [1e-3, 1.0, 1e-3, 1.0], rtol=1e-5)


def test_the_names_of_the_chambers_are_those_of_the_model():
    assert set(PARAMETERS) < set(TwoChamber.FIELDS) and len(PARAMETERS) == len(CHAMBER)
