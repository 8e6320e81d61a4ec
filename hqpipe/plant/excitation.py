"""Gantry excitation: joint targets that move every joint at many frequencies round a pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hqpipe.errors import UsageError, near_match
from hqpipe.robots import RobotSpec

KINDS = ("multisine", "chirp")
LOWEST_HZ, HIGHEST_HZ = 0.2, 10.0  # from slow motion to well above the position loop (about 5 Hz); assumption
LINES = 16  # sines of the multisine
TILT = 0.7  # amplitude ∝ 1/f^0.7, between equal travel and equal speed for all lines; assumption
AMPLITUDE = 0.35  # rad, peak offset; assumption: the range of a walking knee
PEAK_RATE = 5.0  # rad/s, bound on the target's speed: below half of the no-load speed
MARGIN = 0.08  # rad kept from the joint limits
FADE_TIME = 0.5  # s to blend in


@dataclass(frozen=True)
class Excitation:
    """A controller: offsets Σ a sin(φ(t)) round a pose.

    Attributes:
        pose: (J,) rad.
        amplitude: (J, L) rad.
        frequency: (J, L) Hz at the start.
        growth: (J, L) 1/s, exponential growth of the frequency; 0 for a multisine.
        phase: (J, L) rad.
        duration: s.
    """

    pose: np.ndarray
    amplitude: np.ndarray
    frequency: np.ndarray
    growth: np.ndarray
    phase: np.ndarray
    duration: float

    def __call__(self, frame: Any, command: dict[str, float] | None = None) -> np.ndarray:
        """(J,) joint targets, rad, at `frame.time`."""
        return self.at(frame.time)

    def at(self, time: float) -> np.ndarray:
        """(J,) joint targets at `time` s."""
        swept = self.growth > 0.0
        cycles = self.frequency * np.where(
            swept, np.expm1(self.growth * time) / np.where(swept, self.growth, 1.0), time
        )
        # A chirp keeps its travel until it meets the speed bound, then its speed.
        now = self.frequency * np.exp(self.growth * time)
        amplitude = np.minimum(self.amplitude, PEAK_RATE / (2.0 * np.pi * now))
        offset = np.sum(amplitude * np.sin(2.0 * np.pi * cycles + self.phase), axis=1)
        return self.pose + min(time / FADE_TIME, 1.0) * offset


def excitation(
    robot: RobotSpec,
    kind: str = "multisine",
    duration: float = 20.0,
    seed: int = 0,
    pose: np.ndarray | None = None,
    amplitude: float = AMPLITUDE,
) -> Excitation:
    """An excitation within joint and speed limits.

    Args:
        robot: limits, nominal pose.
        kind: "multisine" (random phases, all frequencies at once) or "chirp" (0.2 → 10 Hz, every joint with
            its own phase).
        duration: s.
        seed: of phases.
        pose: (J,) rad, the nominal pose if None.
        amplitude: rad, peak; reduced where a limit is near.

    Raises:
        UsageError: unknown kind.
    """
    if kind not in KINDS:
        raise UsageError(f"excitation: expected one of {', '.join(KINDS)}, got '{kind}'{near_match(kind, KINDS)}")
    rng, joints = np.random.default_rng(seed), len(robot.joints)
    centre = robot.nominal_position if pose is None else np.asarray(pose, dtype=float)
    room = np.minimum(robot.position_upper - centre, centre - robot.position_lower) - MARGIN
    peak = np.minimum(amplitude, np.maximum(room, 0.0))
    lines = LINES if kind == "multisine" else 1
    phase = rng.uniform(0.0, 2.0 * np.pi, (joints, lines))
    if kind == "chirp":
        frequency = np.full((joints, 1), LOWEST_HZ)
        growth = np.full((joints, 1), np.log(HIGHEST_HZ / LOWEST_HZ) / duration)
        return Excitation(centre, peak[:, None], frequency, growth, phase, duration)
    grid = np.geomspace(LOWEST_HZ, HIGHEST_HZ, lines)
    frequency = grid * rng.uniform(0.95, 1.05, (joints, lines))  # joints share no line exactly
    shape = Excitation(np.zeros(joints), 1.0 / frequency, frequency, np.zeros_like(frequency), phase, duration)
    offsets = np.stack([shape.at(t) for t in np.arange(0.0, duration, 0.01)])
    rates = np.abs(np.diff(offsets, axis=0)).max(axis=0) / 0.01
    scale = np.minimum(peak / np.abs(offsets).max(axis=0), PEAK_RATE / rates)
    return Excitation(centre, scale[:, None] / frequency, frequency, np.zeros_like(frequency), phase, duration)
