"""A recorded trial beside the model's free-running prediction of it, cut into windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hqpipe.logs.end_stops import judged_windows
from hqpipe.logs.trajectory import Trajectory, Trial
from hqpipe.sysid.free_run import Model, predict, window_samples


@dataclass(frozen=True, eq=False)
class Replay:
    """One trial and what the model makes of its inputs.

    Window m restarts from the logged torque at sample m·W and predicts samples m·W + 1 … (m + 1)·W; what is
    left at the end of the trial is not scored.

    Attributes:
        file: the trial's file name.
        trajectory: the record; where a joint touches an end stop in it, the window is not judged.
        steps: W, samples per window.
        predicted: (T, J) free-running torque, N·m.
        one_step: (T, J) torque predicted one sample ahead, N·m.
    """

    file: str
    trajectory: Trajectory
    steps: int
    predicted: np.ndarray
    one_step: np.ndarray

    @property
    def residual(self) -> np.ndarray:
        """(T, J) measured minus free-running torque, N·m; 0 where nothing was recorded, or the joint is not judged."""
        return np.where(self.trajectory.recorded & self.counts, self.trajectory.effort - self.predicted, 0.0)

    @property
    def held_error(self) -> np.ndarray:
        """(T, J) error of holding the torque that was logged at the start of each window, N·m; row 0 is 0, and what is not
        judged."""
        effort = self.trajectory.effort
        start = np.maximum(np.arange(len(effort)) - 1, 0) // self.steps * self.steps
        return np.where(self.counts, effort - effort[start], 0.0)

    @cached_property
    def judged(self) -> np.ndarray | None:
        """(complete windows, J) whether a joint touches no end stop in a window; None where none ever does."""
        return judged_windows(self.trajectory, self.steps)

    @cached_property
    def counts(self) -> np.ndarray:
        """(T, J) whether a sample is judged."""
        counts = np.ones(self.predicted.shape, dtype=bool)
        if self.judged is not None:
            counts[1 : len(self.judged) * self.steps + 1] = np.repeat(self.judged, self.steps, axis=0)
        return counts

    @cached_property
    def starts(self) -> np.ndarray:
        """(windows,) first sample of each complete window in which some joint is judged."""
        starts = np.arange(max(0, (self.trajectory.samples - 1) // self.steps)) * self.steps
        return starts if self.judged is None else starts[self.judged.any(axis=1)]

    @property
    def windows(self) -> int:
        """Number of complete windows in which some joint is judged."""
        return len(self.starts)

    def targets(self, values: np.ndarray) -> np.ndarray:
        """Cut (T, …) into (windows, W, …) at the predicted samples."""
        return self._cut(values[1:])

    def inputs(self, values: np.ndarray) -> np.ndarray:
        """Cut (T, …) into (windows, W, …) at the samples one before the predicted ones."""
        return self._cut(values)

    def _cut(self, values: np.ndarray) -> np.ndarray:
        if self.judged is not None:
            return values[self.starts[:, None] + np.arange(self.steps)]
        used = self.windows * self.steps
        return values[:used].reshape(self.windows, self.steps, *values.shape[1:])


def replay(trial: Trial, model: Model, window_s: float) -> Replay:
    """Run `model` through one trial that has effort and position_command.

    Raises:
        IdentificationError: a channel is missing, or the window is shorter than two samples.
        UsageError: the model lacks a joint or belongs to another sample time.
    """
    trajectory = trial.trajectory
    steps = window_samples(trajectory.dt, window_s, trial.file)
    return Replay(
        file=trial.file,
        trajectory=trajectory,
        steps=steps,
        predicted=predict(trajectory, model, steps),
        one_step=predict(trajectory, model, 1),
    )


def persistence_error(replays: Sequence[Replay]) -> np.ndarray:
    """(J,) mean squared error, (N·m)², of holding the torque that was logged at the start of each window."""
    squares, counts = (
        np.concatenate([item.targets(values(item)).reshape(-1, item.predicted.shape[1]) for item in replays])
        for values in (lambda item: item.held_error**2, lambda item: item.counts)
    )
    if counts.all():
        return np.mean(squares, axis=0)
    return squares.sum(axis=0) / np.maximum(counts.sum(axis=0), 1)


def memory(item: Replay, model: Model) -> np.ndarray:
    """How much of a torque offset at the window start is left after h steps.

    Found by running the model again from shifted torques, so it holds for any model.

    Returns:
        (W, J), row h − 1 is step h; 1 means that nothing is forgotten, 0 that the model has no state.
    """
    effort = item.trajectory.effort
    shift = 0.01 * effort.std(axis=0) + 1e-9  # small against the signal: the local slope
    shifted = predict(replace(item.trajectory, effort=effort + shift), model, item.steps)
    slope = item.targets(shifted - item.predicted) / shift
    return np.clip(np.mean(slope, axis=0), 0.0, 1.0)
