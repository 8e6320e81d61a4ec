"""Velocity commands drawn during training."""

from __future__ import annotations

import numpy as np

from hqpipe.rl.config import CommandConfig


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
