"""The logged signals of one joint as the simulation wants them, and the windows in which it is judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from hqpipe.layers.servo.scale import VOLTAGE, Scale, duty_of
from hqpipe.logs.differentiate import differentiate, window_s
from hqpipe.logs.survey.end_stop import EndStop
from hqpipe.logs.trajectory import Trial

_ORDER = 3  # of the polynomial that smooths, as in hqpipe.logs.differentiate
_SLOWEST = 1.0  # s; assumption: slower responses are those of a load, and not of a servo
_LAGS = 60  # between one sample and that; assumption: 10 % from one to the next is near enough for a window's length
_AT_STOP = 2e-3  # of the travel, as in hqpipe.logs.survey.end_stop


@dataclass(frozen=True, eq=False)
class Tracks:
    """All trials of one split, end to end.

    Attributes:
        files: R names. trial: (N,) index. time: (N,) s since the trial began. dt: (R,) s.
        position: (N,) as logged. smooth, velocity: (N,) zero-phase. inputs: (N,) position command, or duty × voltage.
        command: (N,) position command, NaN without one. rate: (N,) its zero-phase rate, 0 without one.
        usable: (N,) recorded, and not at an end stop.
    """

    files: tuple[str, ...]
    trial: np.ndarray
    time: np.ndarray
    dt: np.ndarray
    position: np.ndarray
    smooth: np.ndarray
    velocity: np.ndarray
    inputs: np.ndarray
    command: np.ndarray
    rate: np.ndarray
    usable: np.ndarray


@dataclass(frozen=True, eq=False)
class Windows:
    """(M,) each: index of the first sample, index of the first sample of its stretch, and index of its trial."""

    start: np.ndarray
    first: np.ndarray
    trial: np.ndarray

    def of(self, kept: np.ndarray) -> Windows:
        """Those of an index or a mask."""
        return Windows(self.start[kept], self.first[kept], self.trial[kept])


def smoothing(dt: float) -> int:
    """Samples over which the initial state is fitted, as by `differentiate`."""
    return int(round(window_s(dt) / dt))


def state_noise(dt: float) -> tuple[float, float]:
    """Standard deviations of an initial position and velocity per unit of white noise on the position."""
    samples = smoothing(dt)
    position = savgol_coeffs(samples, _ORDER)
    velocity = savgol_coeffs(samples, _ORDER, deriv=1, delta=dt)
    return float(np.sqrt(position @ position)), float(np.sqrt(velocity @ velocity))


def tracks_of(
    trials: Sequence[Trial], rows: Sequence[int], joint: str, scale: Scale, stops: Sequence[EndStop], travel: float
) -> Tracks:
    """Signals of one joint.

    Args:
        trials: of one split. rows: their indices into the numbers of `scale`.
        stops: end stops of this joint. travel: of it, unit of the position.
    """
    parts: dict[str, list[np.ndarray]] = {
        name: [] for name in Tracks.__dataclass_fields__ if name not in ("files", "dt")
    }
    for number, (trial, row) in enumerate(zip(trials, rows, strict=True)):
        t = trial.trajectory
        j, dt = t.joint(joint), t.dt
        q = np.ascontiguousarray(t.position[:, j])
        usable = t.recorded[:, j].copy()
        for stop in stops:
            usable &= np.abs(q - stop.position) > _AT_STOP * travel
        duty = duty_of(t, joint)
        command = None if t.position_command is None else t.position_command[:, j]
        if scale.duty:
            u = duty * (t.extra[VOLTAGE] if scale.volts is None else scale.volts[row])
        else:
            u = command
        samples = smoothing(dt)
        parts["trial"].append(np.full(len(q), number))
        parts["time"].append(t.start + t.time)
        parts["position"].append(q)
        parts["smooth"].append(savgol_filter(q, min(samples, len(q) - 1 + len(q) % 2), _ORDER))
        parts["velocity"].append(differentiate(q[:, None], dt)[:, 0])
        parts["inputs"].append(np.ascontiguousarray(u, dtype=np.float64))
        parts["command"].append(np.full(len(q), np.nan) if command is None else command)
        parts["rate"].append(np.zeros(len(q)) if command is None else _rate(command, dt))
        parts["usable"].append(usable)
    joined = {name: np.concatenate(values) if values else np.empty(0) for name, values in parts.items()}
    joined["trial"] = joined["trial"].astype(np.int64)
    joined["usable"] = joined["usable"].astype(bool)
    return Tracks(tuple(t.file for t in trials), dt=np.array([t.trajectory.dt for t in trials]), **joined)


def _rate(command: np.ndarray, dt: float) -> np.ndarray:
    """(T,) rate of a command that may be a staircase: slope over four times the span of its median step, zero-phase."""
    changes = np.flatnonzero(np.diff(command) != 0.0)
    step = int(np.median(np.diff(changes))) if len(changes) > 1 else 1
    span = max(smoothing(dt), 4 * step) | 1
    if span >= len(command):
        return np.gradient(command, dt)
    return savgol_filter(command, span, 1, deriv=1, delta=dt)


def windows_of(tracks: Tracks, samples: int, run_in: int) -> Windows:
    """Windows of `samples` + 1 samples, end to end within each stretch without gaps, each after a run-in of `run_in` samples.

    A stretch ends where a trial does and where more than a tenth of a window is not usable; single samples that are not are
    left out of the judgement.
    """
    bridged = _bridged(tracks, max(1, samples // 10))
    edges = np.flatnonzero(np.diff(bridged, prepend=-1, append=-1) != 0)
    starts, firsts = [], []
    for begin, end in zip(edges[:-1], edges[1:], strict=True):
        if bridged[begin] < 0:
            continue
        if begin > 0 and tracks.trial[begin - 1] == tracks.trial[begin]:  # after a gap, which is no base for a velocity
            begin += smoothing(tracks.dt[tracks.trial[begin]]) // 2
        at = np.arange(begin, end - samples - run_in, samples)
        at = at[tracks.usable[at]]
        starts.append(at)
        firsts.append(np.full(len(at), begin))
    start = np.concatenate(starts or [np.empty(0)]).astype(np.int64)
    first = np.concatenate(firsts or [np.empty(0)]).astype(np.int64)
    return Windows(start, first, tracks.trial[start])


def _bridged(tracks: Tracks, longest: int) -> np.ndarray:
    """(N,) index of the trial, −1 within a gap longer than `longest` samples."""
    result = tracks.trial.copy()
    edges = np.flatnonzero(np.diff(tracks.usable.astype(np.int8), prepend=1, append=1))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        if end - begin > longest:
            result[begin:end] = -1
    return result


def response_time(tracks: Tracks, follows: np.ndarray | None) -> float:
    """s by which the joint follows its input: lag of the best correlation, between two samples and 1 s.

    Args:
        follows: (N,) position command; None where only a duty is logged, which the speed follows.
    """
    dt = float(np.median(tracks.dt))
    cause, effect = (tracks.inputs, tracks.velocity) if follows is None else (follows, tracks.smooth)
    shifts = np.unique(np.geomspace(1.0, max(_SLOWEST / dt, 2.0), _LAGS).round().astype(np.int64))
    trials = [np.flatnonzero(tracks.trial == number) for number in range(len(tracks.files))]
    match = [
        sum(_alike(cause[rows], effect[rows], tracks.usable[rows], shift) * len(rows) for rows in trials)
        for shift in shifts
    ]
    return float(np.clip(shifts[int(np.argmax(match))] * dt, 2.0 * dt, _SLOWEST))


def _alike(cause: np.ndarray, effect: np.ndarray, usable: np.ndarray, shift: int) -> float:
    """Correlation of two signals, the second `shift` samples late; 0 where too little of them overlaps."""
    if len(cause) <= 2 * shift:
        return 0.0
    both = usable[:-shift] & usable[shift:]
    if both.sum() <= shift:
        return 0.0
    a, b = cause[:-shift][both], effect[shift:][both]
    a, b = a - a.mean(), b - b.mean()
    norm = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / norm if norm > 0.0 else 0.0
