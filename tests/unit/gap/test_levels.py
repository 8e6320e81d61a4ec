"""The size of the torque then and now, where no model predicts it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from planted_logs import logs_of

from hqpipe.gap.level_answer import by_levels
from hqpipe.gap.levels import compare, levels_of


def machine(seed, friction=1.0, faster=1.0, trials=6):
    """Unsigned torque of a joint that rubs, in trials that differ a little."""
    rng = np.random.default_rng(seed)
    logs = logs_of([{}], seconds=2.0, fit=trials)
    found = []
    for trial in logs.trials:
        t = trial.trajectory
        speed = faster * 0.5 * np.sin(2 * np.pi * t.time)
        level = friction * np.where(speed > 0, 3.0, 5.0) + 0.1 * rng.normal() + 0.3 * rng.normal(size=t.samples)
        found.append(replace(trial, trajectory=replace(t, velocity=speed[:, None], effort=np.abs(level)[:, None])))
    return levels_of(replace(logs, trials=tuple(found))), logs.joints


def test_more_friction_raises_the_level_both_ways():
    (then, joints), (now, _) = machine(1), machine(2, friction=1.2)
    changed, apart = compare(then, now, joints)
    assert [c.direction for c in changed] == ["forward", "backward"] and not apart
    assert abs(changed[0].now / changed[0].then - 1.2) < 0.05


def test_the_same_machine_has_not_changed():
    for seed in range(3, 9):
        (then, joints), (now, _) = machine(seed), machine(seed + 100)
        assert compare(then, now, joints) == ([], [])


def test_another_motion_or_too_few_trials_cannot_be_compared():
    (then, joints), (fast, _), (few, _) = machine(1), machine(2, faster=1.5), machine(3, friction=1.5, trials=1)
    assert compare(then, fast, joints) == ([], list(joints))
    assert compare(then, few, joints) == ([], list(joints))


def nothing_changed(joints):
    return {
        "verdict": "no_gap",
        "warnings": ["w"],
        "logs": {"joints": list(joints)},
        "unexplained": {},
        "next_experiment": None,
    }


def test_a_level_that_differs_is_a_change_of_unknown_cause():
    (then, joints), (now, _) = machine(1), machine(2, friction=1.2)
    content, reason = by_levels(nothing_changed(joints), then, now, joints, "N·m")
    assert content["verdict"] == "unknown" and content["unexplained"]["above_noise"] and reason is None
    assert "mean torque forward is 3." in content["warnings"][0] and "(+2" in content["warnings"][0]


def test_a_level_that_is_the_same_leaves_the_answer():
    (then, joints), (now, _) = machine(1), machine(2)
    content, reason = by_levels(nothing_changed(joints), then, now, joints, "N·m")
    assert content["verdict"] == "no_gap" and reason is None and "as it was" in content["warnings"][0]


def test_where_nothing_can_be_compared_nothing_is_told():
    (then, joints), (now, _) = machine(1), machine(2, trials=1)
    _, reason = by_levels(nothing_changed(joints), then, now, joints, "N·m")
    assert "nothing can be said of a change" in reason
