"""A defect says of each joint the trials that it is in, whole or in part."""

from __future__ import annotations

from hqpipe.gap.checks.defect import of_channel

WHAT = "repeats samples; record at its rate"


def test_joints_are_told_with_their_own_trials():
    cells = frozenset({("a", "hip"), ("b", "hip"), ("b", "knee"), ("a", "ankle"), ("b", "ankle")})
    found = of_channel("held_samples", "effort", ("hip", "knee", "ankle"), ("a", "b"), 2, WHAT, cells=cells)
    assert found.reason == (
        "joint/hip/effort (and of ankle) in every trial and joint/knee/effort in b: repeats samples"
    )
    assert found.for_joints(["hip", "knee"]).reason == (
        "joint/hip/effort in every trial and joint/knee/effort in b: repeats samples"
    )
    assert found.within(["hip", "knee"], ["b"]).reason == "joint/hip/effort (and of knee) in b: repeats samples"


def test_joints_that_have_it_in_the_same_trials_are_told_together():
    found = of_channel("constant", "position", ("hip", "knee"), ("a", "b"), 3, WHAT)
    assert found.reason == "joint/hip/position (and of knee) in 2 of 3 trials (a, b): repeats samples"
