"""Which samples a joint is judged on: windows of valid samples, blocks of them for the simulation, evenly thinned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.layers.torque.record import Record
from hqpipe.logs.travel_ends import runs

WARM_S = 0.5  # simulated before a block, in which spool, integral and supply settle; assumption: a few times their usual lags
BLOCK_S = 2.0  # least length of a block, of which the warm-up is to be a small part
MOST_STEPS = 40_000  # substeps of one simulation: a few milliseconds


@dataclass(frozen=True, eq=False)
class Windows:
    """What is simulated and what is judged.

    Attributes:
        stretch, first, last, start, stop: (B,) of the blocks, see `kernel.run_blocks`. substeps: per sample.
        restart: (T,) whether the torque is set to the logged one. sample: (N,) samples judged. held: (N,) where their
            window starts.
        windows: how many there are.
    """

    stretch: np.ndarray
    first: np.ndarray
    last: np.ndarray
    start: np.ndarray
    stop: np.ndarray
    substeps: int
    restart: np.ndarray
    sample: np.ndarray
    held: np.ndarray
    windows: int


def windows_of(record: Record, steps: int, lead: int, substeps: int, most: int = MOST_STEPS) -> Windows:
    """Windows of `steps` samples after their start, of which the first `lead` are not judged.

    A window starts from the logged torque, whose noise has faded by the time of the first sample that is judged. Spool,
    integral and supply go on from window to window.

    Args:
        substeps: of the simulation, per sample. most: of these in all.
    """
    found = []
    for stretch, (first, last) in enumerate(zip(record.first, record.last, strict=True)):
        for start, stop in runs(~record.masked[first : last + 1]):
            begins = np.arange(first + start, first + stop - steps, steps)
            found += [(int(begin), stretch) for begin in begins if record.observed[begin]]
    warm, longest = round(WARM_S / record.dt), max(round(BLOCK_S / record.dt), steps)
    blocks = _blocks(found, steps, warm, longest)
    cost = substeps * sum(block[-1][0] + steps + warm - block[0][0] for block in blocks)
    if cost > most:
        count = max(int(len(blocks) * most / cost), 1)
        blocks = [blocks[i] for i in np.unique(np.linspace(0, len(blocks) - 1, count).round().astype(int))]
    restart, sample, held = np.zeros(len(record.masked), dtype=bool), [], []
    for begin, _ in (window for block in blocks for window in block):
        here = np.arange(begin + 1 + lead, begin + steps + 1)
        here = here[record.observed[here]]
        restart[begin] = True
        sample.append(here)
        held.append(np.full(len(here), begin))
    stretches = np.array([block[0][1] for block in blocks], dtype=np.int64)
    begins = np.array([block[0][0] for block in blocks], dtype=np.int64)
    ends = np.array([block[-1][0] + steps + 1 for block in blocks], dtype=np.int64)

    def whole(parts) -> np.ndarray:
        return np.concatenate(parts).astype(np.int64) if parts else np.zeros(0, dtype=np.int64)

    return Windows(
        stretch=stretches,
        first=record.first[stretches],
        last=record.last[stretches],
        start=np.maximum(begins - warm, record.first[stretches]),
        stop=ends,
        substeps=substeps,
        restart=restart,
        sample=whole(sample),
        held=whole(held),
        windows=sum(len(block) for block in blocks),
    )


def _blocks(found: list[tuple[int, int]], steps: int, warm: int, longest: int) -> list[list[tuple[int, int]]]:
    """Windows that are simulated in one go: neighbours in one stretch."""
    blocks: list[list[tuple[int, int]]] = []
    for begin, stretch in found:
        if blocks:
            block = blocks[-1]
            near = stretch == block[0][1] and begin - block[-1][0] - steps <= warm
            if near and begin + steps - block[0][0] <= longest:
                block.append((begin, stretch))
                continue
        blocks.append([(begin, stretch)])
    return blocks
