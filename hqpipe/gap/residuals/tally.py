"""Squared residuals summed by block, joint and regime: all that the shares and their intervals need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ALL = "all"
Regime = tuple[str, str]  # family, name


@dataclass(frozen=True, eq=False)
class Tally:
    """Sums over the samples of each block.

    Attributes:
        regimes: R (family, regime) pairs, the first of them ("all", "all").
        square: (B, J, R) squared residual, in the squared unit of each joint.
        count: (B, J, R) samples.
        trial: (B,) index of the trial that a block belongs to.
    """

    regimes: tuple[Regime, ...]
    square: np.ndarray
    count: np.ndarray
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
        return Tally(self.regimes, self.square[keep], self.count[keep], self.trial[keep])
