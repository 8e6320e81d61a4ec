"""How well the channels of each joint explain the channels of each other joint, within one trial.

A relation explains a target of joint t (its motion, the change of its torque) over a short step by linear
regression on inputs of joint i, beside what the target's own past explains. It is scored on rows that were not
fitted: blocks of a quarter of a second, dealt out to the folds in turn, so that each fold sees the whole trial.
Comparing i = t with i ≠ t tells which columns belong together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hqpipe.logs.trajectory import Trajectory

FOLDS = 8
BLOCK_S = 0.25  # assumption: longer than the memory of an actuator, so that a fold is not foreseen by its neighbours
STEP_S = 0.02  # over which the torque and the position change; assumption: above sensor noise, below a motion
ANSWER_S = 0.05  # over which a joint answers its command; assumption
RIDGE = 1e-9  # of the diagonal, against columns that are the same
MIN_ROWS = 10  # per fitted coefficient; assumption
POWERLESS = 1e-12  # of a target's mean square: rounding


@dataclass(frozen=True, eq=False)
class Relation:
    """Joints against joints.

    Attributes:
        channels: what it ties together, by their names in the log format; the target first.
        error: (F, J, J) squared error with the inputs of joint i, by fold, in units of the target's mean square;
            axis 1 is the target's joint, axis 2 the joint of the inputs.
        alone: (F, J) squared error of the target's own past.
        sign: (F, J) sign of the summed slopes of the telling inputs of the own joint, fitted without each fold.
    """

    channels: tuple[str, ...]
    error: np.ndarray
    alone: np.ndarray
    sign: np.ndarray

    @property
    def left(self) -> np.ndarray:
        """(J, J) share of the error of the target's own past that is left with the inputs of joint i."""
        alone = np.sum(self.alone, axis=0)[:, None]
        return np.where(alone > POWERLESS, self.total / np.maximum(alone, POWERLESS), 1.0)

    @property
    def total(self) -> np.ndarray:
        """(J, J) error over all folds."""
        return np.sum(self.error, axis=0)

    def own_without(self) -> np.ndarray:
        """(F, J) logarithm of the own joint's error over all folds but one, for a jackknife."""
        own = np.diagonal(self.error, axis1=1, axis2=2)
        return np.log(own.sum(axis=0) - own + POWERLESS)


@dataclass(frozen=True, eq=False)
class _Parts:
    target: np.ndarray  # (N, J)
    own: np.ndarray  # (N, J, b) its own past
    inputs: np.ndarray  # (N, J, p)
    telling: tuple[float, ...]  # (p,) weights of the slopes that tell the sign, for inputs of unit size


def relations(t: Trajectory) -> list[Relation]:
    """Every relation whose channels were recorded; none if the trial is too short to score them."""
    found = []
    for channels, build in _RELATIONS:
        measured = "velocity" not in channels[:1] or t.velocity_source == "measured"
        if measured and all(getattr(t, name) is not None for name in channels):
            relation = _regress(channels, build(t), block=round(2 * BLOCK_S / max(STEP_S, 2 * t.dt)))
            found += [relation] if relation else []
    return found


def _velocity(t: Trajectory) -> _Parts:
    now, then, _ = _rows(t, STEP_S)
    travelled = np.concatenate([np.zeros((1, len(t.joints))), np.cumsum(t.velocity, axis=0)]) * t.dt
    y = travelled[then] - travelled[now]
    return _Parts(y, np.empty((*y.shape, 0)), (t.position[then] - t.position[now])[:, :, None], (1.0,))


def _towards(t: Trajectory) -> _Parts:
    """Motion towards the command, now and one and two steps ago, from where the joint is."""
    now, then, step = _rows(t, ANSWER_S, past=2)
    here, before = t.position[now], t.position[now - step]
    inputs = np.stack([t.position_command[now - lag * step] for lag in range(3)], axis=2)
    return _Parts(t.position[then] - here, np.stack([here - before, here], axis=2), inputs, (1.0, 1.0, 1.0))


def _flow(t: Trajectory) -> _Parts:
    """Motion by a valve that is open now, or was one or two steps ago: a spool takes its time."""
    now, then, step = _rows(t, ANSWER_S, past=2)
    here, before = t.position[now], t.position[now - step]
    inputs = np.stack([_mean(t.valve_command, now - lag * step, step) for lag in range(3)], axis=2)
    return _Parts(t.position[then] - here, (here - before)[:, :, None], inputs, (1.0, 1.0, 1.0))


def _demand(t: Trajectory) -> _Parts:
    """Torque after a torque command."""
    now, then, step = _rows(t, STEP_S)
    inputs = np.stack([_mean(t.effort_command, now, step), t.effort_command[then], t.effort_command[now]], axis=2)
    return _Parts(t.effort[then] - t.effort[now], t.effort[now][:, :, None], inputs, (1.0, 1.0, 1.0))


def _pull(t: Trajectory) -> _Parts:
    """Torque after a position error."""
    now, then, step = _rows(t, STEP_S)
    error = t.position_command - t.position
    speed = _mean(t.velocity, now, step)
    inputs = [_mean(error, now, step), error[then] - error[now], speed, t.velocity[then] - t.velocity[now]]
    effort = t.effort[now][:, :, None]
    return _Parts(t.effort[then] - t.effort[now], effort, np.stack(inputs, axis=2), (1.0, 1.0, 0.0, 0.0))


def _chambers(t: Trajectory) -> _Parts:
    """Torque of the chamber pressures."""
    now, then, step = _rows(t, STEP_S)
    inputs = [_mean(p, now, step) for p in (t.pressure_a, t.pressure_b)]
    y = _mean(t.effort, now, step)
    return _Parts(y, np.empty((*y.shape, 0)), np.stack(inputs, axis=2), (1.0, 0.0))


_RELATIONS: tuple[tuple[tuple[str, ...], Callable[[Trajectory], _Parts]], ...] = (
    (("velocity", "position"), _velocity),
    (("position", "position_command"), _towards),
    (("position", "valve_command"), _flow),
    (("effort", "effort_command"), _demand),
    (("effort", "position_command", "position", "velocity"), _pull),
    (("effort", "pressure_a", "pressure_b"), _chambers),
)


def _rows(t: Trajectory, span_s: float, past: int = 0) -> tuple[np.ndarray, np.ndarray, int]:
    """First and last rows of overlapping steps of about `span_s`, at least two samples."""
    step = max(2, round(span_s / t.dt))
    now = np.arange(past * step, t.samples - step, max(1, step // 2))
    return now, now + step, step


def _mean(values: np.ndarray, now: np.ndarray, step: int) -> np.ndarray:
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return (total[now + step] - total[now]) / step


def _regress(channels: tuple[str, ...], parts: _Parts, block: int) -> Relation | None:
    rows, joints = parts.target.shape
    b, p = parts.own.shape[2], parts.inputs.shape[2]
    if rows < MIN_ROWS * (1 + b + p) or rows < 2 * FOLDS:
        return None
    pieces = [np.ones((rows, 1)), parts.target, parts.own.reshape(rows, -1), parts.inputs.reshape(rows, -1)]
    columns = np.concatenate(pieces, axis=1)
    columns[:, 1:] -= columns[:, 1:].mean(axis=0)
    size = np.sqrt(np.mean(columns**2, axis=0))
    size = np.where(size > 0, size, 1.0)
    columns = columns / size
    fold = np.arange(rows) // max(1, min(block, rows // (2 * FOLDS))) % FOLDS
    grams = np.array([columns[fold == f].T @ columns[fold == f] for f in range(FOLDS)]) / rows
    target = 1 + np.arange(joints)
    past = 1 + joints + np.arange(joints * b).reshape(joints, b)
    inputs = 1 + joints * (1 + b) + np.arange(joints * p).reshape(joints, p)
    base = np.concatenate([np.zeros((joints, 1), int), past], axis=1)
    full = np.concatenate([np.repeat(base[:, None], joints, axis=1), np.repeat(inputs[None], joints, axis=0)], axis=2)
    alone, _ = _held_out(grams, target, base)
    error, slopes = _held_out(grams, np.repeat(target[:, None], joints, axis=1), full)
    own = np.arange(joints)
    sign = np.sign(np.sum(slopes[:, own, own, 1 + b :] * np.array(parts.telling), axis=2))
    return Relation(channels, error, alone, sign)


def _held_out(grams: np.ndarray, target: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared error of each fold under the fit to the others, (F, …), and the slopes of those fits, (F, …, m)."""
    gram = grams[:, chosen[..., :, None], chosen[..., None, :]]
    side = grams[:, chosen, target[..., None]]
    energy = grams[:, target, target]
    rest = gram.sum(axis=0) - gram
    ridge = RIDGE * np.trace(rest, axis1=-2, axis2=-1)[..., None, None] + POWERLESS
    slopes = np.linalg.solve(rest + ridge * np.eye(chosen.shape[-1]), (side.sum(axis=0) - side)[..., None])[..., 0]
    fitted = np.einsum("...i,...ij,...j->...", slopes, gram, slopes)
    return np.maximum(energy - 2.0 * np.sum(slopes * side, axis=-1) + fitted, 0.0), slopes
