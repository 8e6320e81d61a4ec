"""Base gains of a joint by linear regression, for fits to begin with."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.optimize import nnls

from hqpipe.effects.layout import slot
from hqpipe.gap.joint_data import JointData
from hqpipe.kernels.augmented_windows import changes_of_effort

SPANS = (1, 5, 20)  # samples of the differences: one is biased by noise of the torque, twenty miss fast leakage
MOST_LEAKED = 0.9  # of the torque in a sample, to begin with
RIDGE = 1e-9  # relative: columns that are alike share a gain
SMALLEST = 1e-100  # of a column: below it nothing moves, as where impacts never come


def regressed(data: JointData, row: np.ndarray, most: Mapping[str, float], span: int) -> np.ndarray:
    """A copy of a row whose base gains are regressed on the opening that its effects shape.

    Args:
        row: (WIDTH,). most: coefficient → its upper bound. span: samples of the differences.
    """
    if data.mode == "valve":
        return _flow_gain(data, row)
    s = data.fit.signals
    names = ("k1", "k2", "k3", "k4") if data.mode == "position" else ("k1", "k2", "k3")
    at = s.first[None, :] + np.arange(0, s.steps - span + 1, span)[:, None]
    columns = []
    for change in changes_of_effort(row, s)[: len(names)]:
        total = np.concatenate([[0.0], np.cumsum(change)])
        columns.append((total[at + span] - total[at]).ravel())
    row = row.copy()
    gains = _not_negative(np.stack(columns, axis=1), (s.effort[at + span] - s.effort[at]).ravel())
    for name, gain in zip(names, gains, strict=True):
        row[slot("base", name)] = min(gain, MOST_LEAKED if name == "k2" else most.get(name, np.inf))
    return row


def _not_negative(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(C,) least squares of y (N,) on the columns of x (N, C) without negative gains."""
    gains, size = np.zeros(x.shape[1]), np.sqrt(np.sum(x**2, axis=0))
    used = size > SMALLEST
    if used.any():
        scaled = x[:, used] / size[used]
        root = np.linalg.cholesky(scaled.T @ scaled + RIDGE * np.eye(scaled.shape[1])).T
        gains[used] = nnls(root, np.linalg.solve(root.T, scaled.T @ y))[0] / size[used]
    return np.where(np.isfinite(gains), gains, 0.0)


def _flow_gain(data: JointData, row: np.ndarray) -> np.ndarray:
    """A copy of a row of valve mode with gain and neutral point of the speed against the command."""
    s, row = data.fit.signals, row.copy()
    x = np.stack([s.command, np.ones_like(s.command)], axis=1)
    slope, offset = np.linalg.lstsq(x, s.velocity, rcond=None)[0]
    row[[slot("base", "k1"), slot("base", "neutral")]] = slope, -offset / slope if slope else 0.0
    return row
