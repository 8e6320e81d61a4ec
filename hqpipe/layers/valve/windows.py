"""Which samples a joint is judged on: windows of valid samples, blocks of them for the simulation, evenly thinned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.layers.valve.masks import runs
from hqpipe.layers.valve.record import Record, Scales

WARM_S = (
    1.0  # simulated before a window: several times the dead time and lag of a slow, pilot-operated valve; assumption
)
LEFT_ALONE = 0.02  # of the command's largest distance from rest, within which a joint is left alone; assumption
STANDS = 4.0  # of the sensor's noise, by which a resting joint may seem to move
BLOCK_WARMS = 3  # a block is so many times as long as its warm-up, of which it is to waste little
STEP_S = 0.01  # longest substep: the lags that a hydraulic valve has are a few times that
MOST_STEPS = 80_000  # substeps of one simulation: a few milliseconds


@dataclass(frozen=True, eq=False)
class Windows:
    """What is simulated and what is judged.

    Attributes:
        first, last, start, kept, stop: (B,) of the blocks, see `kernel.run_blocks`. substeps: per sample.
        begin: (W,) sample at which each window starts. sample: (N,) samples judged. window: (N,) index into `begin`.
        begin_samples: before and at the start of a window, from which its position is taken.
    """

    first: np.ndarray
    last: np.ndarray
    start: np.ndarray
    kept: np.ndarray
    stop: np.ndarray
    substeps: int
    begin: np.ndarray
    sample: np.ndarray
    window: np.ndarray
    begin_samples: int


def windows_of(
    record: Record, scales: Scales, masked: np.ndarray, steps: int, noise: float, most: int = MOST_STEPS
) -> Windows:
    """Windows of `steps` samples after their start.

    Args:
        masked: (N,) samples that the valve does not decide. noise: standard deviation of the position's. most: substeps in all.
    """
    begin_samples = max(steps // 5, 1)
    substeps = int(np.clip(np.ceil(record.dt / STEP_S - 1e-6), 1, 20))
    found = _cut(record, masked, steps, begin_samples)
    active = np.array([_active(record, scales, noise, a, b) for a, b in found], dtype=bool)
    warm = round(WARM_S / record.dt)
    blocks = _blocks(record, found, steps, warm)
    blocks = [block for block in blocks if active[block].any()]
    cost = [substeps * (found[block[-1]][1] - found[block[0]][0] + warm) for block in blocks]
    if sum(cost) > most:
        count = max(int(len(blocks) * most / sum(cost)), 1)
        blocks = [blocks[i] for i in np.unique(np.linspace(0, len(blocks) - 1, count).round().astype(int))]
    kept = _balanced(blocks, active)
    begin, sample, window = [], [], []
    for i in kept:
        start, stop = found[i]
        here = np.arange(start + 1, stop)
        here = here[record.observed[here]]
        sample.append(here)
        window.append(np.full(len(here), len(begin)))
        begin.append(start)
    firsts = [found[block[0]][0] for block in blocks]
    stretch = record.stretch[firsts] if blocks else np.zeros(0, dtype=np.int64)
    first = record.first[stretch]

    def whole(values) -> np.ndarray:
        return np.ascontiguousarray(values, dtype=np.int64)

    return Windows(
        first=whole(first),
        last=whole(record.last[stretch]),
        start=whole(np.maximum(np.array(firsts, dtype=np.int64) - warm, first)),
        kept=whole(np.array(firsts, dtype=np.int64) - begin_samples),
        stop=whole([found[block[-1]][1] for block in blocks]),
        substeps=substeps,
        begin=whole(begin),
        sample=whole(np.concatenate(sample) if sample else []),
        window=whole(np.concatenate(window) if window else []),
        begin_samples=begin_samples,
    )


def _cut(record: Record, masked: np.ndarray, steps: int, begin_samples: int) -> list[tuple[int, int]]:
    """(start, stop) of windows within runs of valid samples, in the order of time.

    Nothing is known of the commands before a stretch, so that its first window is left out. A window starts at a sample that
    was recorded, as were those from which its position is taken.
    """
    found = []
    settled = np.arange(len(masked)) - record.first[record.stretch] >= steps
    for start, stop in runs(~masked & settled, record.stretch):
        at = start + begin_samples - 1
        while at + 1 < stop:
            if not record.observed[at - begin_samples + 1 : at + 1].all():
                at += 1
                continue
            end = min(at + steps + 1, stop)
            if end - at > steps // 2:
                found.append((at, end))
            at = end - 1
    return found


def _active(record: Record, scales: Scales, noise: float, start: int, stop: int) -> bool:
    """Whether the joint is commanded or moves in a window."""
    command, position = record.command[start:stop], record.position[start:stop]
    commanded = np.abs(command - scales.rest).max() > LEFT_ALONE * scales.command
    return bool(commanded or np.abs(position - position[0]).max() > STANDS * noise)


def _blocks(record: Record, found: list[tuple[int, int]], steps: int, warm: int) -> list[np.ndarray]:
    """Indices of windows that are simulated in one go: neighbours in one stretch."""
    longest = max(BLOCK_WARMS * warm, steps)
    blocks, current = [], []
    for i, (start, stop) in enumerate(found):
        if current:
            begun = found[current[0]][0]
            apart = record.stretch[start] != record.stretch[begun] or start - found[current[-1]][1] > warm
            if apart or stop - begun > longest:
                blocks.append(np.array(current))
                current = []
        current.append(i)
    return blocks + [np.array(current)] if current else blocks


def _balanced(blocks: list[np.ndarray], active: np.ndarray) -> np.ndarray:
    """The windows of the blocks, of those at rest evenly no more than of the others."""
    every = np.concatenate(blocks) if blocks else np.zeros(0, dtype=np.int64)
    moving, resting = every[active[every]], every[~active[every]]
    if len(resting) > len(moving):
        resting = resting[np.linspace(0, len(resting) - 1, len(moving)).round().astype(int)]
    return np.sort(np.concatenate([moving, resting]))
