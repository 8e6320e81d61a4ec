"""The noise of the torque's sensor: how small the error of a prediction could be at all."""

from __future__ import annotations

from collections.abc import Sequence

from hqpipe.logs.survey.signal import difference_noise
from hqpipe.logs.trajectory import Trial


def torque_noise(trials: Sequence[Trial], joint: str) -> float:
    """Standard deviation of the noise of one joint's measured torque over some trials, N·m."""
    j = trials[0].trajectory.joint(joint)
    return difference_noise([trial.trajectory.effort[:, j] for trial in trials])
