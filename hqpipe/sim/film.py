"""Frames of a moving robot, drawn in several processes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hqpipe.errors import UsageError
from hqpipe.robots import load_robot
from hqpipe.sim.render import Camera, Renderer
from hqpipe.system.processes import in_processes

CHUNK = 20  # frames that a process draws at a time: a second of film, so that progress is seen
# From the side that the light falls on, low and far enough for the whole gait; by eye.
FROM_THE_SIDE = Camera(distance=3.1, azimuth=58.0, elevation=12.0, height=0.55, field_of_view=36.0)


@dataclass(frozen=True)
class Poses:
    """States to draw.

    Attributes:
        base_position: (N, 3) m.
        base_orientation: (N, 4) quaternion x, y, z, w.
        joint_position: (N, J) rad in the order of RobotSpec.joints.
    """

    base_position: np.ndarray
    base_orientation: np.ndarray
    joint_position: np.ndarray

    def __post_init__(self) -> None:
        lengths = {len(self.base_position), len(self.base_orientation), len(self.joint_position)}
        if len(lengths) > 1 or 0 in lengths:
            found = ", ".join(map(str, sorted(lengths)))
            raise UsageError(f"poses: expected positions, orientations and joints of as many states, got {found}")

    def part(self, first: int, last: int) -> Poses:
        """States `first` up to `last`, not included."""
        return Poses(*(each[first:last] for each in (self.base_position, self.base_orientation, self.joint_position)))


def draw_poses(
    robot_folder: Path,
    poses: Poses,
    *,
    width: int,
    height: int,
    camera: Camera = FROM_THE_SIDE,
    workers: int = 1,
    progress: Callable[[float, float, str], None] = lambda done, total, note: None,
) -> list[np.ndarray]:
    """Draw every state; the pictures do not depend on the number of processes.

    Args:
        robot_folder: holds robot.yaml. width, height: pixels. workers: processes; 1 draws in this one.

    Returns:
        N pictures (height, width, 3) uint8, red, green, blue.
    """
    many = len(poses.base_position)
    jobs = [(robot_folder, poses.part(first, first + CHUNK), width, height, camera) for first in range(0, many, CHUNK)]
    if workers == 1 or len(jobs) == 1:
        drawn = []
        for job in jobs:
            drawn += _draw(*job)
            progress(len(drawn), many, "frames")
        return drawn
    calls = {f"frames from {number * CHUNK}": job for number, job in enumerate(jobs)}
    parts = in_processes(_draw, calls, workers, lambda done, name: progress(min(many, done * CHUNK), many, "frames"))
    return [frame for part in parts for frame in part]


def _draw(robot_folder: Path, poses: Poses, width: int, height: int, camera: Camera) -> list[np.ndarray]:
    renderer = Renderer(load_robot(robot_folder), width=width, height=height, camera=camera)
    try:
        states = zip(poses.base_position, poses.base_orientation, poses.joint_position, strict=True)
        return [renderer.frame(*state) for state in states]
    finally:
        renderer.close()
