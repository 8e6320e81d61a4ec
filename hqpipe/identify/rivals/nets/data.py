"""Fit trials as a net sees them: standardised inputs end to end, and the places where a sequence may start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.errors import IdentificationError
from hqpipe.identify.free_run import require_channels
from hqpipe.identify.windows import common_dt
from hqpipe.logs.trajectory import Trial

STOPPING_SHARE = 0.2  # of every fit trial, its end, for early stopping; assumption: one part in five, as is usual
GAP_S = 0.5  # before it, used by neither; assumption: longer than the memory of an actuator, as in hqpipe.logs.split
GAP_SHARE = 0.05  # of the trial, at most
STILL = 1e-9  # relative spread of a signal that does not move


@dataclass(frozen=True, eq=False)
class NetData:
    """Samples of all fit trials.

    Attributes:
        joints: names. dt: s.
        inputs: (T, 4 J) torque, target, position, velocity, standardised, the trials end to end. With `error_spread` the
            position error stands in the place of the target.
        stretches: (first, past the last) row of what is trained on. stopping: likewise, for early stopping.
        tensors: mean and spread of inputs and outputs, as in `hqpipe.actuators.net`.
        delta: outputs are changes of torque.
        error_spread: (J,) of target − position, rad; None if the inputs hold the target itself.
    """

    joints: tuple[str, ...]
    dt: float
    inputs: np.ndarray
    stretches: tuple[tuple[int, int], ...]
    stopping: tuple[tuple[int, int], ...]
    tensors: dict[str, np.ndarray]
    delta: bool
    error_spread: np.ndarray | None = None

    def starts(self, stretches: Sequence[tuple[int, int]], length: int, every: int = 1) -> np.ndarray:
        """(S,) first rows of the sequences of `length` rows that lie within one stretch.

        Raises:
            IdentificationError: there is none.
        """
        found = [np.arange(first, last - length + 1, every) for first, last in stretches]
        rows = np.concatenate(found) if found else np.empty(0, dtype=int)
        if not rows.size:
            longest = max((last - first for first, last in stretches), default=0)
            raise IdentificationError(
                f"a net needs {length} samples in one piece ({length * self.dt:.3g} s), the longest piece of the fit trials "
                f"has {longest}: record longer trials, or take a shorter window or history"
            )
        return rows


def net_data(trials: list[Trial], *, delta: bool = False, errors: bool = False, stopping: bool = False) -> NetData:
    """Standardise fit trials and, for `stopping`, set the end of each aside.

    A position error is small beside the motion that target and position share, and what drives the torque hangs on it.
    With `errors` a net is trained on it directly; `for_targets` turns the result into one that reads targets.

    Raises:
        IdentificationError: no trial, a channel is missing, or the rates differ.
    """
    if not trials:
        raise IdentificationError("no trial to fit: expected at least one with split: fit")
    for trial in trials:
        require_channels(trial.trajectory, ("effort", "position_command"), "a net")
    dt, joints = common_dt(trials), trials[0].trajectory.joints
    rows, changes, train, stop, at = [], [], [], [], 0
    for trial in trials:
        t = trial.trajectory.for_joints(joints)
        rows.append(np.concatenate([t.effort, t.position_command, t.position, t.velocity], axis=1))
        changes.append(np.diff(t.effort, axis=0))
        cut, gap = t.samples, 0
        if stopping:
            cut = round((1.0 - STOPPING_SHARE) * t.samples)
            gap = round(min(GAP_S / dt, GAP_SHARE * t.samples))
            stop.append((at + cut, at + t.samples))
        train.append((at, at + cut - gap))
        at += t.samples
    table = np.concatenate(rows)
    mean, spread = table.mean(axis=0), _spread(table)
    count, change = len(joints), np.concatenate(changes)
    tensors = {
        "input_mean": mean,
        "input_spread": spread,
        "output_mean": change.mean(axis=0) if delta else mean[:count],
        "output_spread": _spread(change) if delta else spread[:count],
    }
    inputs, error_spread = (table - mean) / spread, None
    if errors:
        error = table[:, count : 2 * count] - table[:, 2 * count : 3 * count]
        error_spread = _spread(error)
        inputs[:, count : 2 * count] = (error - error.mean(axis=0)) / error_spread
    return NetData(joints, dt, inputs, tuple(train), tuple(stop), tensors, delta, error_spread)


def for_targets(weight: np.ndarray, data: NetData) -> np.ndarray:
    """Input weights (N, rows, taps · 4 j) of nets that read position errors as those of nets that read targets.

    Both are linear in the same numbers and their means agree, so that the nets stay what they are.
    """
    if data.error_spread is None:
        return weight
    nets, count = len(weight), len(data.joints)
    before = weight.reshape(nets, weight.shape[1], -1, 4, count // nets)
    by_net = (nets, 1, 1, count // nets)
    per_error = before[..., 1, :] / data.error_spread.reshape(by_net)
    target, position = (data.tensors["input_spread"][c * count : (c + 1) * count].reshape(by_net) for c in (1, 2))
    moved = before.copy()
    moved[..., 1, :] = per_error * target
    moved[..., 2, :] -= per_error * position
    return moved.reshape(weight.shape)


def _spread(table: np.ndarray) -> np.ndarray:
    """Standard deviation of every column, 1 where it does not move."""
    spread = table.std(axis=0)
    return np.where(spread > STILL * np.abs(table).max(axis=0), spread, 1.0)
