"""Observation o_t and privileged state x_t: what stands where, in which units, and its fixed normalisation.

One builder serves the batch in the simulator and the single robot, so that both give the same numbers. numpy only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.rl.config import NoiseConfig
from hqpipe.robots import RobotSpec

# Scales bring a term to order one; they are sizes seen in a trot at 1 m/s, not statistics, so that they never move.
_OBSERVATION_SCALE = {
    "base_angular_velocity": 2.0,  # of 0.5 rad/s
    "joint_position": 4.0,  # of 0.25 rad
    "joint_velocity": 0.5,  # of 2 rad/s
    "previous_target": 4.0,  # of 0.25 rad
    "clock": 1.0,
}
_STATE_SCALE = {
    "base_linear_velocity": 2.0,  # of 0.5 m/s
    "gravity": 10.0,  # of 0.1 rad of tilt
    "base_height": 20.0,  # of 0.05 m
    "foot_contact": 2.0,
    "foot_height": 15.0,  # of 0.07 m
}


@dataclass(frozen=True)
class Term:
    """A named part of a vector; the network sees (value − offset) · scale.

    Attributes:
        names: of its elements.
        offset: (n,) in the unit of the element.
    """

    name: str
    names: tuple[str, ...]
    unit: str
    offset: np.ndarray
    scale: float

    @property
    def size(self) -> int:
        return len(self.names)


@dataclass(frozen=True)
class Layout:
    """The terms of a vector, in order."""

    terms: tuple[Term, ...]

    @property
    def size(self) -> int:
        return sum(term.size for term in self.terms)

    @property
    def offset(self) -> np.ndarray:
        """(size,) float32."""
        return np.concatenate([term.offset for term in self.terms]).astype(np.float32)

    @property
    def scale(self) -> np.ndarray:
        """(size,) float32."""
        return np.concatenate([np.full(term.size, term.scale) for term in self.terms]).astype(np.float32)

    def part(self, name: str) -> slice:
        """Where a term stands."""
        start = 0
        for term in self.terms:
            if term.name == name:
                return slice(start, start + term.size)
            start += term.size
        raise KeyError(name)

    def has(self, name: str) -> bool:
        return any(term.name == name for term in self.terms)


def _term(name: str, names: tuple[str, ...], unit: str, scale: dict, offset: np.ndarray | None = None) -> Term:
    zero = np.zeros(len(names)) if offset is None else np.asarray(offset, dtype=float)
    return Term(name, names, unit, zero, scale[name])


def observation_layout(robot: RobotSpec, prior: str, command_scale: float = 1.0) -> Layout:
    """o_t = (ω, q, q̇, q_des of the previous period, command) of the paper; the clock follows unless prior is none.

    Args:
        command_scale: of the velocity command, s/m and s/rad.
    """
    joints, nominal = robot.joints, robot.nominal_position
    s = {**_OBSERVATION_SCALE, "velocity_command": command_scale}
    terms = [
        _term("base_angular_velocity", ("x", "y", "z"), "rad/s", s),
        _term("joint_position", joints, "rad", s, nominal),
        _term("joint_velocity", joints, "rad/s", s),
        _term("previous_target", joints, "rad", s, nominal),
        _term("velocity_command", ("vx", "vy", "wz"), "m/s, m/s, rad/s", s),
    ]
    if prior != "none":
        terms.append(_term("clock", ("sin", "cos"), "1", s))
    return Layout(tuple(terms))


def state_layout(robot: RobotSpec) -> Layout:
    """x_t, known in the simulator only and estimated from o_t; the terms follow Ji et al. 2022 and add the gravity vector."""
    feet, s = robot.feet, _STATE_SCALE
    return Layout(
        (
            _term("base_linear_velocity", ("x", "y", "z"), "m/s", s),
            _term("gravity", ("x", "y", "z"), "1", s, np.array([0.0, 0.0, -1.0])),
            _term("base_height", ("z",), "m", s, np.array([robot.nominal_height])),
            _term("foot_contact", feet, "1", s, np.full(len(feet), 0.5)),
            _term("foot_height", feet, "m", s),
        )
    )


def build_observation(
    angular_velocity: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    previous_target: np.ndarray,
    command: np.ndarray,
    clock: np.ndarray | None,
) -> np.ndarray:
    """o_t, not yet normalised.

    Args:
        angular_velocity: (..., 3) rad/s, base frame.
        position, velocity: (..., J) rad, rad/s.
        previous_target: (..., J) rad, joint targets of the period that just ended, after clipping.
        command: (..., 3) m/s, m/s, rad/s.
        clock: (..., 2) sine and cosine, or None for the prior none.

    Returns:
        (..., n) float32.
    """
    parts = [angular_velocity, position, velocity, previous_target, command]
    if clock is not None:
        parts.append(clock)
    return np.concatenate(parts, axis=-1).astype(np.float32)


def build_state(
    linear_velocity: np.ndarray,
    gravity: np.ndarray,
    height: np.ndarray,
    contact: np.ndarray,
    foot_height: np.ndarray,
) -> np.ndarray:
    """x_t, not yet normalised: (..., 3) m/s base frame, (..., 3) unit vector, (...) m, (..., L) bool, (..., L) m → float32."""
    return np.concatenate(
        (linear_velocity, gravity, height[..., None], contact, foot_height), axis=-1, dtype=np.float32
    )


def noise_half_width(layout: Layout, noise: NoiseConfig) -> np.ndarray:
    """(size,) half-width of the uniform noise on each element of o_t, float32."""
    width = np.zeros(layout.size, dtype=np.float32)
    width[layout.part("base_angular_velocity")] = noise.gyro
    width[layout.part("joint_position")] = noise.position
    width[layout.part("joint_velocity")] = noise.velocity
    return width


def rotate_inverse(orientation: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """World vectors in the base frame: (..., 4) xyzw unit quaternions, (..., 3) vectors → (..., 3)."""
    axis, w = -orientation[..., :3], orientation[..., 3:]
    twice = 2.0 * np.cross(axis, vector)
    return vector + w * twice + np.cross(axis, twice)
