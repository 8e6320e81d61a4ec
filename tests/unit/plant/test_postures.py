"""Postures jump by what they say, at the time they say."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from hqpipe.errors import UsageError
from hqpipe.plant.postures import FOLD_TIME, FOLDED, postures


def test_knees_jump_by_02_to_03_rad_at_once(robot):
    jumps = postures(robot, "jumps", 5.0)
    at = [jumps(SimpleNamespace(time=t)) for t in (0.0, *(jumps.starts[1:]), 4.999)]
    knees = np.array([pose[2] for pose in at])
    steps = np.abs(np.diff(knees))[:-1]
    assert ((steps > 0.2) & (steps < 0.3 + 1e-9)).all()
    assert knees[-1] == knees[-2]
    np.testing.assert_array_equal(at[0], robot.nominal_position)
    assert all((pose >= robot.position_lower).all() and (pose <= robot.position_upper).all() for pose in at)


def test_legs_give_way_on_one_side_only(robot):
    pose = postures(robot, "collapse", 5.0)(SimpleNamespace(time=2.0))
    moved = {name[:2] for name, a, b in zip(robot.joints, pose, robot.nominal_position, strict=True) if a != b}
    assert moved == {"LF", "LH"}


def test_a_collapse_takes_its_time(robot):
    collapse, knee = postures(robot, "collapse", 5.0), robot.joints.index("LFK")
    start, stand = collapse.starts[1], robot.nominal_position[knee]
    half, end = (collapse(SimpleNamespace(time=start + share * FOLD_TIME))[knee] for share in (0.5, 1.1))
    assert collapse(SimpleNamespace(time=start))[knee] == stand
    assert half == pytest.approx(0.5 * (stand + end)) and end == FOLDED[1]


def test_unknown_kind(robot):
    with pytest.raises(UsageError, match="did you mean 'jumps'"):
        postures(robot, "jump", 5.0)
