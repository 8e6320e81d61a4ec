"""Which effects of a joint could be taken for each other, by the angles between what they do to the prediction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqpipe.identify.effect_secants import ROUNDING, EffectSecants, Secant
from hqpipe.identify.model import Effect
from hqpipe.identify.thresholds import LEAST_GAIN
from hqpipe.identify.visible import UNUSUAL

_STEP = 0.1  # of the spread, or of the value: difference by another number of an effect; assumption


def alike_effects(
    secants: EffectSecants,
    shown: dict[str, list[Secant]],
    secants_by_direction: dict[str, list[list[Secant]]],
    floor: float,
) -> dict[str, tuple[str, ...]]:
    """Effect → effects that could be taken for it.

    Two effects A and B are alike if what B cannot reproduce of A's change is too small to make A a cause: its square is below
    `LEAST_GAIN` of that of the change, or of the noise of the sensors. The same holds with A and B exchanged.

    Args:
        shown: effects that show, with their secants in the directions in which they do.
        secants_by_direction: of all named effects. floor: squared error that the noise leaves.
    """
    if not shown:
        return {}
    owners = [secants.search.effects[name] for name, own in shown.items() for _ in own]
    changes = np.array([secant.change for own in shown.values() for secant in own])
    allowed = LEAST_GAIN * np.maximum(np.sum(changes**2, axis=1), floor)
    found: dict[str, list[str]] = {name: [] for name in shown}
    for other, directions in secants_by_direction.items():
        unexplained = _unexplained_square(secants, other, directions, changes, owners)
        for effect in {owners[m].name for m in np.flatnonzero(unexplained <= allowed)} - {other}:
            found[effect].append(other)
    return {
        name: tuple(o for o in secants_by_direction if o in others or name in found.get(o, ()))
        for name, others in found.items()
    }


def _unexplained_square(
    secants: EffectSecants,
    name: str,
    directions: Sequence[Sequence[Secant]],
    changes: np.ndarray,
    owners: Sequence[Effect],
) -> np.ndarray:
    """(M,) the least square of what an effect cannot reproduce of changes (M, N), over all its starts and sizes.

    Where it has more sizes than the effect that it would stand for, the evidence charges them: its other numbers then stay at
    their starts, and numbers that it takes from the logs by itself rule it out.

    Args:
        directions: its secants in each direction. owners: (M,) effects that make the changes.
    """
    search = secants.search
    own = search.effects[name]
    able = np.array([effect.settled >= own.settled for effect in owners])
    free = np.array([effect.sizes >= own.sizes for effect in owners])
    screening, places = search.screening, search.screening.places(name)
    most, none = UNUSUAL * own.parameters[0].spread, np.zeros((changes.shape[1], 0))
    known = {secant.values.tobytes(): secant for each in directions for secant in each}
    starts = []
    for numbers in screening.combinations(name):
        values = secants.values_with(name, numbers)
        secant = known.pop(values.tobytes(), None) or secants.secant_to(name, values)
        starts.append((secant, _slopes(secants, name, secant)))
    unexplained = np.sum(changes**2, axis=1)
    for secant, slopes in [*starts, *((secant, none) for secant in known.values())]:
        if not 0.0 < secant.size <= (1.0 + ROUNDING) * most or not 0.0 < secant.square < np.inf:
            continue
        low, high = screening.shares(name, secant.values[places])
        ends = max(low, -most / secant.size), min(high, most / secant.size)
        unexplained[able] = np.minimum(unexplained, _residual_square(changes, secant.change, none, *ends))[able]
        if slopes.shape[1]:
            residual = _residual_square(changes, secant.change, slopes, *ends)
            unexplained[able & free] = np.minimum(unexplained, residual)[able & free]
    return unexplained


def _residual_square(
    changes: np.ndarray, change: np.ndarray, slopes: np.ndarray, low: float, high: float
) -> np.ndarray:
    """(M,) square of the residual of changes (M, N), fitted by a share, from low to high, of one (N,) and any of slopes
    (N, K)."""
    residual, own = changes - (changes @ slopes) @ slopes.T, change - slopes @ (slopes.T @ change)
    along, square = residual @ own, max(float(own @ own), np.finfo(float).tiny)
    share = np.clip(along / square, low, high)
    return np.sum(residual**2, axis=1) - 2.0 * share * along + share**2 * square


def _slopes(secants: EffectSecants, name: str, start: Secant) -> np.ndarray:
    """(N, K) orthonormal, what the numbers of an effect but its first one change at a start, beyond what the base can do."""
    search, columns = secants.search, []
    fitter = search.fitter
    for index in search.screening.places(name)[1:] if np.isfinite(start.square) else ():
        spread, values = fitter.spread[index], start.values.copy()
        step = _STEP * float(spread if np.isfinite(spread) else max(abs(values[index]), 1.0))
        values[index] += step if values[index] + step <= fitter.high[index] else -step
        moved = secants.secant_to(name, values)
        if np.isfinite(moved.square):
            change = moved.change - start.change
            if change @ change > ROUNDING * start.square:
                columns.append(change / np.linalg.norm(change))
    return np.linalg.qr(np.array(columns).T)[0] if columns else np.zeros((len(start.change), 0))
