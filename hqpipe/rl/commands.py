"""Velocity commands drawn during training."""

from __future__ import annotations

import numpy as np

from hqpipe.rl.config import CommandConfig


def sample_commands(config: CommandConfig, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) vx, vy (m/s) and ω (rad/s): uniform, some straight ahead, some turning or sideways alone, some standing."""
    low, high = np.array([config.vx, config.vy, config.wz]).T
    commands = rng.uniform(low, high, size=(count, 3))
    kind = rng.random(count)
    moving = 1.0 - config.standing_share
    straight = config.standing_share + moving * config.straight_share
    turning, sideways = straight + moving * config.in_place_share * np.array([0.5, 1.0])
    commands[kind < straight, 1:] = 0.0
    commands[(straight <= kind) & (kind < turning), :2] = 0.0
    commands[(turning <= kind) & (kind < sideways), ::2] = 0.0
    commands[kind < config.standing_share] = 0.0
    return commands
