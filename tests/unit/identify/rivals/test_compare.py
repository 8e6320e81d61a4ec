"""Error measures and the comparison table."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest
from identify.small_logs import log_set, trajectory

from hqpipe.errors import IdentificationError, UsageError
from hqpipe.identify.rivals.compare import compare_models
from hqpipe.identify.rivals.metrics import error_stats, loaded_threshold
from hqpipe.identify.rivals.score_files import long_rows, score_tree


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


def test_stress_trials_are_judged_and_nothing_is_fitted_to_them(logs):
    stress = log_set(*(trajectory(seed=s, effort=9.0 * trajectory(seed=s).effort) for s in (3, 4)))
    alone = compare_models(logs, {"m": Shifted(3.0, 4.0)})
    rows = compare_models(logs, {"m": Shifted(3.0, 4.0)}, stress=stress)
    assert rows[: len(alone)] == alone, "held-out rows stay as they are, and come first"
    beyond = {(r.model, r.joint, r.trial): r for r in rows[len(alone) :]}
    assert {row.logs for row in beyond.values()} == {"stress"}
    assert {trial for _, _, trial in beyond} == {"all", "t0.parquet", "t1.parquet"}, "whatever their split"
    assert beyond["m", "hip", "all"].free_run.rmse == pytest.approx(6.0)
    efforts = np.concatenate([trial.trajectory.effort[1:] for trial in stress.trials])
    mean = logs.trials[0].trajectory.effort.mean(axis=0)
    expected = np.sqrt(np.mean((efforts - mean) ** 2))
    assert beyond["mean torque", "all", "all"].free_run.rmse == pytest.approx(expected)


def test_stress_trials_of_other_joints_are_refused(logs):
    with pytest.raises(UsageError, match="joints hip, ankle, expected those of"):
        compare_models(logs, {}, stress=log_set(trajectory(joints=("hip", "ankle"))))


@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_a_model_that_diverges_is_infinitely_wrong(logs, value):
    row = compare_models(logs, {"m": Shifted(value, 0.0)})[0]
    assert row.free_run.rmse == row.one_step.loaded_mape == np.inf
    assert row.free_run_skill == -np.inf
    tree = score_tree([row], 0.1)
    assert tree["logs"]["held-out"]["models"]["m"]["all"]["free_run"]["rmse"] is None
    json.dumps(tree, allow_nan=False)


def test_long_rows_hold_every_number_once(logs):
    rows = compare_models(logs, {"m": Shifted(3.0, 4.0)}, stress=log_set(trajectory(seed=3)))
    long = long_rows(rows)
    keys = [tuple(v for k, v in row.items() if k not in ("unit", "value")) for row in long]
    assert len(set(keys)) == len(keys)
    values = dict(zip(keys, (row["value"] for row in long), strict=True))
    assert values["held-out", "all", "hip", "m", "free_run", "rmse"] == pytest.approx(6.0)
    assert values["stress", "all", "knee", "m", "one_step", "rmse"] == pytest.approx(4.0)
    assert values["held-out", "t1.parquet", "all", "noise floor", "any", "rmse"] == rows[0].noise_floor
    assert {row["unit"] for row in long if row["measure"] == "loaded_mape"} == {"%"}


def test_tree_keeps_trials_and_joints_apart(logs):
    tree = score_tree(compare_models(logs, {"m": Shifted(3.0, 4.0)}), 0.1)["logs"]["held-out"]
    assert set(tree["models"]["m"]["joints"]) == {"hip", "knee"}
    assert set(tree["models"]["m"]["trials"]) == {"t1.parquet", "t2.parquet"}
    assert set(tree["noise_floor"]) == {"all", "joints", "trials"}


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
