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
_FINE = 1e5  # steps of a sensor within its range; no machine repeats a motion to a hundred-thousandth of it
_SOME = 8192  # samples that tell the resolution


@dataclass(frozen=True, eq=False)
class Pieces:
    """The pieces of one channel, in order.

    Attributes:
        digest: (K,) uint64, hash of the samples of a piece. start: (K + 1,) its first row, and the end of the last one.
        changes: (K,) how many of its samples differ from the one before.
        telling: (K,) how many of its samples no other recording of the same motion would share: of a fine signal all that
            differ from the one before, of a coarse one those in which noise turned it back. A coarse signal without noise
            tells nothing, as a good machine repeats it.
    """

    digest: np.ndarray
    start: np.ndarray
    changes: np.ndarray
    telling: np.ndarray

    @property
    def rows(self) -> np.ndarray:
        """(K,) number of samples."""
        return np.diff(self.start)


def cut(values: np.ndarray) -> Pieces:
    """Cut the samples (T,) of a channel."""
    with np.errstate(over="ignore"):  # float32 holds less than float64
        single = values.astype(np.float32) + np.float32(0.0)  # −0 + 0 = 0
    blocks = [_hashed(single, at) for at in range(0, len(single), _BLOCK)]
    mixed, cuts = (np.concatenate(part) for part in zip(*blocks, strict=True))
    changed = np.append(False, single[1:] != single[:-1])
    cuts &= changed
    cuts[0] = True
    start = np.flatnonzero(cuts)
    rows = np.diff(start, append=len(mixed))
    powers = np.multiply.accumulate(np.full(rows.max(), _ODD[0]))
    for first in range(0, len(start), _BLOCK):  # in place, a block at a time
        last = min(first + _BLOCK, len(start))
        low, high = start[first], start[last - 1] + rows[last - 1]
        place = np.arange(low, high) - np.repeat(start[first:last], rows[first:last])
        mixed[low:high] *= powers[place]
    changes = np.add.reduceat(changed.astype(np.uint32), start)
    telling = changes if _fine(single) else np.add.reduceat(_turns(single).astype(np.uint32), start)
    return Pieces(np.add.reduceat(mixed, start), np.append(start, len(mixed)).astype(np.uint32), changes, telling)


def _fine(samples: np.ndarray) -> bool:
    """Whether a signal is resolved so finely that equal samples come from one recording."""
    levels = np.unique(samples[:: max(1, len(samples) // _SOME)].astype(np.float64))
    return len(levels) > 1 and levels[-1] - levels[0] > _FINE * np.diff(levels).min()


def _turns(samples: np.ndarray) -> np.ndarray:
    """(T,) where a signal goes back on the step before."""
    up, down = samples[1:] > samples[:-1], samples[1:] < samples[:-1]
    return np.concatenate([[False, False], (up[1:] & down[:-1]) | (down[1:] & up[:-1])])[: len(samples)]


def _hashed(single: np.ndarray, at: int) -> tuple[np.ndarray, np.ndarray]:
    """Of the block of samples from row `at` on: a hash of each, and whether a cut may fall there."""
    before = min(at, _WINDOW)
    mixed = single[at - before : at + _BLOCK].view(np.uint32).astype(np.uint64)
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


@dataclass(frozen=True)
class Stretch:
    """Consecutive samples of one recording that are in another one too.

    Attributes:
        first, stop: its rows. changes, telling: how many of its samples, see `Pieces`.
    """

    first: int = 0
    stop: int = 0
    changes: int = 0
    telling: int = 0


def longest_stretch(known: Pieces, found: Pieces) -> Stretch:
    """Of the samples of `found` that are in `known` too, those without a break that move most."""
    same = np.isin(found.digest, known.digest)
    if not same.any():
        return Stretch()
    follows = np.isin(_pairs(found.digest), _pairs(known.digest))
    begins = same & ~np.append(False, same[:-1] & follows)
    run = np.cumsum(begins)[same] - 1
    changes, telling = (np.bincount(run, counts[same]).astype(int) for counts in (found.changes, found.telling))
    best = int(np.argmax(changes))
    pieces = np.flatnonzero(same)[run == best]
    return Stretch(
        int(found.start[pieces[0]]), int(found.start[pieces[-1] + 1]), int(changes[best]), int(telling[best])
    )


def _pairs(digest: np.ndarray) -> np.ndarray:
    """A hash of every piece and the one after it."""
    return digest[:-1] * _ODD[1] + digest[1:]
