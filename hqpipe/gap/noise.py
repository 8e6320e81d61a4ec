"""The noise floor: the free-running error that would be left if the model were right.

The one-step residual of a right model is white noise of two kinds. Sensor noise n enters twice, at the
predicted sample and through the torque that the step starts from, so its spectrum is n |1 − a e^(−jω)|²,
which almost vanishes at low frequency; `hqpipe.sysid.noise` bounds it. Noise p in the drive is flat. A wrong
model adds a residual that falls off with frequency, as the motion does; f⁻² and f⁻⁴ take that up. The four
are fitted to the spectrum with weights ≥ 0, by Whittle's likelihood.

Free running, sensor noise counts once and once more through the restart, and drive noise builds up:
floor(h) = n (1 + d(h)²) + p Σ_{i<h} d(i)², where d(h) is what the model remembers after h steps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqpipe.gap.replay import Replay

SEGMENT_S = 0.512
_MIN_SEGMENTS = 8
_UPDATES = 300
_LEAST = 1e-12  # of the largest power; keeps a spectrum with empty bins from infinite weights
_REPEAT = 1e-6  # of the command's standard deviation: repeats are the same numbers, up to float32


def free_run_floor(replays: Sequence[Replay], sensor: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """(J,) mean squared free-running error that noise alone leaves, (N·m)².

    Trials with the same command are compared with each other, because there the model's own error cancels;
    without such repeats the floor comes from the noise of the torque sensor and of the drive.

    Args:
        replays: trials.
        sensor: (J,) upper bound of the variance of the torque sensor's noise, (N·m)².
        kept: (W, J) what the model remembers after 1 … W steps, see `hqpipe.gap.replay.memory`.
    """
    if pairs := repeats(replays):
        return np.mean([_difference(replays[a], replays[b]) for a, b in pairs], axis=0)
    sensor, drive = separate(replays, sensor, kept[0])
    powers = np.vstack([np.ones((1, kept.shape[1])), kept[:-1]]) ** 2
    steps = sensor * (1.0 + kept**2) + drive * np.cumsum(powers, axis=0)
    return steps.mean(axis=0)


def repeats(replays: Sequence[Replay]) -> list[tuple[int, int]]:
    """Pairs of trials whose commands are the same numbers."""
    found = []
    for a in range(len(replays)):
        for b in range(a):
            first, second = replays[a].trajectory.position_command, replays[b].trajectory.position_command
            if first.shape == second.shape and np.ptp(first, axis=0).any():
                if (np.abs(first - second).max(axis=0) <= _REPEAT * first.std(axis=0)).all():
                    found.append((b, a))
    return found


def _difference(a: Replay, b: Replay) -> np.ndarray:
    if a.judged is None and b.judged is None:
        return np.mean(a.targets(a.residual - b.residual) ** 2, axis=(0, 1)) / 2.0
    both = a.counts & b.counts  # the same command does not bring a joint to its stop at the same sample
    square = np.where(both, a.residual - b.residual, 0.0) ** 2
    return square.sum(axis=0) / np.maximum(both.sum(axis=0), 1) / 2.0


def separate(replays: Sequence[Replay], bound: np.ndarray, pole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variances of the sensor's noise and of the drive's, which enters in every step; each (J,), (N·m)².

    Args:
        replays: trials.
        bound: (J,) upper bound of the sensor's variance, (N·m)².
        pole: (J,) a, what the model remembers after one step.
    """
    frequency, power = _spectrum(replays)
    relative = frequency / frequency[-1]
    falling = [np.ones_like(relative), relative**-2.0, relative**-4.0]
    sensor, drive = np.empty((2, len(pole)))
    for j, a in enumerate(pole):
        if a == 0.0:  # nothing is remembered: white noise of a speed, or that of the positions between which it lies
            stepped = np.abs(1.0 - np.exp(-2j * np.pi * frequency)) ** 2
            white, between = _fit([falling[0], stepped, *falling[1:]], power[:, j])[:2]
            sensor[j], drive[j] = min(white + 2.0 * between, bound[j]), 0.0
            continue
        twice = np.abs(1.0 - a * np.exp(-2j * np.pi * frequency)) ** 2
        sensor[j], drive[j] = _fit([twice, *falling], power[:, j])[:2]
        if sensor[j] > bound[j]:
            sensor[j] = bound[j]
            drive[j] = _fit(falling, power[:, j], known=bound[j] * twice)[0]
    return sensor, drive


def _fit(shapes: list[np.ndarray], power: np.ndarray, known: np.ndarray | float = 0.0) -> np.ndarray:
    """Weights ≥ 0 of `shapes` that maximise Whittle's likelihood of the spectrum, Σ −ln S − P / S.

    Multiplicative updates (Févotte, Bertin and Durrieu, Neural Computation 21, 2009) keep the weights ≥ 0 and
    never lower the likelihood, over any number of decades.
    """
    basis = np.column_stack(shapes)
    top = power.max()
    if top <= 0.0:  # a joint that stands still in most segments
        return np.zeros(basis.shape[1])
    power, known = power / top, known / top
    weights = np.maximum(np.median(power), _LEAST) / np.median(basis, axis=0)
    for _ in range(_UPDATES):
        height = basis @ weights + known + _LEAST
        weights = weights * np.sqrt((basis.T @ (power / height**2)) / (basis.T @ (1.0 / height)))
    return top * weights


def _common_length(lengths: Sequence[int]) -> int:
    """The shortest length but for those of few samples: trials at least as long hold most of all samples."""
    ordered = np.sort(np.asarray(lengths))
    return int(ordered[np.cumsum(ordered) > 0.1 * ordered.sum()][0])


def _spectrum(replays: Sequence[Replay]) -> tuple[np.ndarray, np.ndarray]:
    """Frequency in cycles per sample without 0, and the power (F, J) of the one-step residual.

    Welch's method with the median over segments, which an impact in a few of them does not move; segments in which a coarse
    sensor shows no change at all say nothing of its noise. The scale is such that white noise of variance v has power v.
    """
    dt = replays[0].trajectory.dt
    shortest = _common_length([len(r.one_step) - 1 for r in replays])
    length = max(8, min(round(SEGMENT_S / dt), shortest // _MIN_SEGMENTS))
    taper = np.hanning(length + 2)[1:-1, None]
    segments, spoilt = [], []
    for item in replays:
        residual = (item.trajectory.effort - item.one_step)[1:]
        for start in range(0, len(residual) - length + 1, max(1, length // 2)):
            part = residual[start : start + length]
            found = np.abs(np.fft.rfft(taper * (part - part.mean(axis=0)), axis=0)) ** 2
            still = np.ptp(item.trajectory.effort[start + 1 : start + 1 + length], axis=0) == 0.0
            segments.append(np.where(still, np.nan, found))
            spoilt.append(~item.counts[start + 1 : start + 1 + length].all(axis=0))
    segments, spoilt = np.array(segments), np.array(spoilt)
    segments = np.where((spoilt & ~spoilt.all(axis=0))[:, None, :], np.nan, segments)
    some = ~np.isnan(segments).all(axis=0)
    middle = np.zeros(some.shape)
    middle[some] = np.nanmedian(segments[:, some], axis=0)
    power = middle / np.log(2.0) / np.sum(taper**2)  # median of an exponential is ln 2
    return np.fft.rfftfreq(length)[2:], power[2:]  # the taper spreads the removed mean over two bins
