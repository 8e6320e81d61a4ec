"""The arrays that a batched world and its engines share, in one block of memory."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

ALIGNMENT = 64  # bytes, a cache line: no two arrays share one


@dataclass(frozen=True)
class WorldState:
    """What `BatchedWorld.step` and `reset` leave behind; read-only views, SI, world frame unless stated.

    N environments, J joints and F feet, in the order of RobotSpec.joints and RobotSpec.feet; M numbers that the actuator
    model remembers of a joint.

    Attributes:
        base_position: (N, 3) origin of the base link, m.
        base_orientation: (N, 4) unit quaternion x, y, z, w.
        base_linear_velocity: (N, 3) of the origin of the base link, m/s.
        base_angular_velocity: (N, 3) in the base frame, rad/s.
        joint_position, joint_velocity: (N, J) rad, rad/s.
        joint_effort: (N, J) torque applied during the last millisecond, N·m.
        actuator_memory: (N, J, M) what the actuator model remembers besides the torque; zeros after a reset.
        effort_mean_square: (N, J) over the last policy step, N²·m².
        effort_clipped: (N, J) largest amount by which the actuator's demand exceeded the limit, N·m.
        foot_position, foot_velocity: (N, F, 3) origin of the foot links, m and m/s.
        foot_force: (N, F, 3) ground on foot during the last millisecond, N.
        foot_contact: (N, F) bool, the ground pushes on the foot.
        illegal_contact: (N,) bool, a link other than feet and shanks touches the ground.
    """

    base_position: np.ndarray
    base_orientation: np.ndarray
    base_linear_velocity: np.ndarray
    base_angular_velocity: np.ndarray
    joint_position: np.ndarray
    joint_velocity: np.ndarray
    joint_effort: np.ndarray
    actuator_memory: np.ndarray
    effort_mean_square: np.ndarray
    effort_clipped: np.ndarray
    foot_position: np.ndarray
    foot_velocity: np.ndarray
    foot_force: np.ndarray
    foot_contact: np.ndarray
    illegal_contact: np.ndarray


@dataclass(frozen=True)
class WorldArrays:
    """State and inputs, writable; an engine gets the rows of its own environments.

    A reset writes the new state into `state` and raises `reset_flag`; a push adds to `impulse`, which the next
    step consumes.

    Attributes:
        state: see `WorldState`.
        targets: (N, J) joint position targets, rad.
        parameters: (N, J, P) actuator parameters whose effort limit is infinite.
        weights: (W,) of an actuator that is a net, the same for every environment.
        effort_limit: (N, J) N·m, applied after the actuator model.
        impulse: (N, 3) world frame, N·s.
        reset_flag: (N,) bool.
    """

    state: WorldState
    targets: np.ndarray
    parameters: np.ndarray
    weights: np.ndarray
    effort_limit: np.ndarray
    impulse: np.ndarray
    reset_flag: np.ndarray

    def rows(self, first: int, last: int) -> WorldArrays:
        """Views of the environments `first` … `last` − 1."""
        state = WorldState(**{f.name: getattr(self.state, f.name)[first:last] for f in fields(WorldState)})
        shared = ("state", "weights")
        inputs = {f.name: getattr(self, f.name)[first:last] for f in fields(self) if f.name not in shared}
        return WorldArrays(state=state, weights=self.weights, **inputs)


@dataclass(frozen=True)
class ArraySizes:
    """Numbers that determine the memory layout: environments, joints, actuator parameters, feet, actuator memory, weights."""

    envs: int
    joints: int
    parameters: int
    feet: int
    memory: int
    weights: int = 0

    def layout(self) -> dict[str, tuple[tuple[int, ...], type]]:
        """Name → shape and type of every array, in the order of memory."""
        n, j, p, f, m = self.envs, self.joints, self.parameters, self.feet, self.memory
        return {
            "base_position": ((n, 3), np.float64),
            "base_orientation": ((n, 4), np.float64),
            "base_linear_velocity": ((n, 3), np.float64),
            "base_angular_velocity": ((n, 3), np.float64),
            "joint_position": ((n, j), np.float64),
            "joint_velocity": ((n, j), np.float64),
            "joint_effort": ((n, j), np.float64),
            "actuator_memory": ((n, j, m), np.float64),
            "effort_mean_square": ((n, j), np.float64),
            "effort_clipped": ((n, j), np.float64),
            "foot_position": ((n, f, 3), np.float64),
            "foot_velocity": ((n, f, 3), np.float64),
            "foot_force": ((n, f, 3), np.float64),
            "foot_contact": ((n, f), np.bool_),
            "illegal_contact": ((n,), np.bool_),
            "targets": ((n, j), np.float64),
            "parameters": ((n, j, p), np.float64),
            "weights": ((self.weights,), np.float32),
            "effort_limit": ((n, j), np.float64),
            "impulse": ((n, 3), np.float64),
            "reset_flag": ((n,), np.bool_),
        }

    def nbytes(self) -> int:
        return sum(_padded(shape, dtype) for shape, dtype in self.layout().values())

    def arrays(self, memory: memoryview | bytearray) -> WorldArrays:
        """Views into `memory`, at least `nbytes()` long and all zero at first."""
        views, offset = {}, 0
        for name, (shape, dtype) in self.layout().items():
            views[name] = np.ndarray(shape, dtype, buffer=memory, offset=offset)
            offset += _padded(shape, dtype)
        state = WorldState(**{f.name: views.pop(f.name) for f in fields(WorldState)})
        return WorldArrays(state=state, **views)


def _padded(shape: tuple[int, ...], dtype: type) -> int:
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    return -(-size // ALIGNMENT) * ALIGNMENT


def read_only(state: WorldState) -> WorldState:
    """The same arrays without permission to write."""
    views = {}
    for f in fields(WorldState):
        views[f.name] = getattr(state, f.name).view()
        views[f.name].flags.writeable = False
    return WorldState(**views)
