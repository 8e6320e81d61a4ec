"""The two-chamber model over windows of one or several joints, in the form that the one fit asks for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqpipe.actuators.loops.chamber_windows import replay
from hqpipe.actuators.two_chamber import TwoChamber
from hqpipe.identify.least_squares import Fitter, Solution
from hqpipe.identify.model import Parameter, Samples
from hqpipe.identify.normal_equations import NormalEquations
from hqpipe.identify.outliers import huber
from hqpipe.identify.windows import JointData, Windows

PARAMETERS = tuple(
    name for name in TwoChamber.FIELDS if name not in ("speed_limit", "middle", "sample_time", "effort_limit")
)


class ChamberModel:
    """Joints that share one set of parameters, free-running in windows from the logged torque; a `JointModel` without effects.

    Args:
        joints: data of each joint.
        windows: the same for every joint.
        settings: (J, 4) the columns of `TwoChamber` that are not fitted: speed limit, middle, sample time, effort limit.
        lower, upper: (P,) bounds.

    Attributes:
        outlier: (J,) N·m, errors beyond count linearly (Huber 1964).
    """

    unit, effects, noise, notes = "N·m", (), (0.0, 0.0), ()

    def __init__(
        self, joints: list[JointData], windows: Windows, settings: np.ndarray, lower: np.ndarray, upper: np.ndarray
    ) -> None:
        self.joints, self.windows, self.settings, self.lower, self.upper = joints, windows, settings, lower, upper
        self.joint, self.dt = joints[0].joint if len(joints) == 1 else "all", windows.dt
        self.outlier = np.full(len(joints), np.inf)
        self.base = tuple(
            Parameter(name, TwoChamber.FIELDS[name].unit, low, np.inf, low, high)
            for name, low, high in zip(PARAMETERS, lower, upper, strict=True)
        )
        self._fresh = np.diff(windows.trial, prepend=-1) != 0
        first, last = windows.bounds.T
        predicted = np.concatenate([np.arange(a + 1, b + 1) for a, b in zip(first, last, strict=True)])
        owner = np.repeat(np.arange(len(first)), last - first)
        # What starts from a torque that was not recorded says nothing.
        counts = [(data.weight[predicted] > 0.0) & (data.weight[first][owner] > 0.0) for data in joints]
        self._predicted = [predicted[kept] for kept in counts]
        self._owner = np.concatenate([owner[kept] for kept in counts])
        self._root = [np.sqrt(data.weight[at]) for data, at in zip(joints, self._predicted, strict=True)]
        self._position = [np.ascontiguousarray(data.command - data.error) for data in joints]
        self.fit, self.heldout = self._samples(counts, owner), Samples((), *(np.zeros(0, dtype=t) for t in "ifffff"))

    def alone(self, j: int) -> ChamberModel:
        """The model of one of the joints by itself."""
        found = ChamberModel([self.joints[j]], self.windows, self.settings[[j]], self.lower, self.upper)
        found.outlier = self.outlier[[j]]
        return found

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        """(N,) simulated − measured torque of all samples that count, joint after joint, N·m.

        The square of each is its loss: weighted, and linear in an error beyond `outlier`.
        """
        if heldout:
            return np.zeros(0)
        parts = zip(self.residuals(values), self.outlier, self._root, strict=True)
        return np.concatenate([root * huber(residual, outlier) for residual, outlier, root in parts])

    def residuals(self, values: np.ndarray) -> list[np.ndarray]:
        """(S,) simulated − measured torque of the samples that count, per joint, N·m."""
        return [self._residual(values, j) for j in range(len(self.joints))]

    def at(self, solution: Solution) -> NormalEquations:
        """Normal equations of a fit, window by window."""
        free = np.isin(np.arange(len(self.base)), solution.free)
        count = len(self.windows.bounds)
        return NormalEquations.of(solution.jacobian, solution.error, self._owner, count, free)

    def _residual(self, values: np.ndarray, j: int) -> np.ndarray:
        data, simulated = self.joints[j], np.empty(len(self.joints[j].effort))
        row = np.concatenate((values, self.settings[j]))
        signals = (data.effort, data.command, self._position[j], data.velocity)
        replay(row, *signals, self.windows.bounds, self._fresh, simulated)
        return (simulated - data.effort)[self._predicted[j]]

    def _samples(self, counts: list[np.ndarray], owner: np.ndarray) -> Samples:
        """What the fit asks for: the trial of each sample, each joint's own, and its signals."""
        trials = int(self.windows.trial.max()) + 1
        trial = np.concatenate([self.windows.trial[owner[kept]] + j * trials for j, kept in enumerate(counts)])
        files = tuple(f"{data.joint} {t}" for data in self.joints for t in range(trials))
        start = self.windows.bounds[:, 0]
        columns = [
            (at * self.dt, position[at], data.velocity[at], data.effort[at], data.effort[start[owner[kept]]])
            for data, position, at, kept in zip(self.joints, self._position, self._predicted, counts, strict=True)
        ]
        return Samples(files, trial, *(np.concatenate(column) for column in zip(*columns, strict=True)))


def fitted(model: ChamberModel, free: np.ndarray, starts: Sequence[np.ndarray]) -> Solution:
    """The one fit of the free parameters, from the start that predicts best; what is not free stays there.

    Args:
        free: (P,) bool. starts: of (P,).
    """
    fitter = Fitter(model)
    starts = [np.clip(start, fitter.low, fitter.high) for start in starts]
    best = min(starts, key=lambda start: float(np.sum(fitter.error(start) ** 2)))
    return fitter.fit(np.flatnonzero(free), [best], 0.0)
