"""Physics by MuJoCo: one mjData per robot, stepped by a compiled loop in threads."""

from __future__ import annotations

import ctypes
from dataclasses import fields
from pathlib import Path

import mujoco
import numpy as np

from hqpipe.sim.engine import PHYSICS_DT, EngineSetup
from hqpipe.sim.mujoco_loop import (
    FREE_QPOS,
    FREE_QVEL,
    Addresses,
    Functions,
    Layout,
    Rows,
    read_bodies,
    step_robots,
)
from hqpipe.sim.mujoco_model import robot_model
from hqpipe.sim.state import WorldArrays


class MujocoEngine:
    """See `hqpipe.sim.engine.Engine`. The loop runs without Python's lock, hence threads."""

    PARALLEL = "threads"
    BLOCK = 1

    def __init__(self, setup: EngineSetup, arrays: WorldArrays, first: int) -> None:
        self.setup, self.arrays = setup, arrays
        count = len(arrays.reset_flag)
        family = [robot_model(setup, variant) for variant in setup.variants[: first + count]]
        self._models = [family[(first + n) % len(setup.variants)] for n in range(count)]
        self._data = [mujoco.MjData(model) for model in self._models]
        self._functions = _functions()
        self._addresses = _addresses(self._models, self._data)
        self._layout = _layout(setup, self._models)
        named = {f.name: getattr(arrays.state, f.name) for f in fields(arrays.state)}
        named |= {name: getattr(arrays, name) for name in Rows._fields if name not in named}
        self._rows = Rows(**named)

    def step(self) -> None:
        step_robots(
            self._functions,
            self._addresses,
            self._layout,
            self._rows,
            self.setup.kind,
            self.setup.decimation,
            self.setup.decimation * PHYSICS_DT,
        )

    def reset(self) -> None:
        state, layout = self.arrays.state, self._layout
        for n in np.flatnonzero(self.arrays.reset_flag):
            data = self._data[n]
            mujoco.mj_resetData(self._models[n], data)
            data.qpos[:3] = state.base_position[n]
            data.qpos[3:FREE_QPOS] = state.base_orientation[n][[3, 0, 1, 2]]
            data.qvel[:3] = state.base_linear_velocity[n]
            data.qvel[3:FREE_QVEL] = state.base_angular_velocity[n]
            data.qpos[layout.qpos] = state.joint_position[n]
            data.qvel[layout.dof] = state.joint_velocity[n]
            read_bodies(self._functions, self._addresses, layout, self._rows, n)
            for contact in (state.foot_force, state.foot_contact, state.illegal_contact):
                contact[n] = 0
            self.arrays.impulse[n] = 0.0
            self.arrays.reset_flag[n] = False

    def close(self) -> None:
        """MuJoCo frees models and data with their last reference."""
        self._data.clear()
        self._models.clear()


def _functions() -> Functions:
    """Addresses in the MuJoCo library that the Python package has loaded."""
    library = ctypes.CDLL(str(next(Path(mujoco.__file__).parent.glob("libmujoco*"))))
    names = ("mj_step", "mj_kinematics", "mj_comPos", "mj_comVel", "mj_rnePostConstraint")
    return Functions(*(ctypes.cast(getattr(library, name), ctypes.c_void_p).value for name in names))


def _addresses(models: list[mujoco.MjModel], data: list[mujoco.MjData]) -> Addresses:
    columns = [[m._address for m in models], [d._address for d in data]]
    columns += [[getattr(d, name).ctypes.data for d in data] for name in Addresses._fields[2:]]
    return Addresses(*(np.array(column, dtype=np.int64) for column in columns))


def _layout(setup: EngineSetup, models: list[mujoco.MjModel]) -> Layout:
    model = models[0]
    joints = [model.joint(name).id for name in setup.joints]
    base = model.body(setup.base_link).id
    illegal = np.ones(model.nbody, dtype=bool)
    illegal[[0, *(model.body(name).id for name in setup.foot_links + setup.shank_links)]] = False
    return Layout(
        qpos=model.jnt_qposadr[joints].astype(np.int64),
        dof=model.jnt_dofadr[joints].astype(np.int64),
        feet=np.array([model.body(name).id for name in setup.foot_links], dtype=np.int64),
        base=base,
        base_com=np.array([m.body_ipos[base] for m in models]),
        illegal=illegal,
    )
