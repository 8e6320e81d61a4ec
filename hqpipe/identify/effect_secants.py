"""What an effect of several sizes does to the prediction of a joint, beyond what the free numbers of the base can do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.identify.search import AT_BOUND, Search
from hqpipe.identify.visible import UNUSUAL

ROUNDING = 1e-9  # of a square, or of a size: less is rounding
_SIZES = UNUSUAL * 3.0 ** np.arange(-6.0, 3.0)  # of the spread, from a few thousandths to more than any machine has
_MOST = 1e6  # times what is needed; more says no more


@dataclass(frozen=True, eq=False)
class Secant:
    """What an effect of some size does.

    Attributes:
        values: (P,) all numbers. size: distance of its first number from neutral. done: square of what it changes in the
            prediction. change: (N,) the part of it that the base cannot do. square: of that; infinite where it overflows.
    """

    values: np.ndarray
    size: float
    done: float
    change: np.ndarray
    square: float


def ways_of(search: Search, name: str) -> list[list[Secant]]:
    """Secants of an effect in each direction in which it is started, the smallest first; its other numbers at their first
    start."""
    screening, fitter, base = search.screening, search.fitter, search.base
    first, spread = screening.places(name)[0], search.effects[name].parameters[0].spread
    neutral, ways = float(fitter.neutral[first]), {}
    for combination in screening.combinations(name):
        ways.setdefault(float(np.sign(combination[0] - neutral)), combination)
    found = []
    for sign, combination in ways.items():
        if not sign:
            continue
        room = AT_BOUND * abs(float((fitter.high if sign > 0.0 else fitter.low)[first]) - neutral)
        secants = []
        for size in np.unique(np.minimum(_SIZES * spread, room)):
            values = base.solution.values.copy()
            values[screening.places(name)] = combination
            values[first] = neutral + sign * size
            secants.append(secant_to(search, name, values))
        found.append(secants)
    return found


def secant_to(search: Search, name: str, values: np.ndarray) -> Secant:
    """What an effect does beside the base with these numbers (P,)."""
    screening, first = search.screening, search.screening.places(name)[0]
    change = screening.beyond(search.base, values)
    with np.errstate(over="ignore", invalid="ignore"):
        square = float(change @ change)
    size = abs(float(values[first] - search.fitter.neutral[first]))
    return Secant(values, size, screening.moved(search.base, values), change, square if np.isfinite(square) else np.inf)


def least_size(way: Sequence[Secant], spread: float, needed: float, done: float) -> float | None:
    """Size from which on an effect changes the prediction by enough; None where no size does.

    Args:
        way: secants, the smallest first. spread: usual size; the search begins at the largest that a machine may have.
        needed: square of the change beyond what the base can do. done: square of all that it changes.
    """
    reach = [min(s.square / needed, s.done / done if done > 0.0 else _MOST, _MOST) for s in way]
    last = max((k for k, s in enumerate(way) if s.size <= (1.0 + ROUNDING) * UNUSUAL * spread), default=0)
    while last < len(way) and reach[last] < 1.0:
        last += 1
    if last == len(way):
        return None
    while last > 0 and reach[last - 1] >= 1.0:
        last -= 1
    if last == 0:
        return way[0].size / float(np.sqrt(reach[0]))
    high, low = (float(np.log(max(ratio, 1.0 / _MOST))) for ratio in (reach[last], reach[last - 1]))
    return way[last].size * float((way[last - 1].size / way[last].size) ** (high / (high - low)))


def at_size(way: Sequence[Secant], size: float) -> list[Secant]:
    """The nearest secant of a size, as long as it is at that size; none where the prediction overflows at all sizes."""
    finite = [secant for secant in way if np.isfinite(secant.square)]
    if not finite:
        return []
    s = min(finite, key=lambda secant: abs(np.log(secant.size / size)))
    share = size / s.size
    return [replace(s, done=share**2 * s.done, change=share * s.change, square=share**2 * s.square)]
