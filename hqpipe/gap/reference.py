"""A flexible reference model: how much of the gap could be explained at all, and by which signals.

The missing part of the model is taken for an unknown function φ(inputs) added in every step. It passes
through the model's own memory, so that the free-running residual after h steps is z_h = a z_(h−1) + φ_(h−1)
with z_0 = 0; a reading error of the torque sensor adds to the residual at once. φ is a ridge regression on
the shapes of `hqpipe.gap.signals`. Signals are taken in one after another (forward selection) while the error
of a cross-validation within the fit trials falls; the held-out trials only score the result. Trials count
alike whatever the size of their residual, so that one violent trial does not set the coefficients for all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.gap.replay import Replay
from hqpipe.gap.signals import joint_signals, spread

RIDGE = 1e-4  # of the mean diagonal: enough against collinear shapes, too little to bias
FOLDS = 4
MAX_ROWS = 8_000  # per joint and split: more rows of a correlated residual add nothing
MIN_GAIN = 0.002  # of the squared residual in cross-validation, for a signal to be taken in
DIRECT = (
    "torque",
    "torque_at_restart",
    "velocity_sign",
    "position",
)  # signals that a torque sensor's reading error can hang on
OFFSET = "constant"


@dataclass(frozen=True, eq=False)
class Explained:
    """What the reference model explains of one joint's held-out residual.

    Attributes:
        signals: signal → drop of the held-out mean squared residual when it was taken in, (N·m)²; in order.
        before: (windows,) squared residual summed over the scored samples of each window, (N·m)².
        after: the same with the reference model's correction.
    """

    signals: dict[str, float]
    before: np.ndarray
    after: np.ndarray


@dataclass(frozen=True, eq=False)
class _Design:
    x: np.ndarray  # (rows, F)
    y: np.ndarray  # (rows,)
    weight: np.ndarray  # (rows,) 1 / RMS of the trial's residual
    window: np.ndarray  # (rows,) running number of the window
    windows: int


def explain(fit: list[Replay], heldout: list[Replay], j: int, pole: float) -> Explained:
    """Fit the reference model of joint `j` on the fit trials and score it on the held-out ones.

    Args:
        fit, heldout: trials with complete windows.
        j: joint index.
        pole: a, what the model remembers after one step.
    """
    scale = spread(fit)
    design, columns = _design(fit, j, pole, scale)
    test, _ = _design(heldout, j, pole, scale)
    size = np.sqrt(np.mean(design.x**2, axis=0)) + 1e-300
    folds = _normal_equations(design, size)
    order = _forward(folds, columns)
    before = np.bincount(test.window, test.y**2, test.windows)
    after, signals, last = before, {}, float(np.mean(test.y**2))
    gram, side = folds.grams.sum(axis=0), folds.sides.sum(axis=0)
    chosen: list[int] = []
    for name in order:
        chosen += columns[name]
        theta = _solve(gram[np.ix_(chosen, chosen)], side[chosen])
        error = test.y - test.x[:, chosen] @ (theta / size[chosen])
        signals[name] = last - float(np.mean(error**2))
        last = float(np.mean(error**2))
        after = np.bincount(test.window, error**2, test.windows)
    return Explained(signals=signals, before=before, after=after)


@dataclass(frozen=True, eq=False)
class _Folds:
    grams: np.ndarray  # (folds, F, F)
    sides: np.ndarray  # (folds, F)
    energy: np.ndarray  # (folds,)


def _normal_equations(design: _Design, size: np.ndarray) -> _Folds:
    """Normal equations of contiguous folds, weighted, with columns scaled to unit `size`."""
    edges = np.searchsorted(design.window, np.arange(FOLDS + 1) * design.windows / FOLDS)
    grams, sides, energy = [], [], []
    for start, stop in zip(edges[:-1], edges[1:], strict=True):
        weight = design.weight[start:stop]
        x = design.x[start:stop] * weight[:, None] / size
        y = design.y[start:stop] * weight
        grams.append(x.T @ x)
        sides.append(x.T @ y)
        energy.append(y @ y)
    return _Folds(np.array(grams), np.array(sides), np.array(energy))


def _forward(folds: _Folds, columns: dict[str, list[int]]) -> list[str]:
    """Signals in the order in which they lower the cross-validated error, until none lowers it by 0.2 %."""
    order: list[str] = []
    chosen: list[int] = []
    total = best = float(folds.energy.sum())
    while len(order) < len(columns):
        rest = [name for name in columns if name not in order]
        errors = [_cross_validated(folds, chosen + columns[name]) for name in rest]
        winner = int(np.argmin(errors))
        if not errors[winner] < best - MIN_GAIN * total:
            break
        best = errors[winner]
        order.append(rest[winner])
        chosen += columns[rest[winner]]
    return order


def _cross_validated(folds: _Folds, chosen: list[int]) -> float:
    """Summed squared error of each fold under the fit to the other folds, from the normal equations alone."""
    inside = np.ix_(chosen, chosen)
    grams = np.array([gram[inside] for gram in folds.grams])
    sides = folds.sides[:, chosen]
    total = 0.0
    for gram, side, energy in zip(grams, sides, folds.energy, strict=True):
        theta = _solve(grams.sum(axis=0) - gram, sides.sum(axis=0) - side)
        total += energy - 2.0 * theta @ side + theta @ gram @ theta
    return float(total)


def _solve(gram: np.ndarray, side: np.ndarray) -> np.ndarray:
    ridge = RIDGE * np.trace(gram) / len(gram) + 1e-300
    return np.linalg.solve(gram + ridge * np.eye(len(gram)), side)


def _design(
    replays: list[Replay], j: int, pole: float, scale: dict[str, np.ndarray]
) -> tuple[_Design, dict[str, list[int]]]:
    """Rows of the regression, thinned to about `MAX_ROWS`, and the columns that belong to each signal."""
    every = max(1, sum(r.windows * r.steps for r in replays) // MAX_ROWS)
    rows, targets, weight, window, seen = [], [], [], [], 0
    names: list[str] = []
    for item in replays:
        groups = joint_signals(item, j, scale)
        driven = {OFFSET: [np.ones(len(item.predicted))]} | groups
        direct = {name: groups[name] for name in DIRECT}
        names = [name for part in (driven, direct) for name, shapes in part.items() for _ in shapes]
        x = np.concatenate([_through_memory(item.inputs(_stack(driven)), pole), item.targets(_stack(direct))], axis=2)
        kept, judged = _last_of(item.steps, every), item.targets(item.counts[:, j])[:, 0]
        y = item.targets(item.residual[:, j])[judged][:, kept]
        rows.append(x[judged][:, kept].reshape(-1, x.shape[2]))
        targets.append(y.ravel())
        rms = np.sqrt(np.mean(item.residual[item.counts[:, j], j] ** 2)) + np.finfo(float).tiny
        weight.append(np.full(y.size, 1.0 / rms))
        window.append(np.repeat(np.flatnonzero(judged) + seen, y.shape[1]))
        seen += item.windows
    columns = {name: [k for k, other in enumerate(names) if other == name] for name in dict.fromkeys(names)}
    parts = (np.concatenate(part) for part in (rows, targets, weight, window))
    return _Design(*parts, seen), columns


def _stack(groups: dict[str, list[np.ndarray]]) -> np.ndarray:
    return np.stack([shape for shapes in groups.values() for shape in shapes], axis=1)


def _last_of(steps: int, every: int) -> np.ndarray:
    """Evenly thinned steps of a window, its last one among them."""
    return np.arange(steps - 1, -1, -min(every, steps))[::-1]


def _through_memory(inputs: np.ndarray, pole: float) -> np.ndarray:
    """z_h = a z_(h−1) + φ_(h−1), z_0 = 0, within each window; (windows, W, F) in and out."""
    driven = inputs.copy()
    for h in range(1, inputs.shape[1]):
        driven[:, h] += pole * driven[:, h - 1]
    return driven
