"""The stretch of time in each trial in which the errors of a machine's joints are large."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.identify.model import Samples

LEAST_INSIDE = 5  # blocks; assumption: fewer are one motion of the machine rather than a time of its own
LEAST_OUTSIDE = 0.3  # of a trial; assumption: what acts longer is found as a lasting effect
FINER = 10
"""Parts of a block by which an end is found; assumption: more hold too few samples to say how large errors are."""
MOST_BLOCKS = 500
"""Of a trial, so that all pairs of ends can be tried; a fifth of a per cent of it is no ill-defined end."""

Stretches = dict[str, tuple[float, float]]
"""File of a trial → start and end, s from the start of the trial."""


@dataclass(frozen=True, eq=False)
class Shown:
    """One joint in one split.

    Attributes:
        error: (N,) at the samples. noise: root mean square that the sensors leave. dt: s.
    """

    samples: Samples
    error: np.ndarray
    noise: float
    dt: float


def stretches_of(joints: Sequence[Shown], window_s: float) -> Stretches:
    """The stretch of each trial that stands out most, all joints together; none in trials that are too short for one.

    Args:
        window_s: s, length of the blocks of which it is made.
    """
    found = {}
    joints = [joint for joint in joints if np.isfinite(joint.error).all()]
    for file in dict.fromkeys(name for joint in joints for name in joint.samples.files):
        parts = [part for joint in joints if (part := _of_trial(joint, file)) is not None]
        if not parts:
            continue
        block = max(window_s, max(float(part.samples.time.max()) for part in parts) / MOST_BLOCKS)
        edges, height = _heights(parts, block)
        if (ends := most_contrast(height)) is not None:
            found[file] = _sharpened(parts, float(edges[ends[0]]), float(edges[ends[1] - 1] + block), block)
    return found


def inside(samples: Samples, stretches: Stretches, dt: float) -> np.ndarray:
    """(N,) bool, of samples each of which ends a step of `dt` s."""
    found = np.zeros(len(samples.time), dtype=bool)
    for k, file in enumerate(samples.files):
        if file in stretches:
            start, end = stretches[file]
            middle = samples.time - 0.5 * dt
            found |= (samples.trial == k) & (middle >= start) & (middle < end)
    return found


def near_ends(samples: Samples, stretches: Stretches, distance_s: float) -> np.ndarray:
    """(N,) bool, of samples nearer than a time to an end of a stretch."""
    found = np.zeros(len(samples.time), dtype=bool)
    for k, file in enumerate(samples.files):
        for end in stretches.get(file, ()):
            found |= (samples.trial == k) & (np.abs(samples.time - end) < distance_s)
    return found


def most_contrast(height: np.ndarray) -> tuple[int, int] | None:
    """First and last (exclusive) of the neighbouring blocks that stand out most above the others.

    The statistic of Levin and Kline (Statistics in Medicine 4, 1985) for a mean that changes and changes back.

    Args:
        height: (B,) of each block.
    """
    count = len(height)
    most = int((1.0 - LEAST_OUTSIDE) * count)
    if most < LEAST_INSIDE:
        return None
    sums = np.concatenate([[0.0], np.cumsum(height)])
    size = np.arange(count + 1)[None, :] - np.arange(count + 1)[:, None]
    allowed = (size >= LEAST_INSIDE) & (size <= most)
    size = np.where(allowed, size, 1)
    total = sums[None, :] - sums[:, None]
    contrast = total / size - (sums[-1] - total) / np.maximum(count - size, 1)
    contrast = np.where(allowed, contrast * np.sqrt(size * (count - size) / count), -np.inf)
    first, last = np.unravel_index(int(np.argmax(contrast)), contrast.shape)
    return (int(first), int(last)) if contrast[first, last] > 0.0 else None


def _of_trial(joint: Shown, file: str) -> Shown | None:
    """The joint in one trial; None where it has no samples there."""
    s = joint.samples
    here = s.trial == (s.files.index(file) if file in s.files else -1)
    return Shown(s.only(here), joint.error[here], joint.noise, joint.dt) if here.any() else None


def _sharpened(parts: Sequence[Shown], start: float, end: float, block: float) -> tuple[float, float]:
    """The ends of a stretch, each moved by a block at most to where small blocks turn from large errors to small ones."""
    small = max(block / FINER, max(part.dt for part in parts))
    edges, height = _heights(parts, small)
    middle = edges + 0.5 * small
    here = (middle >= start) & (middle < end)
    if here.all():
        return start, end
    above = height - 0.5 * (height[here].mean() + height[~here].mean())
    moved = []
    for at, sign in ((start, -1.0), (end, 1.0)):
        near = np.flatnonzero(np.abs(middle - at) < block)
        gain = np.concatenate([[0.0], np.cumsum(sign * above[near])])  # of ending behind each of them
        moved.append(float((at - block, *(edges[near] + small))[int(np.argmax(gain))]) if len(near) else at)
    return max(moved[0], 0.0), moved[1]


def _heights(parts: Sequence[Shown], block: float) -> tuple[np.ndarray, np.ndarray]:
    """Start of each block in which a joint is judged, s, and the sum of the joints' logarithms of mean squares there.

    Each joint counts from its own mean over the trial, so that one which is not judged in a block says nothing of it.
    """
    numbers = [np.maximum((p.samples.time - 0.5 * p.dt) / block, 0.0).astype(np.int64) for p in parts]
    count = max(int(number.max()) for number in numbers) + 1
    height, judged = np.zeros(count), np.zeros(count, dtype=bool)
    for part, number in zip(parts, numbers, strict=True):
        samples = np.bincount(number, minlength=count)
        here = samples > 0
        square = np.bincount(number, part.error**2, count)[here] / samples[here]
        # far below the noise is no smaller error
        level = np.log(np.maximum(square + part.noise**2, np.finfo(float).tiny))
        height[here] += level - level.mean()
        judged |= here
    return np.flatnonzero(judged) * block, height[judged]
