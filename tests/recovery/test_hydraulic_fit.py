"""Known k1 … k4 are recovered from closed-loop data with torque noise; the paper's one-step fit is biased."""

from __future__ import annotations

import numpy as np
import pytest
from hydraulic_truth import RADIUS, TRUTH, log_set, simulate

from hqpipe.identify.paper_model.fit_actuator import fit_actuator
from hqpipe.identify.rivals.compare import compare_models

NOISE = 12.0  # N·m, on torques of 230 N·m RMS
KNOWN = np.array(list(TRUTH.values()))


def table(result, pick):
    return np.array([[pick(c) for c in fit.coefficients] for fit in result.fits])


@pytest.fixture(scope="module")
def noisy():
    """Six joints of the same make, two fit trials and a held-out one."""
    trials = [simulate(10.0, 6, NOISE, seed) for seed in (1, 2, 3)]
    logs = log_set(trials, ["fit", "fit", "heldout"])
    return logs, fit_actuator(logs, sprocket_radius=RADIUS)


def test_noise_free_data_give_the_exact_coefficients():
    result = fit_actuator(log_set([simulate(4.0, 2, 0.0, 5)], ["fit"]), sprocket_radius=RADIUS)
    np.testing.assert_allclose(table(result, lambda c: c.value), np.tile(KNOWN, (2, 1)), rtol=1e-6)
    assert result.warnings == ()


def test_free_running_fit_recovers_the_truth(noisy):
    ratio = table(noisy[1], lambda c: c.value) / KNOWN
    np.testing.assert_allclose(ratio[:, :3], 1.0, atol=0.01)
    np.testing.assert_allclose(ratio[:, 3], 1.0, atol=0.05)


def test_one_step_fit_is_biased_and_free_run_is_not(noisy):
    one_step = table(noisy[1], lambda c: c.one_step).mean(axis=0) / KNOWN - 1.0
    free = table(noisy[1], lambda c: c.value).mean(axis=0) / KNOWN - 1.0
    assert (one_step > 0.08).all(), "torque noise on both sides must inflate every coefficient"
    assert (np.abs(free) < 0.1 * one_step).all()


def test_shared_fit_is_tighter_and_as_right(noisy):
    logs, single = noisy
    shared = fit_actuator(logs, sprocket_radius=RADIUS, scope="shared")
    assert len(shared.fits) == 1 and shared.fits[0].joint == "all"
    np.testing.assert_allclose(table(shared, lambda c: c.value)[0] / KNOWN, 1.0, atol=0.015)
    width = table(single, lambda c: c.ci95[1] - c.ci95[0]).mean(axis=0)
    assert (table(shared, lambda c: c.ci95[1] - c.ci95[0])[0] < 0.8 * width).all()
    assert (shared.model.parameters == shared.model.parameters[0]).all()


def test_sprocket_radius_only_changes_units(noisy):
    logs, single = noisy
    plain = fit_actuator(logs)
    r2 = RADIUS**2
    expected = single.model.parameters[:, :4] * [r2, 1.0, r2, RADIUS]
    np.testing.assert_allclose(plain.model.parameters[:, :4], expected, rtol=1e-5)


def test_noise_floor_finds_the_noise(noisy):
    for fit in noisy[1].fits:
        assert fit.noise == pytest.approx(NOISE, rel=0.1)


def test_held_out_errors_reach_the_noise_and_beat_the_baselines(noisy):
    logs, result = noisy
    rows = compare_models(logs, {"free run": result.model, "one step": result.one_step_model})
    pooled = {row.model: row for row in rows if row.joint == "all" and row.trial == "all"}
    assert pooled["free run"].free_run.rmse < 1.15 * NOISE
    assert pooled["free run"].free_run.rmse < pooled["one step"].free_run.rmse
    assert pooled["persistence"].free_run.rmse > 5 * NOISE
    assert pooled["free run"].free_run_skill > 0.8
    assert pooled["stiff PD (fitted gains)"].free_run.rmse > 2 * NOISE


def test_held_out_trials_never_touch_the_fit(noisy):
    logs, result = noisy
    trials = [simulate(10.0, 6, NOISE, seed) for seed in (1, 2)] + [simulate(10.0, 6, 300.0, 9)]
    other = fit_actuator(log_set(trials, ["fit", "fit", "heldout"]), sprocket_radius=RADIUS)
    np.testing.assert_array_equal(other.model.parameters, result.model.parameters)


def test_intervals_cover_the_truth():
    """80 independent joints: intervals that miss more than 9 times are no 95 % intervals (p < 1 %)."""
    result = fit_actuator(log_set([simulate(8.0, 80, NOISE, 21)], ["fit"]), sprocket_radius=RADIUS)
    low, high = table(result, lambda c: c.ci95[0]), table(result, lambda c: c.ci95[1])
    hits = ((low <= KNOWN) & (KNOWN <= high)).sum(axis=0)
    assert (hits >= 71).all(), hits
    spread = table(result, lambda c: c.value).std(axis=0)
    assert ((high - low).mean(axis=0) < 8 * spread).all(), "intervals must not be wide for safety's sake"


def test_a_gross_sensor_glitch_does_not_move_the_fit():
    t, target, q, qd, torque = simulate(10.0, 2, 2.0, 4)
    struck = torque.copy()
    struck[np.random.default_rng(0).integers(0, len(t), 30)] += 5000.0
    clean, hit = (
        fit_actuator(log_set([(t, target, q, qd, y)], ["fit"]), sprocket_radius=RADIUS) for y in (torque, struck)
    )
    np.testing.assert_allclose(hit.model.parameters[:, :3], clean.model.parameters[:, :3], rtol=0.03)


def test_no_impacts_no_k4():
    """A gently moved joint under a constant load never opposes torque and error: k4 stays unknown."""
    logs = log_set([simulate(6.0, 2, 1.0, 8, motion=0.005, knocks=0.0)], ["fit"])
    result = fit_actuator(logs, sprocket_radius=RADIUS)
    for fit in result.fits:
        assert not fit["k4"].identifiable and fit["k4"].value is None
        assert "k4 needs trials with impacts" in fit["k4"].reason
        assert fit["k1"].value == pytest.approx(TRUTH["k1"], rel=0.1)
    assert (result.model.column("k4") == 0.0).all()
    assert any("k4 is not identifiable" in text for text in result.warnings)
