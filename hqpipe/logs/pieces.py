"""The samples of a channel, cut into pieces by their own values.

A cut falls where a hash of the last few samples is a multiple of a constant, as in rsync and in backup programs. The same
rows then give the same pieces wherever in a file they lie, so that two recordings are compared by their sets of pieces.
float32 or float64, 0 or −0 make no difference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PIECE = 16  # rows of a piece, on average
_WINDOW = 8  # rows that decide on a cut; a power of two
_BLOCK = 1 << 15  # samples hashed at a time: they stay in the processor's cache
_ODD = tuple(np.uint64(n) for n in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))
"""Constants of SplitMix64 (Steele, Lea and Flood, 2014)."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """The pieces of one channel, in order.

    Attributes:
        digest: (K,) uint64, hash of the samples of a piece. start: (K + 1,) its first row, and the end of the last one.
        changes: (K,) how many of its samples differ from the one before.
    """

    digest: np.ndarray
    start: np.ndarray
    changes: np.ndarray


def cut(values: np.ndarray) -> Pieces:
    """Cut the samples (T,) of a channel."""
    blocks = [_hashed(values, at) for at in range(0, len(values), _BLOCK)]
    mixed, cuts = (np.concatenate(part) for part in zip(*blocks, strict=True))
    changed = np.append(False, mixed[1:] != mixed[:-1])
    start = np.union1d(0, np.flatnonzero(cuts & changed))
    rows = np.diff(start, append=len(mixed))
    powers = np.multiply.accumulate(np.full(rows.max(), _ODD[0]))
    for first in range(0, len(start), _BLOCK):  # in place, a block at a time
        last = min(first + _BLOCK, len(start))
        low, high = start[first], start[last - 1] + rows[last - 1]
        place = np.arange(low, high) - np.repeat(start[first:last], rows[first:last])
        mixed[low:high] *= powers[place]
    changes = np.add.reduceat(changed.astype(np.uint32), start)
    return Pieces(np.add.reduceat(mixed, start), np.append(start, len(mixed)).astype(np.uint32), changes)


def _hashed(values: np.ndarray, at: int) -> tuple[np.ndarray, np.ndarray]:
    """Of the block of samples from row `at` on: a hash of each, and whether a cut may fall there."""
    before = min(at, _WINDOW)
    with np.errstate(over="ignore"):  # float32 holds less than float64
        single = values[at - before : at + _BLOCK].astype(np.float32) + np.float32(0.0)  # −0 + 0 = 0
    mixed = single.view(np.uint32).astype(np.uint64)
    for shift, odd in zip((30, 27), _ODD[1:], strict=True):
        mixed += _ODD[0]
        mixed ^= mixed >> np.uint64(shift)
        mixed *= odd
    mixed ^= mixed >> np.uint64(31)
    rolling, reach = mixed.copy(), 1  # of the last `reach` samples
    while reach < _WINDOW:
        rolling[reach:] = rolling[reach:] * _ODD[0] + rolling[:-reach]
        reach *= 2
    cuts = (rolling >> np.uint64(40)) % np.uint64(PIECE) == 0
    return mixed[before:], cuts[before:]


def stretch(known: Pieces, found: Pieces) -> tuple[int, int, int]:
    """The longest run of samples of `found` that is in `known` too: its first row, the one after its last, its changes."""
    same = np.isin(found.digest, known.digest)
    if not same.any():
        return 0, 0, 0
    follows = np.isin(_pairs(found.digest), _pairs(known.digest))
    begins = same & ~np.append(False, same[:-1] & follows)
    run = np.cumsum(begins)[same]
    changes = np.bincount(run, found.changes[same])
    best = np.flatnonzero(same)[run == np.argmax(changes)]
    return int(found.start[best[0]]), int(found.start[best[-1] + 1]), int(changes.max())


def _pairs(digest: np.ndarray) -> np.ndarray:
    """A hash of every piece and the one after it."""
    return digest[:-1] * _ODD[1] + digest[1:]
