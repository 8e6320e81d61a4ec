"""Error measures, noise floors and the comparison table."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest
from small_logs import log_set, trajectory

from hqpipe.errors import IdentificationError, UsageError
from hqpipe.sysid.compare import compare_models
from hqpipe.sysid.metrics import error_stats, loaded_threshold
from hqpipe.sysid.noise import difference_noise, innovation_noise


class Shifted:
    """Predicts the measured torque plus a constant per joint."""

    def __init__(self, *offsets):
        self.offsets = np.array(offsets)

    def predict(self, trajectory, window):
        return trajectory.effort + self.offsets * (1.0 if window == 1 else 2.0)


def test_error_stats_by_hand():
    effort = np.array([[100.0, 1.0], [-200.0, -2.0], [10.0, 0.1]])
    residual = np.array([[10.0, 0.1], [-10.0, 0.1], [3.0, 0.0]])
    stats = error_stats(residual, effort, np.array([10.0, 0.1]), np.array([50.0, 0.5]))
    assert stats.rmse == pytest.approx(np.sqrt((100 + 100 + 9 + 0.02) / 6))
    assert stats.nrmse == pytest.approx(np.sqrt((1 + 1 + 0.09 + 1 + 1) / 6))
    assert stats.loaded_mape == pytest.approx((10 + 5 + 10 + 5) / 4)
    assert stats.loaded_rmse == pytest.approx(np.sqrt((100 + 100 + 0.02) / 4))
    assert (stats.samples, stats.loaded_samples) == (6, 4)


def test_never_loaded_has_no_percentage():
    stats = error_stats(np.ones((5, 1)), np.ones((5, 1)), np.ones(1), np.array([50.0]))
    assert stats.loaded_mape is None and stats.loaded_rmse is None and stats.loaded_samples == 0


def test_threshold_is_the_papers_for_strong_joints_and_smaller_for_weak_ones():
    wave = np.sin(np.linspace(0, 50, 5000))
    assert loaded_threshold(500 * wave) == 50.0
    assert loaded_threshold(2.0 * wave) == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("sigma", [0.1, 5.0])
@pytest.mark.parametrize("estimate", [difference_noise, innovation_noise])
def test_noise_of_a_smooth_signal(estimate, sigma):
    t = np.arange(8000) * 1e-3
    signal = 200 * np.sin(9 * t) + 60 * np.sin(40 * t) + sigma * np.random.default_rng(0).normal(size=8000)
    assert 0.75 * sigma < estimate(signal) < 1.5 * sigma
    signal[4000:4030] += 300.0
    assert difference_noise(signal) == pytest.approx(sigma, rel=0.25), "an impact is no noise"


@pytest.fixture
def logs():
    return log_set(trajectory(), trajectory(seed=1), trajectory(seed=2), splits=["fit", "heldout", "heldout"])


def test_table_holds_every_part_and_every_baseline(logs):
    rows = compare_models(logs, {"mine": Shifted(3.0, 4.0)})
    names = ["mine", "persistence", "mean torque", "stiff PD (fitted gains)"]
    assert list(dict.fromkeys(row.model for row in rows)) == names
    parts = [(row.joint, row.trial) for row in rows if row.model == "mine"]
    whole = [("all", "all"), ("hip", "all"), ("knee", "all"), ("all", "t1.parquet"), ("all", "t2.parquet")]
    assert parts == whole
    json.dumps([asdict(row) for row in rows], allow_nan=False)


def test_errors_land_in_their_joint_and_horizon(logs):
    rows = {(r.joint, r.trial): r for r in compare_models(logs, {"m": Shifted(3.0, 4.0)}) if r.model == "m"}
    assert rows["hip", "all"].one_step.rmse == pytest.approx(3.0)
    assert rows["knee", "all"].free_run.rmse == pytest.approx(8.0)
    assert rows["all", "all"].one_step.rmse == pytest.approx(np.sqrt(12.5))
    assert rows["all", "t1.parquet"].one_step.samples == 2 * 599


def test_skill_is_relative_to_persistence(logs):
    rows = compare_models(logs, {"perfect": Shifted(0.0, 0.0), "bad": Shifted(1e4, 1e4)})
    pooled = {r.model: r for r in rows if (r.joint, r.trial) == ("all", "all")}
    assert pooled["perfect"].free_run_skill == 1.0
    assert pooled["persistence"].free_run_skill == 0.0
    assert pooled["bad"].one_step_skill < -1.0
    by_hand = logs.trials[1].trajectory.effort, logs.trials[2].trajectory.effort
    steps = np.concatenate([np.diff(effort, axis=0) for effort in by_hand])
    assert pooled["persistence"].one_step.rmse == pytest.approx(np.sqrt(np.mean(steps**2)))


def test_torque_command_brings_the_ideal_actuator():
    trial = trajectory(effort_command=trajectory(seed=3).effort)
    rows = compare_models(log_set(trial, trial), {})
    assert "ideal torque" in {row.model for row in rows}


def test_what_cannot_be_compared_is_refused(logs):
    with pytest.raises(IdentificationError, match="no trial is held out"):
        compare_models(log_set(trajectory(), splits=["fit"]), {})
    with pytest.raises(UsageError, match="cannot be called 'persistence'"):
        compare_models(logs, {"persistence": Shifted(0.0, 0.0)})
    with pytest.raises(IdentificationError, match="joint/<name>/effort"):
        compare_models(log_set(trajectory(effort=None), trajectory(effort=None)), {})
