"""The same machine recorded twice: what has grown in between, and what differs between any two recordings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from hqpipe.benchmark.cases.cylinder.effects import SPOOL
from hqpipe.benchmark.cases.electric.effects import payload
from hqpipe.benchmark.cases.families import FAMILIES
from hqpipe.benchmark.cases.planted import SIZES, Motion, Planted

NOTHING = "nothing"
FRICTION = "coulomb_friction"
CHANGES = {
    True: (FRICTION, "payload", "backlash", NOTHING, NOTHING),
    False: (SPOOL, "valve_deadband", "supply_droop", "leakage", NOTHING, NOTHING),
}
"""What has changed, of electric machines (True) and of cylinders; each as often as the others."""
WARMTH = 0.02  # largest change of the viscosity of oil and grease between two recordings, about 1 °C of oil (ISO VG 46)
LENGTH = 0.2  # by which the length of a trial differs at most; assumption
Change = tuple[tuple[Planted, ...], tuple[Planted, ...]]
"""What was there before, and what has been added since, in numbers too."""


def ordinary_friction(machine: Any, rng: np.random.Generator) -> Planted:
    """The dry friction of a machine in good order."""
    size = str(rng.choice(SIZES[:2]))
    plant = FAMILIES[machine.family].effects.plant
    return plant(machine, FRICTION, size, machine.names, rng, ordinary=True)


def changed(machine: Any, change: str, rng: np.random.Generator) -> Change | None:
    """What a machine had and what it has in addition, in all joints; None where this machine does not show it."""
    family = FAMILIES[machine.family]
    before = (ordinary_friction(machine, rng),) if family.electric else ()
    if change == NOTHING:
        return before, ()
    if change == FRICTION:
        factor = float(rng.uniform(1.6, 2.5))
        return before, (_more(before[0], "coulomb", "friction_nm", factor),)
    if change == "payload":
        return before, (payload(machine, float(rng.uniform(0.3, 0.8))),)
    if change not in family.effects.possible(machine):
        return None
    later = family.effects.plant(machine, change, "typical", machine.names, rng)
    if change in ("backlash", "valve_deadband"):
        return _worn(before, later, *{"backlash": ("gap", "gap")}.get(change, ("overlap", "half_width")), rng)
    if change == SPOOL:
        return before, (_slower(machine, later),)
    load = family.effects.with_load(machine, (later,), rng)[1:] if change == "leakage" else ()
    return (*before, *load), (later,)


def _more(before: Planted, field: str, number: str, factor: float) -> Planted:
    """An effect that has grown by a factor; its number is what was added."""
    settings = {j: {**fields, field: fields[field] * factor} for j, fields in before.settings.items()}
    parameters = {
        j: {**numbers, number: (numbers[number] or 0.0) * (factor - 1.0)} for j, numbers in before.parameters.items()
    }
    return replace(before, settings=settings, parameters=parameters, ordinary=False, size="typical")


def _worn(before: tuple[Planted, ...], later: Planted, field: str, number: str, rng: np.random.Generator) -> Change:
    """Play that was a part of what it is now, or in half of the machines not there."""
    if rng.random() < 0.5:
        return before, (later,)
    share = float(rng.uniform(0.2, 0.5))
    small = {j: {**fields, field: fields[field] * share} for j, fields in later.settings.items()}
    numbers = {j: {**n, number: (n[number] or 0.0) * share} for j, n in later.parameters.items()}
    earlier = replace(later, settings=small, parameters=numbers, size="small", ordinary=True)
    added = {j: {**n, number: (n[number] or 0.0) * (1.0 - share)} for j, n in later.parameters.items()}
    return (*before, earlier), (replace(later, parameters=added),)


def _slower(machine: Any, later: Planted) -> Planted:
    """A spool that has become slower; its number is what was added to its own lag."""
    own = dict(zip(machine.names, machine.axes["lag"].tolist(), strict=True))
    added = {j: {"time_constant_s": (n["time_constant_s"] or 0.0) - own[j]} for j, n in later.parameters.items()}
    return replace(later, parameters=added)


def earlier_trials(machine: Any, rng: np.random.Generator) -> tuple[Motion, ...]:
    """As many trials with the same gains and loads, but other motions, lengths and noise."""
    motions, found = FAMILIES[machine.family].motions, []
    for trial in machine.trials:
        names = tuple(str(name) for name in rng.choice(motions, len(machine.names)))
        seconds = float(np.round(trial.seconds * rng.uniform(1.0 - LENGTH, 1.0 + LENGTH), 1))
        found.append(replace(trial, names=names, seconds=seconds, seed=int(rng.integers(1, 2**31 - 1))))
    return tuple(found)


def earlier_viscosity(rng: np.random.Generator) -> float:
    """Viscosity of the earlier recording over that of the later one."""
    return float(rng.uniform(1.0 - WARMTH, 1.0 + WARMTH))
