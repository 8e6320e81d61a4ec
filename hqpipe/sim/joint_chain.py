"""A mechanism of joints in MuJoCo that compiled code steps: the addresses and arrays that it needs, nothing else."""

from __future__ import annotations

import ctypes
from pathlib import Path

import mujoco
import numpy as np


class JointChain:
    """A compiled model with one degree of freedom per joint.

    Args:
        xml: MJCF text. Its joints are hinges and slides only, in the order of the degrees of freedom.

    Attributes:
        step, model, data: addresses for `call_step`, which advances by one time step (`hqpipe.sim.native_call`).
        position, velocity, applied: (J,) views of the state and of the torque that is applied, SI.
        friction, damping, armature: (J,) views of dry friction (N·m), damping (N·m·s/rad) and added inertia (kg·m²).
    """

    def __init__(self, xml: str) -> None:
        self._model = mujoco.MjModel.from_xml_string(xml)
        self._data = mujoco.MjData(self._model)
        self.step = _address("mj_step")
        self.model, self.data = int(self._model._address), int(self._data._address)
        self.position, self.velocity = self._data.qpos, self._data.qvel
        self.applied = self._data.qfrc_applied
        self.friction, self.damping = self._model.dof_frictionloss, self._model.dof_damping
        self.armature = self._model.dof_armature
        self.timestep = float(self._model.opt.timestep)

    def place(self, position: np.ndarray) -> None:
        """Put the joints to rest at (J,) `position`."""
        mujoco.mj_resetData(self._model, self._data)
        self.position[:] = position
        mujoco.mj_forward(self._model, self._data)

    def inertia(self, position: np.ndarray) -> np.ndarray:
        """(J, J) mass matrix at a posture, armature included."""
        self.place(position)
        full = np.zeros((len(self.position), len(self.position)))
        mujoco.mj_fullM(self._model, self._data, full)
        return full

    def gravity(self, position: np.ndarray) -> np.ndarray:
        """(J,) torque that holds the joints still at a posture."""
        self.place(position)
        return self._data.qfrc_bias.copy()


def _address(name: str) -> int:
    library = ctypes.CDLL(str(next(Path(mujoco.__file__).parent.glob("libmujoco*"))))
    return int(ctypes.cast(getattr(library, name), ctypes.c_void_p).value)
