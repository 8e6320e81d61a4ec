"""Base parameters and effects of a position loop on a valve, from what `hqpipe.machine` says of each."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from hqpipe.identify.model import Effect, Parameter
from hqpipe.layers.actuator.sizes import Sizes
from hqpipe.machine import EFFECTS
from hqpipe.machine import effect as scales
from hqpipe.machine.layout import BASE
from hqpipe.machine.moment_arm import PARAMETERS as ARM

LOGGED_SPEED, SPEED_LATE, BY_OPENING = "logged_speed", "speed_late", "by_opening"
MOVING = ("moving_command", "moving_position")
OF_FRICTION = tuple((name, p) for name, e in EFFECTS.items() for p in e.parameters if p.search.beside == "friction")
"""Owner and number of how friction turns round."""
BASE_NAMES = (*BASE, LOGGED_SPEED, SPEED_LATE, *(p.name for _, p in OF_FRICTION), *ARM)
"""Base parameters in their order; those of `MOVING` come last where the controller is faster than the log."""
TOLD_BY_FRICTION = tuple(name for name, effect in EFFECTS.items() if effect.turns_friction)
_ARM_SPREAD = {"arm_slope": 0.3, "arm_curve": 0.5}
"""A lever changes by cot φ per radian, 0.3 at 17° from where it is longest, and curves by a half; assumption."""
_ARM_MOST = 4.0  # of both: at the ends of half a radian the arm has gone or is twice as long; assumption
FROM_NOTHING = 0.1  # share of the unit, or a quarter of the upper bound, of a number that starts at its neutral value


def base_parameters(first: Mapping[str, float], size: Sizes, per_row: int = 1) -> tuple[Parameter, ...]:
    """The four coefficients, which speed the log's is, the travel in which friction turns round, and the moment arm.

    The speed from one position to the next adds up to the travel however coarse the encoder is; the logged one is right where
    the controller computes with it. `logged_speed` is the share of the second, and `speed_late` by how many rows the
    speed belongs later than its row; it does nothing but beside friction, as does the travel. Between the
    rows of a log that is slower than the controller, `moving_position` is 1 where that sees a smooth curve, and 0 where it sees
    what was logged last; so is `moving_command`, or where in the time that is open the steps of a held command come, see
    `hqpipe.logs.held_commands`.

    Args:
        first: coefficient → first guess. per_row: samples of the controller from one row of the log to the next; of
            two records, of the slower one.
    """
    most = {"k2": 1.0, "k4": 1.0 / max(size.widest, 1e-300)}  # neither leakage nor an impact takes more than there is
    return (
        *(Parameter(name, "1", first[name], np.inf, 0.0, most.get(name, np.inf)) for name in BASE),
        Parameter(LOGGED_SPEED, "1", 0.0, 1.0, 0.0, 1.0, (0.0, 1.0)),
        Parameter(SPEED_LATE, "1", 0.0, 0.25, -0.5, 0.5),
        *(replace(p, spread=3.0 * p.neutral, starts=()) for p in (_parameter(p, size) for _, p in OF_FRICTION)),
        *(Parameter(name, unit, 0.0, _ARM_SPREAD[name], -_ARM_MOST, _ARM_MOST) for name, unit in ARM.items()),
        *(Parameter(name, "1", 0.0, 1.0, 0.0, 1.0, (0.0, 1.0)) for name in MOVING if per_row > 1),
    )


def effects_of(
    size: Sizes, joints: int, runs: int, effort_source: str | None, barred: Collection[str]
) -> tuple[tuple[Effect, ...], tuple[tuple[str, str], ...]]:
    """The candidates that logs of this kind can show, and owner and name of each of their parameters in the loops' row.

    Args:
        joints: of the machine. runs: of windows in the trials to fit, see `window_runs`. barred: effects left out.
    """
    found: list[Effect] = []
    places: list[tuple[str, str]] = []
    for name, effect in EFFECTS.items():
        shown = effect.blocks and not effect.multiplies and joints >= effect.least_joints
        if not shown or name in barred or (effect.effort_sources and effort_source not in effect.effort_sources):
            continue
        own = [(name, p) for p in effect.parameters if p.search.beside is None]
        own += [(other.name, p) for other in EFFECTS.values() for p in other.parameters if p.search.beside == name]
        own = [(owner, p) for owner, p in own if size.pauses or not p.search.pauses]
        parameters = [_parameter(p, size) for _, p in own]
        places += [(owner, p.name) for owner, p in own]
        if effect.reads("demand"):  # from the supply, as speeds or as openings tell it
            parameters.append(Parameter(BY_OPENING, "1", 0.0, 1.0, 0.0, 1.0, (0.0, 1.0), shape=True))
            places.append((name, BY_OPENING))
        settled = runs * sum(isinstance(state.start, scales.Balanced) for state in effect.states)
        excluded = {*effect.excludes, *(other.name for other in EFFECTS.values() if name in other.excludes)}
        found.append(
            Effect(
                name, tuple(parameters), common=effect.common, settled=settled, excludes=frozenset(excluded - {*barred})
            )
        )
    return tuple(found), tuple(places)


def _parameter(p: scales.Parameter, size: Sizes) -> Parameter:
    """A number as the loops hold it: of an inverse one, one over the value."""
    search = p.search
    unit = 1.0 / size.of[search.scale] if p.inverse else size.of[search.scale]
    starts = tuple(start * unit for start in search.starts)
    known = [search.usual * unit] if search.usual else [abs(start) for start in starts if start]
    usual = min(known) if known else min(FROM_NOTHING, 0.25 * search.upper) * unit  # the least start is a usual size
    neutral = p.neutral if search.counts or not p.neutral else (starts[0] if len(starts) == 1 else p.neutral)
    low, high = search.lower * unit, search.upper * unit
    neutral, least = float(np.clip(neutral, low, high)), search.least / size.most_effort
    return Parameter(p.name, p.unit, neutral, usual, low, high, starts, least, shape=not search.counts)


def reported_unit(unit: str, units: Sequence[str]) -> str:
    """The unit of a number; units: of the joint's effort and position."""
    effort, position = units
    return unit.replace("command", position).replace("N·m", effort).replace("rad", position)
