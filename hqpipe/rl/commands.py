"""Velocity commands drawn during training, and the way from one to the next."""

from __future__ import annotations

import numpy as np

from hqpipe.rl.config import CONTROL_PERIOD_S, CommandConfig


def sample_commands(config: CommandConfig, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) vx, vy (m/s) and ω (rad/s): uniform, some straight ahead, some turning or sideways alone, some standing.

    Moving commands below `config.smallest` are drawn again.
    """
    drawn = _uniform(config, count, rng)
    axes = _moving_axes(config, rng.random(count))
    commands = np.where(axes, drawn, 0.0)
    while (slow := axes.any(axis=1) & (np.linalg.norm(commands, axis=1) < config.smallest)).any():
        commands[slow] = np.where(axes[slow], _uniform(config, int(slow.sum()), rng), 0.0)
    return commands


def _uniform(config: CommandConfig, count: int, rng: np.random.Generator) -> np.ndarray:
    low, high = np.array([config.vx, config.vy, config.wz]).T
    return rng.uniform(low, high, size=(count, 3))


def _moving_axes(config: CommandConfig, kind: np.ndarray) -> np.ndarray:
    """(N, 3) bool: which of vx, vy and ω a command of `kind` (N,), uniform in [0, 1), may have."""
    moving = 1.0 - config.standing_share
    straight = config.standing_share + moving * config.straight_share
    turning, sideways = straight + moving * config.in_place_share * np.array([0.5, 1.0])
    axes = np.ones((len(kind), 3), dtype=bool)
    axes[kind < straight, 1:] = False
    axes[(straight <= kind) & (kind < turning), :2] = False
    axes[(turning <= kind) & (kind < sideways), ::2] = False
    axes[kind < config.standing_share] = False
    return axes


class CommandRamps:
    """Commands on a straight way from the one before to a new one, as a hand pushes a stick.

    Attributes:
        command: (N, 3) what each robot is told now, m/s, m/s and rad/s.

    Args:
        count: robots. longest_s: the way takes up to this long, each time uniformly drawn; 0 changes a command at once.
    """

    def __init__(self, count: int, longest_s: float) -> None:
        self.command = np.zeros((count, 3))
        self._longest = round(longest_s / CONTROL_PERIOD_S)
        self._goal = np.zeros((count, 3))
        self._change = np.zeros((count, 3))  # per control period
        self._left = np.zeros(count, dtype=np.int64)  # control periods

    def stand(self, indices: np.ndarray) -> None:
        """Robots that begin an episode are told to stand, until their first command."""
        self.command[indices] = 0.0
        self._left[indices] = 0

    def head_for(self, indices: np.ndarray, goals: np.ndarray, rng: np.random.Generator | None = None) -> None:
        """Give robots `indices` (n,) new commands `goals` (n, 3); without `rng` all are half of the longest time on the way."""
        self._goal[indices] = goals
        if self._longest == 0:
            self.command[indices] = goals
            return
        if rng is None:
            left = np.full(len(indices), max(1, self._longest // 2))
        else:
            left = rng.integers(1, self._longest, size=len(indices), endpoint=True)
        self._left[indices] = left
        self._change[indices] = (goals - self.command[indices]) / left[:, None]

    def advance(self) -> None:
        """One control period."""
        on_the_way = self._left > 0
        self._left[on_the_way] -= 1
        self.command[on_the_way] += self._change[on_the_way]
        arrived = on_the_way & (self._left == 0)
        self.command[arrived] = self._goal[arrived]
