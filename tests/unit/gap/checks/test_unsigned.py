"""A lost sign is noticed, and restored."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from plant_logs import broken, plant_logs, real, values

from hqpipe.errors import UsageError
from hqpipe.gap.checks.unsigned import restore_sign, unsigned
from hqpipe.identify.sign_path import sign_path

sys.path.insert(0, str(Path(__file__).parents[3] / "recovery"))
import hydraulic_truth

CHANNELS = ("effort", "position_command", "position", "velocity")


def wrong(true, restored):
    """Share of the torque, by size, with the wrong sign."""
    return float(np.abs(true)[np.sign(true) != np.sign(restored)].sum() / np.abs(true).sum())


def restored(logs, j):
    parts = [t.trajectory for t in logs.trials]
    columns = ([getattr(t, name)[:, j] for t in parts] for name in CHANNELS)
    return restore_sign(*columns, parts[0].dt)


def test_sign_path_against_all_sign_patterns():
    rng = np.random.default_rng(0)
    size, drive = np.abs(rng.standard_normal(9)), rng.standard_normal(9)
    signs, cost = sign_path(size, 0.7, drive)

    def total(s):
        return np.sum((s[1:] * size[1:] - 0.7 * s[:-1] * size[:-1] - drive[:-1]) ** 2)

    patterns = 1.0 - 2.0 * ((np.arange(512)[:, None] >> np.arange(9)) & 1)
    assert cost == pytest.approx(min(total(s) for s in patterns))
    assert total(signs) == pytest.approx(cost)


@pytest.mark.parametrize("seed", [0, 1])
def test_simulated_hydraulic_joints(seed):
    trials = [hydraulic_truth.simulate(4.0, 3, 2.0, 10 * seed + i) for i in (0, 1)]
    for j in range(3):
        q_des, q, qd, torque = ([trial[k][:, j] for trial in trials] for k in range(1, 5))
        found = restore_sign([np.abs(values) for values in torque], q_des, q, qd, hydraulic_truth.DT)
        assert max(wrong(a, b) for a, b in zip(torque, found, strict=True)) < 0.002


@pytest.mark.parametrize("source", ["pressure", "load_cell"])
def test_joints_of_the_plant(source):
    truth = plant_logs(source=source)
    lost = plant_logs(source=source, changes='{"sensors": {"effort_unsigned": 1.0}}')
    assert np.array_equal(np.abs(truth.trials[0].trajectory.effort), lost.trials[0].trajectory.effort)
    for j in range(len(truth.joints)):
        for trial, effort in zip(truth.trials, restored(lost, j), strict=True):
            assert wrong(trial.trajectory.effort[:, j], effort) < 0.03
    assert unsigned(truth.trials) == []
    found = unsigned(lost.trials)
    assert {entry.joint for entry in found} == set(truth.joints)
    assert {entry.channel for entry in found} == {"effort"}


def test_share_of_the_negative_torque():
    truth = plant_logs().trials
    found = unsigned(broken(plant_logs(), values("effort", np.abs)).trials)
    for entry in found:
        effort = np.concatenate([t.trajectory.effort[:, t.trajectory.joint(entry.joint)] for t in truth])
        negative = -effort[effort < 0].sum() / np.abs(effort).sum()
        assert entry.negative_share == pytest.approx(negative, abs=0.03)


def test_a_lost_sign_is_noticed_where_the_torque_is_rarely_negative():
    """As of a knee that bears weight but for a moment of each stride."""
    shift = values("effort", lambda v: v - np.quantile(v, 0.06, axis=0))
    efforts = np.concatenate([t.trajectory.effort for t in broken(plant_logs(), shift).trials])
    share = -np.minimum(efforts, 0.0).sum(axis=0) / np.abs(efforts).sum(axis=0)
    lost = broken(plant_logs(), values("effort", lambda v: np.abs(v - np.quantile(v, 0.06, axis=0))))
    assert np.all(share < 0.03)
    assert {entry.joint for entry in unsigned(lost.trials)} == set(lost.joints)


def test_a_torque_of_one_sign_is_not_unsigned():
    """A joint under a load larger than its own motion needs never pushes the other way."""
    loaded = broken(plant_logs(), values("effort", lambda v: v - v.min(axis=0) + 5.0))
    assert unsigned(loaded.trials) == []


@pytest.mark.parametrize("joints", [(2,), (2, 5)])
def test_a_size_of_a_torque_that_was_negative_throughout_pulls_away(joints):
    """As of a knee that bears weight, on a machine whose knees push in the negative direction."""

    def lose(v):
        changed = v.copy()
        changed[:, joints] = np.abs(v - v.max(axis=0) - 5.0)[:, joints]
        return changed

    lost = broken(plant_logs(), values("effort", lose))
    found = unsigned(lost.trials)
    assert [entry.joint for entry in found] == [lost.joints[j] for j in joints]
    assert all(entry.pulls_away for entry in found)


def test_a_machine_that_counts_torques_the_other_way_has_lost_no_sign():
    """Its loaded knee is never negative and pulls away from the command, as all its other joints do."""

    def turned(v):
        changed = -v
        changed[:, 2] = np.abs(v - v.max(axis=0) - 5.0)[:, 2]
        return changed

    assert unsigned(broken(plant_logs(), values("effort", turned)).trials) == []


def test_where_no_torque_changes_its_sign_none_tells_how_the_machine_counts():
    logs = broken(plant_logs(), values("effort", lambda v: np.abs(v - v.max(axis=0) - 5.0)))
    assert unsigned(logs.trials) == []


def test_velocity_without_sign():
    found = unsigned(broken(plant_logs(), values("velocity", np.abs, 2)).trials)
    assert [(entry.channel, entry.joint) for entry in found] == [("velocity", "LFK")]


def test_real_machines():
    emps = real("emps")
    assert unsigned(emps.trials) == []
    lost = broken(emps, values("effort", np.abs))
    assert [entry.joint for entry in unsigned(lost.trials)] == ["slide"]
    for trial, effort in zip(emps.trials, restored(lost, 0), strict=True):
        assert wrong(trial.trajectory.effort[:, 0], effort) < 0.02
    found = {entry.joint for entry in unsigned(real("so101").trials)}
    assert {"Rotation", "Wrist_Pitch", "Wrist_Roll"} <= found


def test_arrays_of_unequal_length_are_refused():
    part = np.zeros(100)
    with pytest.raises(UsageError, match=r"of one shape \(T,\), got \(100,\), \(99,\)"):
        restore_sign([part], [part[:99]], [part], [part], 1e-3)
