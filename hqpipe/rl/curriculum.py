"""Curriculum factor c_f of the paper's rewards."""

from __future__ import annotations

from hqpipe.rl.config import CurriculumConfig


def curriculum_factor(config: CurriculumConfig, iteration: int) -> float:
    """c_f of an iteration (from 0): linear from `start` to 1 over `iterations`, then 1."""
    if config.iterations <= 0:
        return 1.0
    share = min(iteration / config.iterations, 1.0)
    return config.start + (1.0 - config.start) * share
