"""Frames in several processes: all of them, in order, the same as in one."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.errors import UsageError
from hqpipe.robots import robot_folder
from hqpipe.sim import film
from hqpipe.sim.film import Poses, draw_poses

FOLDER = robot_folder("hydraulic_quadruped")


def turning(robot, many: int) -> Poses:
    half = 0.25 * np.arange(many)
    turned = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)
    return Poses(np.tile([0.0, 0.0, 0.877], (many, 1)), turned, np.tile(robot.nominal_position, (many, 1)))


def test_processes_change_nothing(robot, monkeypatch):
    monkeypatch.setattr(film, "CHUNK", 2)
    told = []
    poses = turning(robot, 5)
    alone = draw_poses(FOLDER, poses, width=80, height=60, progress=lambda *given: told.append(given))
    together = draw_poses(FOLDER, poses, width=80, height=60, workers=2)
    np.testing.assert_array_equal(alone, together)
    assert np.shape(alone) == (5, 60, 80, 3)
    assert [done for done, _, _ in told] == [2, 4, 5] and told[-1][1] == 5
    assert all((a != b).any() for a, b in zip(alone, alone[1:], strict=False)), "the robot turns"


def test_poses_of_unequal_length_are_refused(robot):
    poses = turning(robot, 3)
    with pytest.raises(UsageError, match="as many states, got 2, 3"):
        Poses(poses.base_position, poses.base_orientation[:2], poses.joint_position)
    with pytest.raises(UsageError, match="got 0"):
        poses.part(3, 3)
