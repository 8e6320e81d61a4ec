"""The two-chamber fit returns the numbers of data that the model made itself, with 1 N·m of noise on the torque."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hqpipe.actuators.two_chamber import TwoChamber
from hqpipe.errors import IdentificationError
from hqpipe.identify.constants.chamber_constants import chamber_constants
from hqpipe.identify.free_run import free_run
from hqpipe.identify.rivals.fit_chambers import fit_chambers
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

JOINTS = ("knee", "hip")
TRUTH = {
    "full_torque": [800.0, 1000.0],
    "stiffness": [22_000.0, 16_000.0],
    "flow_gain": [30.0, 20.0],
    "valve_lag": [0.0012, 0.002],
    "leakage": [3.0, 5.0],
    "null_opening": [0.004, 0.002],
    "volume_slope": [0.5, 0.35],
    "coulomb_friction": [8.0, 12.0],
    "viscous_friction": [2.0, 4.0],
}
DT, NOISE, INERTIA, DAMPING = 1e-3, 1.0, 6.0, 20.0


def machine(**changed):
    settings = {"speed_limit": np.inf, "middle": 0.0, "sample_time": DT, "effort_limit": np.inf}
    return TwoChamber.build(JOINTS, dt=DT, **(TRUTH | settings | changed))


def trial(model, seconds, seed, split):
    """A joint inertia that follows a random target and is knocked about."""
    rng = np.random.default_rng(seed)
    samples = round(seconds / DT)
    rates, phases = rng.uniform(0.5, 4.0, (4, 2)), rng.uniform(0, 2 * np.pi, (4, 2))
    t = np.arange(samples) * DT
    target = sum(np.sin(2 * np.pi * rates[i] * t[:, None] + phases[i]) for i in range(4)) * 0.12
    target = np.repeat(target[::10], 10, axis=0)[:samples]
    knock = np.repeat(rng.normal(0, 300.0, (samples // 50 + 1, 2)), 50, axis=0)[:samples]
    q, qd, tau, memory = target[:1].copy(), np.zeros((1, 2)), np.zeros((1, 2)), model.fresh_memory(1)
    log = np.empty((3, samples, 2))
    for k in range(samples):
        log[:, k] = q[0], qd[0], tau[0]
        model.step(tau, memory, target[k : k + 1], q, qd, DT)
        q = q + DT * qd
        qd = qd + DT * (tau - DAMPING * qd + knock[k]) / INERTIA
    effort = log[2] + NOISE * rng.normal(size=(samples, 2))
    return Trial(
        f"{split}.parquet", split, None, Trajectory(t, JOINTS, log[0], log[1], effort=effort, position_command=target)
    )


def log_set(trials, source):
    return LogSet(Path("synthetic"), "", "hqpipe-log/1", None, "fixed", "position", source, 1 / DT, JOINTS, trials)


LIMITS = {"position_lower": -1.0, "position_upper": 1.0}


@pytest.fixture(scope="module")
def logs():
    model = machine()
    return log_set((trial(model, 12.0, 1, "fit"), trial(model, 4.0, 2, "heldout")), "load_cell")


@pytest.fixture(scope="module")
def found(logs):
    return fit_chambers(logs, **LIMITS)


@pytest.mark.parametrize(("name", "within"), [
    ("full_torque", 0.02), ("stiffness", 0.01), ("flow_gain", 0.01), ("valve_lag", 0.03), ("leakage", 0.03),
    ("null_opening", 0.1), ("volume_slope", 0.1), ("coulomb_friction", 0.1), ("viscous_friction", 0.1),
])  # fmt: skip
def test_parameter_returns(found, name, within):
    for fit, truth in zip(found.fits, TRUTH[name], strict=True):
        assert fit[name].identifiable and not fit[name].at_bound
        assert fit[name].value == pytest.approx(truth, rel=within)


def test_free_run_is_as_good_as_the_sensor(found, logs):
    t = logs.heldout[0].trajectory
    error = free_run(t, found.model) - t.effort
    assert np.sqrt(np.mean(error**2)) < 1.5 * NOISE  # the torque at a window's start is noisy too


def test_constants_carry_intervals_that_hold_the_truth(found):
    for j, fit in enumerate(found.fits):
        quantities = {q.name: q for q in chamber_constants(fit)}
        expected = {
            "full torque": TRUTH["full_torque"][j],
            "valve time constant": 2 * TRUTH["valve_lag"][j],
            "leakage": TRUTH["leakage"][j] / TRUTH["full_torque"][j],
            "leak time constant": TRUTH["full_torque"][j] / TRUTH["stiffness"][j] / TRUTH["leakage"][j],
        }
        for name, truth in expected.items():
            assert abs(quantities[name].value - truth) < 3.0 * quantities[name].half_width < 0.3 * truth


def test_posterior_draws_whole_machines_within_bounds(found):
    drawn = found.posterior.draw(found.model, 300, np.random.default_rng(0))
    for j, (fit, group) in enumerate(zip(found.fits, found.posterior.groups, strict=True)):
        assert group.joints == (JOINTS[j],) and group.sections == 2
        assert (drawn[:, j, :9] >= group.lower).all() and (drawn[:, j, :9] <= group.upper).all()
        truth = np.array([values[j] for values in TRUTH.values()])
        deviation = np.sqrt(np.diag(group.covariance))
        assert (deviation > 0.0).all() and (np.abs(group.mean - truth) < 5.0 * deviation).all()
        np.testing.assert_allclose(drawn[:, j, 1].std(), deviation[1], rtol=0.15)
        assert (group.scatter >= 0.99 * fit.covariance).diagonal().all()
    assert (drawn[..., 9:] == found.model.parameters[:, 9:]).all()


def test_torque_from_pressures_is_given_no_seal_friction():
    model = machine(coulomb_friction=0.0, viscous_friction=0.0)
    found = fit_chambers(log_set((trial(model, 6.0, 3, "fit"),), "pressure"), **LIMITS)
    for fit in found.fits:
        assert fit["coulomb_friction"].value == 0.0 and not fit["coulomb_friction"].identifiable
        assert fit["flow_gain"].ci95 is not None
    drawn = found.posterior.draw(found.model, 20, np.random.default_rng(0))
    assert (drawn[..., 7:9] == 0.0).all(), "what is not fitted stays"


def test_a_parameter_on_a_bound_is_left_there_by_the_posterior():
    """The hip's volume slope differs from trial to trial; the knee's is pressed against what its long range allows."""
    pair = [trial(machine(volume_slope=[0.5, slope]), 6.0, seed, "fit") for seed, slope in ((1, 0.2), (2, 0.5))]
    ranges = {"position_lower": {"knee": -3.0, "hip": -1.0}, "position_upper": {"knee": 3.0, "hip": 1.0}}
    found = fit_chambers(log_set(tuple(pair), "load_cell"), **ranges)
    pressed, free = (fit["volume_slope"] for fit in found.fits)
    assert pressed.at_bound and pressed.identifiable and not free.at_bound
    knee, hip = found.posterior.draw(found.model, 50, np.random.default_rng(0))[..., 6].T
    assert (knee == pressed.value).all() and hip.std() > 0.05


def test_a_single_window_leaves_a_machine_and_no_measurement():
    found = fit_chambers(log_set((trial(machine(), 0.101, 1, "fit"),), "load_cell"), **LIMITS)
    for fit in found.fits:
        assert not any(p.identifiable or p.ci95 for p in fit.parameters)
        assert fit["flow_gain"].value == pytest.approx(TRUTH["flow_gain"][found.fits.index(fit)], rel=0.1)
        assert chamber_constants(fit) == ()
    drawn = found.posterior.draw(found.model, 5, np.random.default_rng(0))
    assert (drawn == found.model.parameters).all()


def test_shared_parameters_of_equal_joints():
    same = machine(**{name: values[0] for name, values in TRUTH.items()})
    found = fit_chambers(log_set((trial(same, 6.0, 4, "fit"),), "load_cell"), scope="shared", **LIMITS)
    assert len(found.fits) == 1 and (found.model.parameters[0] == found.model.parameters[1]).all()
    assert found.fits[0]["stiffness"].value == pytest.approx(TRUTH["stiffness"][0], rel=0.02)


def test_same_logs_same_numbers(found, logs):
    np.testing.assert_array_equal(fit_chambers(logs, **LIMITS).model.parameters, found.model.parameters)


def test_a_resting_machine_is_refused():
    t = np.arange(2000) * DT
    still = np.zeros((2000, 2))
    effort = np.random.default_rng(0).normal(size=(2000, 2))
    rest = Trial("fit.parquet", "fit", None, Trajectory(t, JOINTS, still, still, effort=effort, position_command=still))
    with pytest.raises(IdentificationError, match="no joint moves"):
        fit_chambers(log_set((rest,), "pressure"))


def test_windows_of_five_samples_are_enough_to_begin_with():
    """Logs of 50 Hz: regressions over several samples do not fit into such a window."""
    slow = [trial(machine(), 6.0, seed, split) for seed, split in ((1, "fit"), (2, "heldout"))]
    found = fit_chambers(log_set(slow, "load_cell"), window_s=5 * DT)
    assert np.isfinite(found.model.parameters[:, :9]).all()
    t = slow[1].trajectory
    assert np.std(free_run(t, found.model) - t.effort) < 0.2 * np.std(t.effort)
