"""Which effects the inputs of a joint could show, from which size on, and which cannot be told apart: said before a search.

The base is fitted alone. What an effect does to the prediction is taken as secants of the error, of several sizes, less what
the base's free numbers can do. Their lengths say from which size on the effect would be named, and the angles between those of
two effects whether one could be taken for the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.identify.alike import alike_effects
from hqpipe.identify.correlation import correlation_time
from hqpipe.identify.effect_secants import ROUNDING, at_size, least_size, ways_of
from hqpipe.identify.joint_answer import LEAST_SHARE, floor_of
from hqpipe.identify.search import Search
from hqpipe.identify.visible import UNUSUAL, least_square

_CLEAR = 2.0  # times the size from which an effect shows: there it is clear of the noise; assumption


@dataclass(frozen=True)
class Isolability:
    """What the inputs of a joint say beforehand of one named effect.

    Attributes:
        shows: whether that would be named at a size that a machine may have, `UNUSUAL` spreads at most.
        least: how far from neutral its first number has to be to be named if nothing but the noise of the sensors were left
            besides; None where no size is enough.
        beside: the same beside all that the base leaves in these logs.
        taken: share of what it does at its usual size, in squares, that the free numbers of the base do as well; None where it
            does nothing by itself, as the asymmetry of a friction that is not there.
        alike: effects that could be taken for it.
    """

    shows: bool
    least: float | None
    beside: float | None
    taken: float | None
    alike: tuple[str, ...] = ()


def isolability(search: Search) -> dict[str, Isolability]:
    """Named effect → what the inputs of the joint say of it beforehand; nothing where the base overflows.

    Args:
        search: of which the base alone is used.
    """
    base, model = search.base, search.model
    if not np.isfinite(base.solution.square):
        return {}
    floor, left = floor_of(search), search.left_out(base)
    rounding = max(ROUNDING * base.solution.square, np.finfo(float).tiny)
    time, above = correlation_time(base.solution.error, model.fit), max(left - floor, 0.0)
    names = [name for name in search.addable(base.names) if search.effects[name].named]
    ways = {name: ways_of(search, name) for name in names}
    found, usual = {}, {}
    for name in names:
        alone = max(least_square(search, name, floor, 0.0, model.noise[0] ** 2), rounding)
        beside = max(least_square(search, name, left, above, base.covariance.noise, time), rounding)
        spread = search.effects[name].parameters[0].spread
        least = _largest(search, name, [least_size(way, spread, alone, 0.0) for way in ways[name]])
        most = _largest(search, name, [least_size(way, spread, beside, LEAST_SHARE * above) for way in ways[name]])
        shows = least is not None and least <= UNUSUAL * spread
        usual[name] = [s for way in ways[name] for s in at_size(way, max(spread, _CLEAR * least) if shows else spread)]
        taken = [float(np.clip(1.0 - s.square / s.done, 0.0, 1.0)) for s in usual[name] if s.done > rounding]
        most = None if least is None or most is None else max(most, least)
        found[name] = Isolability(shows, least, most, max(taken, default=None))
    shown = {name: usual[name] for name in names if found[name].shows and usual[name]}
    alike = alike_effects(search, shown, ways, floor)
    return {name: replace(f, alike=alike.get(name, ())) for name, f in found.items()}


def _largest(search: Search, name: str, sizes: Sequence[float | None]) -> float | None:
    """Of the sizes in each direction; not less than every sound machine may have."""
    known = [size for size in sizes if size is not None]
    return max(*known, search.effects[name].parameters[0].least) if known else None
