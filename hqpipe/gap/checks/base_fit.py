"""One joint with the base law of its control mode, fitted in windows that run free from the log: how well it describes them.

In torque mode the error of the torque drives the law, τ' = τ + k1 (τ_d − τ) − k2 τ − k3 q̇. That is the law of position mode
with τ_d in the place of the position error and k1 + k2 in that of k2, without impacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.identify.paper_model.problem import COEFFICIENTS, Problem
from hqpipe.identify.windows import JointData, Windows
from hqpipe.layers.actuator.record import window_starts
from hqpipe.logs.columns import COMMAND_CHANNEL
from hqpipe.logs.differentiate import step_speed
from hqpipe.logs.trajectory import Trajectory

MOST_WINDOWS = 400  # of a joint; 40 s of windows of 0.1 s say what an hour says, in bounded time
_OUTLIER = 0.5  # of the RMS torque, from which on an error counts linearly (Huber); assumption: impacts are smaller
_FREE = {
    "position": np.ones(len(COEFFICIENTS), dtype=bool),
    "torque": np.array([name != "k4" for name in COEFFICIENTS]),
}


@dataclass(frozen=True, eq=False)
class BaseFit:
    """The windows of one joint.

    Attributes:
        mode: control mode, position or torque. data: what the law reads. windows: of the trials, end to end.
        first: (W,) first row of each window in its trial, `windows.trial`.
    """

    mode: str
    data: JointData
    windows: Windows
    first: np.ndarray

    @classmethod
    def of(cls, trials: Sequence[Trajectory], j: int, mode: str, steps: int, logged_speed: bool) -> BaseFit:
        """Joint `j` in complete windows of `steps` samples, evenly thinned, away from end stops and from gaps in the record.

        Args:
            trials: with the channels of the control mode. logged_speed: whether the speed is the logged one, not that of
                the positions.
        """
        starts = [window_starts(t, j, steps) for t in trials]
        first = np.concatenate(starts)
        trial = np.repeat(np.arange(len(trials)), [len(part) for part in starts])
        if len(first) > MOST_WINDOWS:
            kept = np.linspace(0, len(first) - 1, MOST_WINDOWS).round().astype(int)
            first, trial = first[kept], trial[kept]
        begin = first + np.cumsum([0, *(t.samples for t in trials)])[trial]
        bounds = np.stack([begin, begin + steps], axis=1).astype(np.int64)
        dt = float(np.median([t.dt for t in trials]))
        return cls(mode, _data(trials, j, mode, logged_speed), Windows(bounds, trial, steps, dt), first)

    @property
    def mean_square(self) -> float:
        """Of the torque in the windows."""
        return float(np.mean([np.mean(self.data.effort[a : b + 1] ** 2) for a, b in self.windows.bounds]))

    def errors(self, fitted_to: np.ndarray | None = None) -> np.ndarray:
        """(W,) mean squared error of each window, infinite where it runs away; fitted_to: (W,) bool, None for all windows."""
        if not len(self.first):
            return np.zeros(0)
        problem, free = self._problem(fitted_to), _FREE[self.mode]
        problem.outlier[:] = _OUTLIER * np.sqrt(self.mean_square)
        k = problem.fit(free, problem.starts(free)).values
        return self._problem(None).window_errors(k)[0]

    def _problem(self, some: np.ndarray | None) -> Problem:
        windows = self.windows
        if some is not None:
            windows = replace(windows, bounds=windows.bounds[some], trial=windows.trial[some])
        return Problem([self.data], windows, np.ones(1), np.full(1, np.inf))


def _data(trials: Sequence[Trajectory], j: int, mode: str, logged_speed: bool) -> JointData:
    """Joint `j` of trials, end to end."""
    parts = []
    for t in trials:
        command = getattr(t, COMMAND_CHANNEL[mode])[:, j]
        drive = command - t.position[:, j] if mode == "position" else command
        speed = t.velocity[:, j] if logged_speed else step_speed(t.position[:, j], t.dt)
        parts.append((t.effort[:, j], drive, speed, command, t.recorded[:, j]))
    *channels, recorded = (np.concatenate(column) for column in zip(*parts, strict=True))
    return JointData(trials[0].joints[j], *(np.asarray(c, dtype=np.float64) for c in (*channels, recorded)))
