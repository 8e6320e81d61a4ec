"""Suspicions about channels: swapped or sign-flipped joints, a lost sign, a dead or saturated sensor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hqpipe.logs.findings import Finding
from hqpipe.logs.trajectory import Trajectory, Trial

_FLIPPED = -0.5  # correlation of a joint with its own command
_LATEST_S, _LAGS = (
    0.5,
    50,
)  # by which a slow joint may follow its command, and in how many steps that is tried; assumptions
_SOONER = 0.1  # of a correlation, by which one at the largest lag must be better: of a sine any sign fits at some lag
_CLEARER = 4.0
"""Ratio of the shares that two trials leave unexplained, beyond which the clearer one tells the sign of both; assumption."""
_SWAPPED_OWN, _SWAPPED_CROSS = 0.3, 0.7
_SATURATED_SHARE = 0.02
_SATURATED_RUN = 5  # samples on end at the limit
_SATURATED_LEVELS = 50  # a signal of fewer levels is a square wave or coarsely quantised
_MAX_SAMPLES = 20_000  # enough for a correlation

Pair = tuple[str, str, Callable[[Trajectory], tuple[np.ndarray | None, np.ndarray | None]]]


def _position_error(t: Trajectory) -> np.ndarray | None:
    return None if t.position_command is None else t.position_command - t.position


_PAIRS: tuple[Pair, ...] = (
    ("position", "position command", lambda t: (t.position, t.position_command)),
    ("effort", "position error", lambda t: (t.effort, _position_error(t))),
    ("effort", "effort command", lambda t: (t.effort, t.effort_command)),
)


def wiring_findings(trials: list[Trial]) -> list[Finding]:
    """What looks wrongly connected in a log set whose trials share their joints."""
    joints = trials[0].trajectory.joints
    unsigned = _unsigned(trials)
    found = []
    for first, second, pick in _PAIRS:
        kept = [j for j, name in enumerate(joints) if first != "effort" or name not in unsigned]
        names = tuple(joints[j] for j in kept)
        signals = []
        for trial in trials:
            x, y = pick(trial.trajectory)
            if x is None or y is None or not kept:
                continue
            stride = max(1, len(x) // _MAX_SAMPLES)
            signals.append(
                (trial.file, x[::stride, kept], y[::stride, kept], _LATEST_S / (trial.trajectory.dt * stride))
            )
        for file, x, y, latest in signals:
            likeness = _correlations(x, y)
            text = f"opposes its {second} (correlation {{}}): is a sign flipped?"
            for j in _opposed(x, y, latest, [(a, b, most) for other, a, b, most in signals if other != file]):
                found.append(Finding("sign", file, text, names[j], first, float(likeness[j, j])))
            for text, value in _swaps(first, second, names, likeness):
                found.append(Finding("swap", file, text, size=value))
    text = (
        "is never negative although the joint moves both ways: the sensor seems to have lost the sign (motor current?); "
        "a torque model fitted to it means little"
    )
    found += [Finding("unsigned", t.file, text, joint, "effort") for joint in unsigned for t in trials]
    return found + _still(trials) + _saturated(trials)


def _correlations(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(J, J) correlations of the columns of x with those of y, 0 where one of them stands still."""
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    scale = np.sqrt(np.outer((x**2).sum(axis=0), (y**2).sum(axis=0)))
    return np.divide(x.T @ y, scale, out=np.zeros(scale.shape), where=scale > 0)


def _opposed(
    x: np.ndarray, y: np.ndarray, latest: float, others: list[tuple[np.ndarray, np.ndarray, float]]
) -> list[int]:
    """Joints whose signal (T, J) opposes what it should follow, also where both are most alike, `latest` samples later at most.

    A joint that is half a gait cycle late moves against its command at each instant and is none the less wired rightly, and so
    is one whose command answers to what the load does to it, if it follows far more closely in another trial (`others`).
    """
    found = []
    for j in np.flatnonzero(np.diagonal(_correlations(x, y)) < _FLIPPED):
        own = _at_best_lag(x[:, j], y[:, j], latest)
        rest = max((_at_best_lag(a[:, j], b[:, j], most) for a, b, most in others), key=abs, default=0.0)
        if own < 0.0 and not (rest > 0.0 and _CLEARER * (1.0 - rest**2) < 1.0 - own**2):
            found.append(int(j))
    return found


def _at_best_lag(x: np.ndarray, y: np.ndarray, latest: float) -> float:
    """The correlation of x (T,) with an earlier y (T,) that is largest in size, the sooner one of two alike."""
    lags = np.unique(np.linspace(0, min(latest, len(x) // 2), _LAGS).astype(int))
    values = [_correlations(x[lag:, None], y[: len(y) - lag, None])[0, 0] for lag in lags]
    return float(values[np.argmax(np.abs(values) * np.linspace(1.0, 1.0 - _SOONER, len(values)))])


def _swaps(first: str, second: str, joints: tuple[str, ...], correlation: np.ndarray) -> list[tuple[str, float]]:
    """Swapped joints of one pair of channels, each with the telling correlation of (J, J)."""
    found = []
    for i in range(len(joints)):
        for j in range(i):
            own = max(correlation[i, i], correlation[j, j])
            cross = min(correlation[i, j], correlation[j, i])
            if own < _SWAPPED_OWN and cross > _SWAPPED_CROSS:
                text = (
                    f"{first} of joints {joints[j]} and {joints[i]} may be swapped: each follows the "
                    f"{second} of the other, not its own (correlation {{}})"
                )
                found.append((text, float(cross)))
    return found


def _unsigned(trials: list[Trial]) -> list[str]:
    """Joints whose effort keeps one sign although they move both ways."""
    names = []
    if all(trial.trajectory.effort is not None for trial in trials):
        for j, joint in enumerate(trials[0].trajectory.joints):
            effort = [trial.trajectory.effort[:, j] for trial in trials]
            velocity = [trial.trajectory.velocity[:, j] for trial in trials]
            both_ways = min(v.min() for v in velocity) < 0 < max(v.max() for v in velocity)
            if both_ways and min(e.min() for e in effort) >= 0 and max(e.max() for e in effort) > 0:
                names.append(joint)
    return names


def _still(trials: list[Trial]) -> list[Finding]:
    files = {trial.file for trial in trials}
    where: dict[tuple[str, str], list[str]] = {}
    for trial in trials:
        derived = trial.trajectory.velocity_source != "measured"  # says what the position says
        for channel, values in trial.trajectory.channels().items():
            for j in np.flatnonzero(np.ptp(values, axis=0) == 0.0) if not (derived and channel == "velocity") else ():
                where.setdefault((trial.trajectory.joints[j], channel), []).append(trial.file)
    found = []
    for (joint, channel), there in where.items():
        text = "is constant: such a trial says nothing about that joint"
        if set(there) == files:
            text = "is constant: nothing that needs it can be identified"
        found += [Finding("constant", file, text, joint, channel) for file in there]
    return found


def _saturated(trials: list[Trial]) -> list[Finding]:
    found = []
    text = "is saturated at {}: values beyond the limit are lost"
    for trial in trials:
        for channel in ("effort", "velocity", "valve_command", "pressure_a", "pressure_b"):
            values = getattr(trial.trajectory, channel)
            if values is None or (channel == "velocity" and trial.trajectory.velocity_source != "measured"):
                continue
            for j, joint in enumerate(trial.trajectory.joints):
                if (limit := saturation_limit(values[:, j])) is not None:
                    found.append(Finding("saturated", trial.file, text, joint, channel, limit))
    return found


def saturation_limit(values: np.ndarray) -> float | None:
    """The extreme at which a signal stays for whole runs of samples, or None."""
    for limit in (values.max(), values.min()):
        stuck = values == limit
        if limit == 0.0 or stuck.mean() < _SATURATED_SHARE:
            continue
        edges = np.flatnonzero(np.diff(np.concatenate(([0], stuck.astype(np.int8), [0]))))
        longest = (edges[1::2] - edges[::2]).max()
        if longest >= _SATURATED_RUN and len(np.unique(values)) >= _SATURATED_LEVELS:
            return float(limit)
    return None
