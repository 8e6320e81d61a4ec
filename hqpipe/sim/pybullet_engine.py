"""Physics by pybullet: worlds of eight robots that collide with the floor only."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from hqpipe.sim.engine import EngineSetup
from hqpipe.sim.pybullet_world import ROBOTS_PER_WORLD, PybulletWorld
from hqpipe.sim.state import WorldArrays


class PybulletEngine:
    """See `hqpipe.sim.engine.Engine`. pybullet holds Python's lock, hence processes."""

    PARALLEL = "processes"
    BLOCK = ROBOTS_PER_WORLD

    def __init__(self, setup: EngineSetup, arrays: WorldArrays, first: int) -> None:
        self._worlds: list[PybulletWorld] = []
        count = len(arrays.reset_flag)
        with tempfile.TemporaryDirectory() as folder:  # pybullet reads files only
            urdfs = [Path(folder) / f"{number}.urdf" for number in range(len(setup.variants))]
            for path, variant in zip(urdfs, setup.variants, strict=True):
                path.write_text(variant.urdf, encoding="utf-8")
            for start in range(0, count, self.BLOCK):
                rows = arrays.rows(start, min(start + self.BLOCK, count))
                self._worlds.append(PybulletWorld(setup, urdfs, rows, first + start))

    def step(self) -> None:
        for world in self._worlds:
            world.step()

    def reset(self) -> None:
        for world in self._worlds:
            if world.arrays.reset_flag.any():
                world.reset(np.flatnonzero(world.arrays.reset_flag))

    def close(self) -> None:
        for world in self._worlds:
            world.close()
        self._worlds.clear()
