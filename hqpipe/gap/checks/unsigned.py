"""Channels that lost their sign, and how to give it back.

A current sensor behind a rectifier, or a driver that reports the size of a current, logs |τ|. Such a channel is
never negative, and the linear model "the torque decays and is driven by the position error and the speed" fits it far
better once its sign is restored. A torque that is truly of one sign (a leg that bears weight) gains nothing.
Where it was negative throughout, its size fits as well as itself, but pulls away from the command. That tells it where the
torques that do change their sign pull towards it: a machine may count all torques the other way.

The signs are found by turns: fit the linear model to the signed torque, then choose the signs that fit it best by
dynamic programming, and fit again. Several first guesses are tried, since each may end in a local optimum.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.errors import UsageError
from hqpipe.gap.checks.relations import BLOCK_S, FOLDS
from hqpipe.logs.trajectory import Trajectory, Trial

STEP_S = 0.005  # of the model; assumption: a few steps per zero crossing, noise averaged over some samples
TURNS = 20
SETTLED = 1e-3  # fall of the squared error in a turn, as a share, that ends the search
MAX_STEPS = 8_000  # of the model, over all trials, for the question whether a sign is lost
GUESS_S = (0.0, 0.02, 0.1, 0.5)  # time constants of a low-passed position error whose sign is a first guess
BETTER = 0.85  # of the squared error that a restored sign may leave; one-way torques of the plant leave ≥ 0.94
MIN_SHARE = 0.01  # of the torque (by size) that must come out with either sign: noise round zero makes less; assumption
MIN_ROWS = 200  # of the model; assumption: fewer fit any signs
NEVER = 1e-9  # of the largest value: as negative as rounding makes a channel
SIGMAS = 5.0  # standard errors (jackknife) from which on a torque is said to pull towards its command, or away from it


@dataclass(frozen=True)
class Unsigned:
    """A channel of a joint that lost its sign.

    Attributes:
        channel: "effort" or "velocity". joint: its name. trials: files in which it was found.
        negative_share: share of the channel, by size, that was negative.
        error_ratio: squared error of the linear model with restored signs over that without; about 1 where
            `pulls_away`.
        pulls_away: whether it was negative throughout, so that it pulls away from its command as it was logged.
    """

    channel: str
    joint: str
    trials: tuple[str, ...]
    negative_share: float
    error_ratio: float
    pulls_away: bool = False


def unsigned(trials: Sequence[Trial]) -> list[Unsigned]:
    """Efforts and velocities that are sizes only, over all trials together.

    Args:
        trials: of one machine, with the same joints and channels.
    """
    found: list[Unsigned] = []
    if not trials:
        return found
    parts, files = [t.trajectory for t in trials], tuple(t.file for t in trials)
    for j, joint in enumerate(parts[0].joints):
        for channel, judge in (("velocity", _velocity), ("effort", _effort)):
            if getattr(parts[0], channel) is None or not _never_negative(parts, channel, j):
                continue
            judged = judge(parts, j)
            if judged is None:
                continue
            if judged[1] < BETTER and MIN_SHARE < judged[0] < 1.0 - MIN_SHARE:
                found.append(Unsigned(channel, joint, files, *judged))
            elif channel == "effort" and _pulls(parts, j) < 0:
                found.append(Unsigned(channel, joint, files, *judged, pulls_away=True))
    if any(entry.pulls_away for entry in found) and not _signed_ones_pull(parts):
        found = [entry for entry in found if not entry.pulls_away]
    return found


def never_negative(trials: Sequence[Trial], channel: str) -> list[str]:
    """Joints whose `channel` was recorded and is never negative, in any trial."""
    parts = [t.trajectory for t in trials]
    if not parts or getattr(parts[0], channel) is None:
        return []
    return [joint for j, joint in enumerate(parts[0].joints) if _never_negative(parts, channel, j)]


def _never_negative(parts: list[Trajectory], channel: str, j: int) -> bool:
    values = [getattr(t, channel)[:, j] for t in parts]
    top = max(v.max() for v in values)
    return top > 0 and min(v.min() for v in values) >= -NEVER * top


def _velocity(parts: list[Trajectory], j: int) -> tuple[float, float] | None:
    """Travel of both signs with which a velocity agrees in size only."""
    moved, speed = [], []
    for t in parts:
        span = max(2, round(0.02 / t.dt))
        now = np.arange(0, t.samples - span, span)
        total = np.concatenate([[0.0], np.cumsum(t.velocity[:, j])]) * t.dt
        moved.append(t.position[now + span, j] - t.position[now, j])
        speed.append(total[now + span] - total[now])
    x, y = np.concatenate(moved), np.concatenate(speed)
    energy = (y - y.mean()) @ (y - y.mean())
    if len(x) < MIN_ROWS or not energy or not (x @ x):
        return None
    plain, size = (_left(signal, y) for signal in (x, np.abs(x)))
    return float(-x[x < 0].sum() / np.abs(x).sum()), float(size / max(plain, np.finfo(float).tiny))


def _left(x: np.ndarray, y: np.ndarray) -> float:
    """Squared error of y that a line in x leaves."""
    x, y = x - x.mean(), y - y.mean()
    return float(y @ y - (x @ y) ** 2 / (x @ x))


def _effort(parts: list[Trajectory], j: int) -> tuple[float, float] | None:
    if parts[0].position_command is None:
        return None
    steps = _steps_of(parts, j)
    kept = min(1.0, MAX_STEPS / sum(len(s.size) for s in steps))
    steps = [s.start(round(kept * len(s.size))) for s in steps]
    if sum(len(s.size) for s in steps) < MIN_ROWS:
        return None
    plain = _fit(steps, [np.ones(len(s.size)) for s in steps])[1]
    signs, cost = _search(steps)
    total = sum(float(s.size.sum()) for s in steps)
    negative = sum(float(s.size[sign < 0].sum()) for s, sign in zip(steps, signs, strict=True))
    return negative / max(total, np.finfo(float).tiny), cost / max(plain, np.finfo(float).tiny)


def _pulls(parts: list[Trajectory], j: int) -> int:
    """Whether the effort as logged rises, 1, or falls, −1, as the command pulls ahead; 0 where that is in doubt."""
    steps = _steps_of(parts, j)
    if sum(len(s.size) for s in steps) < MIN_ROWS:
        return 0
    length = round(BLOCK_S / STEP_S)
    blocks = [part for s in steps for part in s.blocks(length)]
    pulls = []
    for left_out in range(FOLDS):
        kept = [block for k, block in enumerate(blocks) if k % FOLDS != left_out]
        pulls.append(_pull(_fit(kept, [np.ones(len(s.size)) for s in kept])[0], kept) if kept else 0.0)
    mean, error = np.mean(pulls), np.sqrt((FOLDS - 1) * np.var(pulls))
    return int(np.sign(mean)) if abs(mean) > SIGMAS * error else 0


def _steps_of(parts: list[Trajectory], j: int) -> list[_Steps]:
    """A joint's effort as it was logged, in every trial."""
    columns = [(t.effort[:, j], t.position_command[:, j], t.position[:, j], t.velocity[:, j]) for t in parts]
    return [_Steps.of(*part, t.dt) for part, t in zip(columns, parts, strict=True)]


def _signed_ones_pull(parts: list[Trajectory]) -> bool:
    """Whether of the efforts that change their sign more pull towards their command than away from it."""
    signed = (j for j in range(len(parts[0].joints)) if not _never_negative(parts, "effort", j))
    return sum(_pulls(parts, j) for j in signed) > 0


def restore_sign(
    effort: Sequence[np.ndarray],
    q_des: Sequence[np.ndarray],
    q: Sequence[np.ndarray],
    qd: Sequence[np.ndarray],
    dt: float,
) -> list[np.ndarray]:
    """Give a torque of which only the size was logged its sign back.

    The sign of the whole is that with which the torque pulls towards the command. Within a few samples of a zero
    crossing, where the size is in the noise, the sign remains uncertain.

    Args:
        effort: one (T,) array per trial of the same joint, N·m; its sign is ignored.
        q_des, q, qd: likewise, rad, rad, rad/s.
        dt: sample time, s.

    Returns:
        One (T,) array per trial, N·m.

    Raises:
        UsageError: the arrays differ in length.
    """
    for part in zip(effort, q_des, q, qd, strict=True):
        if len({values.shape for values in part}) != 1 or part[0].ndim != 1:
            shapes = ", ".join(str(values.shape) for values in part)
            raise UsageError(f"restore_sign: expected effort, q_des, q and qd of one shape (T,), got {shapes}")
    steps = [_Steps.of(*part, dt) for part in zip(map(np.abs, effort), q_des, q, qd, strict=True)]
    signs, _ = _search(steps)
    return [_spread(np.abs(values), sign, s.every) for values, sign, s in zip(effort, signs, steps, strict=True)]


@dataclass(frozen=True, eq=False)
class _Steps:
    """One trial on the model's coarser clock: torque or its size at the samples (K,), and the inputs between them (K, 5)."""

    size: np.ndarray
    inputs: np.ndarray
    every: int

    @classmethod
    def of(cls, effort: np.ndarray, q_des: np.ndarray, q: np.ndarray, qd: np.ndarray, dt: float) -> _Steps:
        every = max(1, round(STEP_S / dt))
        count = len(effort) // every
        error = q_des - q
        now = np.arange(count) * every
        mean = [np.add.reduceat(values[: count * every], now) / every for values in (effort, error, qd)]
        change = [np.append(np.diff(values), 0.0) for values in mean[1:]]
        inputs = np.column_stack([mean[1], change[0], mean[2], change[1], np.ones(count)])
        return cls(mean[0], inputs, every)

    def start(self, count: int) -> _Steps:
        """The first `count` samples."""
        return _Steps(self.size[:count], self.inputs[:count], self.every)

    def blocks(self, length: int) -> Iterator[_Steps]:
        """Parts of so many samples, the last one of what is left."""
        for k in range(0, len(self.size), length):
            yield _Steps(self.size[k : k + length], self.inputs[k : k + length], self.every)


def _search(steps: list[_Steps]) -> tuple[list[np.ndarray], float]:
    """Signs (K,) per trial with the least squared error of the linear model, and that error."""
    from hqpipe.identify.sign_path import sign_path

    best: tuple[list[np.ndarray], float] = ([np.ones(len(s.size)) for s in steps], np.inf)
    for guess in _guesses(steps):
        signs = guess
        last = np.inf
        for _ in range(TURNS):
            model, cost = _fit(steps, signs)
            if not cost < last * (1.0 - SETTLED):
                break
            last, kept = cost, signs
            signs = [sign_path(s.size, model[0], s.inputs @ model[1:])[0] for s in steps]
        if last < best[1]:
            best = kept, last
    signs, cost = best
    model, _ = _fit(steps, signs)
    return ([-sign for sign in signs] if _pull(model, steps) < 0 else signs), cost


def _pull(model: np.ndarray, steps: list[_Steps]) -> float:
    """How the next torque rises with the position error and its change, each times its spread, N·m."""
    return float(sum(model[1 + k] * np.std(np.concatenate([s.inputs[:, k] for s in steps])) for k in (0, 1)))


def _guesses(steps: list[_Steps]) -> list[list[np.ndarray]]:
    """Signs of low-passed position errors, with their mean and without, and of the speed."""
    from scipy.signal import lfilter

    found = []
    mean = np.mean(np.concatenate([s.inputs[:, 0] for s in steps]))
    for span in GUESS_S:
        keep = np.exp(-STEP_S / span) if span else 0.0
        for offset in (0.0, mean):
            found.append(
                [np.where(lfilter([1 - keep], [1, -keep], s.inputs[:, 0] - offset) < 0, -1.0, 1.0) for s in steps]
            )
    found.append([np.where(s.inputs[:, 2] < 0, -1.0, 1.0) for s in steps])
    return found


def _fit(steps: list[_Steps], signs: list[np.ndarray]) -> tuple[np.ndarray, float]:
    """Coefficients (6,) of the next torque on this one and the inputs, and the squared error."""
    rows = [np.column_stack([(s.size * sign)[:-1], s.inputs[:-1]]) for s, sign in zip(steps, signs, strict=True)]
    x = np.concatenate(rows)
    y = np.concatenate([(s.size * sign)[1:] for s, sign in zip(steps, signs, strict=True)])
    scale = np.sqrt(np.mean(x**2, axis=0)) + np.finfo(float).tiny
    model = np.linalg.lstsq((x / scale).T @ (x / scale), (x / scale).T @ y, rcond=1e-12)[0] / scale
    return model, float(np.sum((y - x @ model) ** 2))


def _spread(size: np.ndarray, signs: np.ndarray, every: int) -> np.ndarray:
    """Signs of the coarse samples on all samples; a change is put where the size is least."""
    full = np.repeat(signs, every)
    full = np.append(full, np.full(len(size) - len(full), signs[-1]))
    for k in np.flatnonzero(signs[1:] != signs[:-1]):
        start, stop = k * every, min((k + 2) * every, len(size))
        turn = start + int(np.argmin(size[start:stop]))
        full[start:turn], full[turn:stop] = signs[k], signs[k + 1]
    return size * full
