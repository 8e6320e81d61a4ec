"""The training simulator: a batch of robots on flat ground, in one of two physics engines."""

from __future__ import annotations

from hqpipe.registry import Registry

ENGINES = Registry(
    "physics engine",
    {
        "pybullet": "hqpipe.sim.pybullet_engine:PybulletEngine",
        "mujoco": "hqpipe.sim.mujoco_engine:MujocoEngine",
    },
)
