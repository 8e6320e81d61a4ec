"""Which effects of a joint could be taken for each other, by the angles between what they do to the prediction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqpipe.identify.effect_secants import ROUNDING, Secant, secant_to
from hqpipe.identify.model import Effect
from hqpipe.identify.search import LEAST_GAIN, Search
from hqpipe.identify.visible import UNUSUAL

_STEP = 0.1  # of the spread, or of the value: difference by another number of an effect; assumption


def alike_effects(
    search: Search, shown: dict[str, list[Secant]], ways: dict[str, list[list[Secant]]], floor: float
) -> dict[str, tuple[str, ...]]:
    """Effect → those that leave less of it than a cause has to close, of its own square or of the noise of the sensors; or of
    which it leaves as little.

    Args:
        shown: of each effect, in each direction. floor: squared error that the noise leaves.
    """
    if not shown:
        return {}
    owner = [search.effects[name] for name, secants in shown.items() for _ in secants]
    changes = np.array([secant.change for secants in shown.values() for secant in secants])
    squares = np.sum(changes**2, axis=1)
    allowed = LEAST_GAIN * np.maximum(squares, floor)
    found: dict[str, list[str]] = {name: [] for name in shown}
    for other in ways:
        left = _left(search, other, ways[other], changes, owner)
        for effect in {owner[m].name for m in np.flatnonzero(left <= allowed)} - {other}:
            found[effect].append(other)
    return {name: tuple(o for o in ways if o in others or name in found.get(o, ())) for name, others in found.items()}


def _left(
    search: Search, name: str, ways: Sequence[Sequence[Secant]], changes: np.ndarray, owner: Sequence[Effect]
) -> np.ndarray:
    """(M,) least square of what an effect leaves of changes (M, N), of all its starts and sizes and as large as serves.

    Where it has more free numbers than the effect that it would stand for, the evidence charges them: its other numbers then
    stay at their starts, and numbers that it takes from the logs by itself rule it out.

    Args:
        owner: (M,) effects that make the changes.
    """
    own = search.effects[name]
    able = np.array([effect.settled >= own.settled for effect in owner])
    free = np.array([len(effect.parameters) >= len(own.parameters) for effect in owner])
    screening, places = search.screening, search.screening.places(name)
    most, none = UNUSUAL * own.parameters[0].spread, np.zeros((changes.shape[1], 0))
    starts = []
    for combination in screening.combinations(name):
        values = search.base.solution.values.copy()
        values[places] = combination
        starts.append((secant := secant_to(search, name, values), _slopes(search, name, secant)))
    left = np.sum(changes**2, axis=1)
    for secant, slopes in [*starts, *((secant, none) for way in ways for secant in way)]:
        if not 0.0 < secant.size <= (1.0 + ROUNDING) * most or not 0.0 < secant.square < np.inf:
            continue
        low, high = screening.shares(name, secant.values[places])
        ends = max(low, -most / secant.size), min(high, most / secant.size)
        left[able] = np.minimum(left, _rest(changes, secant.change, none, *ends))[able]
        if slopes.shape[1]:
            left[able & free] = np.minimum(left, _rest(changes, secant.change, slopes, *ends))[able & free]
    return left


def _rest(changes: np.ndarray, change: np.ndarray, slopes: np.ndarray, low: float, high: float) -> np.ndarray:
    """(M,) square of what is left of changes (M, N) beside a share, from low to high, of one (N,) and any of slopes (N, K)."""
    rest, own = changes - (changes @ slopes) @ slopes.T, change - slopes @ (slopes.T @ change)
    along, square = rest @ own, max(float(own @ own), np.finfo(float).tiny)
    share = np.clip(along / square, low, high)
    return np.sum(rest**2, axis=1) - 2.0 * share * along + share**2 * square


def _slopes(search: Search, name: str, start: Secant) -> np.ndarray:
    """(N, K) orthonormal, what the numbers of an effect but its first one change at a start, beyond what the base can do."""
    fitter, columns = search.fitter, []
    for index in search.screening.places(name)[1:] if np.isfinite(start.square) else ():
        spread, values = fitter.spread[index], start.values.copy()
        step = _STEP * float(spread if np.isfinite(spread) else max(abs(values[index]), 1.0))
        values[index] += step if values[index] + step <= fitter.high[index] else -step
        moved = secant_to(search, name, values)
        if np.isfinite(moved.square):
            change = moved.change - start.change
            if change @ change > ROUNDING * start.square:
                columns.append(change / np.linalg.norm(change))
    return np.linalg.qr(np.array(columns).T)[0] if columns else np.zeros((len(start.change), 0))
