"""What an effect of several sizes does to the prediction of a joint, beyond what the free numbers of the base can do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.identify.screening import square_of
from hqpipe.identify.search import AT_BOUND, Search
from hqpipe.identify.visible import UNUSUAL

ROUNDING = 1e-9  # of a square, or of a size: less is rounding
_SIZES = UNUSUAL * 3.0 ** np.arange(-6.0, 3.0)  # of the spread, from a few thousandths to more than any machine has
_MOST = 1e6  # times what is needed; more says no more


@dataclass(frozen=True, eq=False)
class Secant:
    """What an effect of some size does.

    Attributes:
        values: (P,) all numbers. size: distance of its first number from neutral.
        total_square: square of what it changes in the prediction.
        change: (N,) the part of that change that the base cannot do. square: of that part; infinite where it overflows.
    """

    values: np.ndarray
    size: float
    total_square: float
    change: np.ndarray
    square: float


class EffectSecants:
    """The secants of the effects of a joint beside its base; each takes one prediction.

    Args:
        search: of which the base alone is used.
    """

    def __init__(self, search: Search) -> None:
        self.search = search

    def by_direction(self, name: str) -> list[list[Secant]]:
        """Secants of an effect in each direction in which it is started, the smallest first; its other numbers at their first
        start."""
        screening, fitter = self.search.screening, self.search.fitter
        first, spread = screening.places(name)[0], self.search.effects[name].parameters[0].spread
        neutral, starts = float(fitter.neutral[first]), {}
        for start in screening.combinations(name):
            starts.setdefault(float(np.sign(start[0] - neutral)), start)
        found = []
        for sign, start in starts.items():
            if not sign:
                continue
            room = AT_BOUND * abs(float((fitter.high if sign > 0.0 else fitter.low)[first]) - neutral)
            sizes = np.unique(np.minimum(_SIZES * spread, room))
            values = [self.values_with(name, np.array([neutral + sign * size, *start[1:]])) for size in sizes]
            found.append([self.secant_to(name, each) for each in values])
        return found

    def values_with(self, name: str, numbers: np.ndarray) -> np.ndarray:
        """(P,) the values of the base with the numbers of an effect."""
        values = self.search.base.solution.values.copy()
        values[self.search.screening.places(name)] = numbers
        return values

    def secant_to(self, name: str, values: np.ndarray) -> Secant:
        """The secant of an effect from the base to these values (P,)."""
        screening, base = self.search.screening, self.search.base
        whole = screening.change(base, values)
        change = screening.beyond(base, whole)
        first = screening.places(name)[0]
        size = abs(float(values[first] - self.search.fitter.neutral[first]))
        return Secant(values, size, square_of(whole), change, square_of(change))


def least_size(secants: Sequence[Secant], spread: float, needed: float, needed_in_total: float) -> float | None:
    """Size from which on an effect changes the prediction by enough in one direction; None where no size does.

    Args:
        secants: the smallest first. spread: usual size; the search begins at the largest that a machine may have.
        needed: square of the change beyond what the base can do. needed_in_total: square of the whole change.
    """
    reach = [
        min(s.square / needed, s.total_square / needed_in_total if needed_in_total > 0.0 else _MOST, _MOST)
        for s in secants
    ]
    last = max((k for k, s in enumerate(secants) if s.size <= (1.0 + ROUNDING) * UNUSUAL * spread), default=0)
    while last < len(secants) and reach[last] < 1.0:
        last += 1
    if last == len(secants):
        return None
    while last > 0 and reach[last - 1] >= 1.0:
        last -= 1
    if last == 0:
        return secants[0].size / float(np.sqrt(reach[0]))
    high, low = (float(np.log(max(ratio, 1.0 / _MOST))) for ratio in (reach[last], reach[last - 1]))
    return secants[last].size * float((secants[last - 1].size / secants[last].size) ** (high / (high - low)))


def secant_of_size(secants: Sequence[Secant], size: float) -> Secant | None:
    """The secant nearest to a size, scaled to that size; None where the prediction overflows at all sizes."""
    finite = [secant for secant in secants if np.isfinite(secant.square)]
    if not finite:
        return None
    s = min(finite, key=lambda secant: abs(np.log(secant.size / size)))
    share = size / s.size
    return replace(s, total_square=share**2 * s.total_square, change=share * s.change, square=share**2 * s.square)
