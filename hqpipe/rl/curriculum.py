"""What changes in the course of a training: the curriculum factor c_f of the paper's rewards, and how wide actions scatter."""

from __future__ import annotations

from hqpipe.rl.config import CurriculumConfig, PolicyConfig


def curriculum_factor(config: CurriculumConfig, iteration: int) -> float:
    """c_f of an iteration (from 0): linear from `start` to 1 over `iterations`, then 1."""
    if config.iterations <= 0:
        return 1.0
    share = min(iteration / config.iterations, 1.0)
    return config.start + (1.0 - config.start) * share


def widest_log_std(config: PolicyConfig, iteration: int, iterations: int) -> float:
    """Bound on the log std of the actions in an iteration (from 0) of `iterations`: linear from the initial to the final one.

    A policy that learns under wide exploration learns what makes up for it, such as longer steps for those that the noise
    shortens, and walks otherwise once the noise is gone.
    """
    share = iteration / max(1, iterations - 1)
    return config.initial_log_std + share * (config.final_log_std - config.initial_log_std)
