"""Squared residuals summed by block, joint and regime: all that the shares and their intervals need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.gap.bootstrap import block_edges
from hqpipe.gap.regimes import Thresholds, frequency_bands, label, thresholds
from hqpipe.gap.replay import Replay

ALL = "all"
FREQUENCY = "frequency"
Regime = tuple[str, str]  # family, name


@dataclass(frozen=True, eq=False)
class Tally:
    """Sums over the samples of each block.

    Attributes:
        regimes: R (family, regime) pairs, the first of them ("all", "all").
        square: (B, J, R) squared residual, in the squared unit of each joint.
        count: (B, J, R) samples; fractional in the frequency family, where a band counts by its width.
        signal: (B, J, R) what an error without a preferred regime would follow: the same as `count`, but in
            the frequency family the squared error of holding the torque of the window start.
        trial: (B,) index of the trial that a block belongs to.
    """

    regimes: tuple[Regime, ...]
    square: np.ndarray
    count: np.ndarray
    signal: np.ndarray
    trial: np.ndarray

    def family(self, name: str) -> list[int]:
        """Columns of the regimes of one family."""
        return [i for i, (family, _) in enumerate(self.regimes) if family == name]

    @property
    def families(self) -> list[str]:
        return list(dict.fromkeys(family for family, _ in self.regimes))

    def of_trial(self, index: int) -> Tally:
        """The blocks of one trial."""
        keep = self.trial == index
        return Tally(self.regimes, self.square[keep], self.count[keep], self.signal[keep], self.trial[keep])


def tally(replays: Sequence[Replay], weight: np.ndarray | float = 1.0) -> Tally:
    """Sum the residuals of all trials, which share joints; thresholds are common to them.

    A regime that a trial cannot show, because a channel is not in it, has no samples there.

    Args:
        weight: (J,) what the joints' speeds count in the flow that they draw from a common supply.
    """
    limits = thresholds([r.trajectory for r in replays], weight)
    parts = [_one(item, limits) for item in replays]
    regimes = tuple(dict.fromkeys(regime for part in parts for regime in part.regimes))
    sums = [np.concatenate([_spread(p.sums[k], p.regimes, regimes) for p in parts]) for k in range(3)]
    trial = np.concatenate([np.full(len(p.sums[0]), i) for i, p in enumerate(parts)])
    return Tally(regimes, *sums, trial)


def _spread(values: np.ndarray, present: Sequence[Regime], wanted: Sequence[Regime]) -> np.ndarray:
    """(B, J, R) over `present` as (B, J, R') over `wanted`, zero where absent."""
    full = np.zeros((*values.shape[:2], len(wanted)))
    full[:, :, [wanted.index(regime) for regime in present]] = values
    return full


@dataclass(frozen=True, eq=False)
class _Part:
    regimes: tuple[Regime, ...]
    sums: tuple[np.ndarray, np.ndarray, np.ndarray]  # square, count, signal


def _one(item: Replay, limits: Thresholds) -> _Part:
    edges = block_edges(item.windows, item.steps, item.trajectory.dt)
    square = item.targets(item.residual) ** 2
    names = [(ALL, ALL)]
    sums = [np.add.reduceat(square.sum(axis=1), edges)]
    judged = item.targets(item.counts)
    counts = [np.add.reduceat(judged.sum(axis=1, dtype=float), edges)]
    for family, labels in label(item.trajectory, limits).items():
        for regime, mask in labels.items():
            inside = item.targets(mask) & judged
            names.append((family, regime))
            sums.append(np.add.reduceat((square * inside).sum(axis=1), edges))
            counts.append(np.add.reduceat(inside.sum(axis=1, dtype=float), edges))
    rate = 1.0 / item.trajectory.dt
    bands = frequency_bands(rate)
    names += [(FREQUENCY, name) for name in bands]
    width = [2.0 * (high - low) / rate * counts[0] for low, high in bands.values()]
    energy = list(_bands(item, item.residual, edges))
    held = list(_bands(item, item.held_error, edges))
    parts = (sums + energy, counts + width, counts + held)
    return _Part(tuple(names), tuple(np.stack(part, axis=2) for part in parts))


def _bands(item: Replay, values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Energy of `values` (T, J) by frequency band, block and joint, by Parseval's theorem."""
    rate = 1.0 / item.trajectory.dt
    tops = [high for _, high in frequency_bands(rate).values()]
    cut = item.targets(values)
    energy = np.zeros((len(tops), len(edges), cut.shape[2]))
    for b, (start, stop) in enumerate(zip(edges, [*edges[1:], item.windows], strict=True)):
        block = cut[start:stop].reshape(-1, cut.shape[2])
        power = np.abs(np.fft.rfft(block, axis=0)) ** 2 / len(block)
        power[1 : (len(block) + 1) // 2] *= 2.0  # each inner bin also stands for its negative frequency
        frequency = np.fft.rfftfreq(len(block), 1.0 / rate)
        band = np.minimum(np.searchsorted(tops, frequency, side="left"), len(tops) - 1)
        np.add.at(energy[:, b], band, power)
    return energy
