"""The least-squares problem of the two-chamber model over windows of one or several joints."""

from __future__ import annotations

import numpy as np

from hqpipe.actuators.two_chamber import TwoChamber
from hqpipe.identify.normal_equations import NormalEquations
from hqpipe.identify.windows import JointData, Windows
from hqpipe.machine.loops.chamber_windows import replay

PARAMETERS = tuple(
    name for name in TwoChamber.FIELDS if name not in ("speed_limit", "middle", "sample_time", "effort_limit")
)
_NUDGE = 1e-5  # of a parameter's unit size; far above rounding, far below what bends the torque


class ChamberProblem:
    """Joints that share one set of parameters, free-running in windows from the logged torque.

    Args:
        joints: data of each joint.
        windows: the same for every joint.
        settings: (J, 4) the columns of `TwoChamber` that are not fitted: speed limit, middle, sample time, effort limit.
        unit: (P,) size of a typical value of each parameter.
    """

    def __init__(self, joints: list[JointData], windows: Windows, settings: np.ndarray, unit: np.ndarray) -> None:
        self.joints, self.windows, self.settings, self.unit = joints, windows, settings, unit
        self.outlier = np.full(len(joints), np.inf)
        self._fresh = np.diff(windows.trial, prepend=-1) != 0
        first, last = windows.bounds.T
        self._predicted = np.concatenate([np.arange(a + 1, b + 1) for a, b in zip(first, last, strict=True)])
        self._edges = np.concatenate(([0], np.cumsum(last - first)[:-1]))
        self._position = [np.ascontiguousarray(data.command - data.error) for data in joints]

    def alone(self, j: int) -> ChamberProblem:
        """The problem of one of the joints by itself."""
        found = ChamberProblem([self.joints[j]], self.windows, self.settings[[j]], self.unit)
        found.outlier = self.outlier[[j]]
        return found

    def residuals(self, x: np.ndarray) -> list[np.ndarray]:
        """(S,) simulated − measured torque of all predicted samples at the parameters `x` (P,), per joint, N·m."""
        return [self._residual(x, j) for j in range(len(self.joints))]

    def _residual(self, x: np.ndarray, j: int) -> np.ndarray:
        data, simulated = self.joints[j], np.empty(len(self.joints[j].effort))
        row = np.concatenate((x, self.settings[j]))
        signals = (data.effort, data.command, self._position[j], data.velocity)
        replay(row, *signals, self.windows.bounds, self._fresh, simulated)
        return (simulated - data.effort)[self._predicted]

    def cost(self, x: np.ndarray) -> float:
        """Sum of squares, linear beyond `outlier` (Huber 1964)."""
        pairs = zip(self.residuals(x), self.outlier, strict=True)
        return float(sum(_huber(residual, outlier)[1] for residual, outlier in pairs))

    def evaluate(self, x: np.ndarray, free: np.ndarray) -> NormalEquations:
        """Normal equations at `x` (P,) in the parameters that are `free` (P,), zero in the others."""
        count, size = len(self.windows.bounds), len(x)
        hessians, scores, total = np.zeros((count, size, size)), np.zeros((count, size)), 0.0
        index = np.flatnonzero(free)
        for j in range(len(self.joints)):
            residual = self._residual(x, j)
            weight, cost = _huber(residual, self.outlier[j])
            slope = np.empty((len(index), len(residual)))
            for row, i in enumerate(index):
                moved = x.copy()
                moved[i] += _NUDGE * self.unit[i]
                slope[row] = (self._residual(moved, j) - residual) / (moved[i] - x[i])
            weighted = weight * slope
            scores[:, index] += np.add.reduceat(weighted * residual, self._edges, axis=1).T
            for row, i in enumerate(index):
                sums = np.add.reduceat(weighted[row] * slope, self._edges, axis=1)
                hessians[:, i, index] += sums.T
            total += cost
        return NormalEquations(total, hessians, scores)


def _huber(residual: np.ndarray, outlier: float) -> tuple[np.ndarray, float]:
    """Weight of every residual, and the loss of all."""
    size = np.abs(residual)
    gross = size > outlier
    weight, loss = np.ones_like(size), residual * residual
    if gross.any():
        weight[gross] = outlier / size[gross]
        loss[gross] = outlier * (2.0 * size[gross] - outlier)
    return weight, float(loss.sum())
