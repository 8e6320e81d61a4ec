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
from hqpipe.identify.effect_secants import ROUNDING, EffectSecants, Secant, least_size, secant_of_size
from hqpipe.identify.misfit import floor_of, misfit_noise
from hqpipe.identify.search import Search
from hqpipe.identify.thresholds import LEAST_SHARE
from hqpipe.identify.visible import UNUSUAL, least_of, least_square

_CLEAR = 2.0  # times the size from which an effect shows: there it is clear of the noise; assumption


@dataclass(frozen=True)
class Isolability:
    """What the inputs of a joint say beforehand of one named effect.

    Attributes:
        shows: whether that would be named at a size that a machine may have, `UNUSUAL` spreads at most.
        least: how far from neutral its first number has to be to be named if nothing but the noise of the sensors were left
            besides; None where no size is enough. Of an effect that shows in both directions, the larger of the two.
        least_beside_base_error: the same beside all that the base leaves in these logs.
        share_done_by_base: share of what it does at its usual size, in squares, that the free numbers of the base do as well;
            None where it does nothing by itself, as the asymmetry of a friction that is not there.
        alike: effects that could be taken for it.
    """

    shows: bool
    least: float | None
    least_beside_base_error: float | None
    share_done_by_base: float | None
    alike: tuple[str, ...] = ()


def isolability(search: Search) -> dict[str, Isolability]:
    """Named effect → what the inputs of the joint say of it beforehand; nothing where the base overflows.

    Args:
        search: of which the base alone is used.
    """
    base, model = search.base, search.model
    if not np.isfinite(base.solution.square):
        return {}
    floor, left = floor_of(model), search.left_out(base)
    rounding = max(ROUNDING * base.solution.square, np.finfo(float).tiny)
    time, above = correlation_time(base.solution.error, model.fit), max(left - floor, 0.0)
    names = [name for name in search.addable(base.names) if search.effects[name].named]
    secants = EffectSecants(search)
    secants_by_direction = {name: secants.by_direction(name) for name in names}
    found, shown = {}, {}
    for name in names:
        directions, spread = secants_by_direction[name], search.effects[name].parameters[0].spread
        noise = misfit_noise(model)[0] ** 2
        beside_noise = [least_square(search, name, floor, 0.0, noise, is_usual=usual) for usual in (False, True)]
        beside_base = [
            least_square(search, name, left, above, base.covariance.noise, time, usual) for usual in (False, True)
        ]
        sizes = [_least(search, name, each, np.maximum(beside_noise, rounding), 0.0) for each in directions]
        least = _largest(search, name, sizes)
        asked = np.maximum(beside_base, rounding)
        most = _largest(search, name, [_least(search, name, each, asked, LEAST_SHARE * above) for each in directions])
        shows = least is not None and least <= UNUSUAL * spread
        # Where an effect shows in one direction only, the other one says nothing of it.
        able = [each for each, size in zip(directions, sizes, strict=True) if size is not None or not shows]
        usual = _of_size(able, max(spread, _CLEAR * least) if shows else spread)
        if shows and usual:
            shown[name] = usual
        most = None if least is None or most is None else max(most, least)
        found[name] = Isolability(shows, least, most, _share_done_by_base(usual, rounding))
    alike = alike_effects(secants, shown, secants_by_direction, floor)
    return {name: replace(f, alike=alike.get(name, ())) for name, f in found.items()}


def _least(search: Search, name: str, secants: Sequence[Secant], asked: Sequence[float], done: float) -> float | None:
    """The least size that is enough in one direction; None where none is.

    Args:
        asked: squares, of effects of any size and of those of usual size. done: see `least_size`.
    """
    spread = search.effects[name].parameters[0].spread
    of_any, of_usual = (least_size(secants, spread, square, done) for square in asked)
    if of_usual is None:
        return of_any
    return least_of(np.inf if of_any is None else of_any, of_usual, search.usual_size(name))


def _largest(search: Search, name: str, sizes: Sequence[float | None]) -> float | None:
    """The largest size over the directions in which one is enough, and no smaller than what every sound machine may have; None
    where no size is enough in any direction."""
    known = [size for size in sizes if size is not None]
    return max(*known, search.effects[name].parameters[0].least) if known else None


def _of_size(directions: Sequence[Sequence[Secant]], size: float) -> list[Secant]:
    """The secant of a size in each direction, but where the prediction overflows."""
    return [found for each in directions if (found := secant_of_size(each, size)) is not None]


def _share_done_by_base(secants: Sequence[Secant], rounding: float) -> float | None:
    """The largest share of the change of a secant, in squares, that the base does; None where none changes anything."""
    shares = [1.0 - s.square / s.total_square for s in secants if s.total_square > rounding]
    return float(np.clip(max(shares), 0.0, 1.0)) if shares else None
