"""Whether a robot can be used, asked before any stage starts."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

ON_THE_PLANT = frozenset({"collect", "validate", "compare", "report"})
"""Stages that drive the reference plant, and so need every number of `hydraulics` in robot.yaml."""


def check_robot(folder: Path, stages: Collection[str]) -> None:
    """Read the robot in `folder` as the stages will.

    Raises:
        ConfigError: robot.yaml or robot.urdf is broken, or a number of the plant is missing or out of bounds.
    """
    from hqpipe.plant.config import check_base
    from hqpipe.robots import load_robot

    robot = load_robot(folder)
    if ON_THE_PLANT.intersection(stages):
        check_base(robot.hydraulics, robot)
