"""The withheld cases of servos, arms and cylinders: which machine moves how, and what is wrong with it.

`cases(n, seed, machine, kinds)` always gives the same list.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.benchmark.cases import families
from hqpipe.benchmark.cases.changes import (
    CHANGES,
    FRICTION,
    changed,
    earlier_trials,
    earlier_viscosity,
    ordinary_friction,
)
from hqpipe.benchmark.cases.families import FAMILIES, MACHINES, Family
from hqpipe.benchmark.cases.planted import SIZES, Motion, Planted
from hqpipe.drawing import apportion, endless, shares_of
from hqpipe.errors import HqpipeError, UsageError

KINDS = {"none": 0.10, "single": 0.40, "mixture": 0.25, "place": 0.10, "outside": 0.15}
"""Share of each kind: no effect; one in all joints; two or three; one in one joint of several; one that no library holds."""
ON_REQUEST = {"change": 0.10}
"""Kinds that are made only when they are asked for, with their weight beside others: a later recording of the same machine."""

EXCLUSIVE = (
    {"backlash", "transmission_compliance"},  # both are the spring between motor and load
    {"unsigned_sensor", "channel_skew"},  # without its sign a torque hides when it was logged
    {"gain_error", "transmission_compliance"},  # a soft gear in series with a position loop is a lower gain
    {"torque_limit", "voltage_sag"},  # both are what the motor can give at most
    {"valve_lag", "command_delay"},  # at the rates of these logs the one passes for the other
    {"dead_time_asymmetry", "command_delay"},  # which part of two dead times is common is a convention
    {"valve_deadband", "valve_deadband_with_jump"},  # one effect
    {"counterbalance", "direction_asymmetry"},  # both make a cylinder slower in one direction
)
CHANGE = "change"
ORDINARY = 0.5  # share of the other electric cases whose machine has the dry friction that real ones have
ATTEMPTS = 500  # machines drawn until one shows what is asked for


@dataclass(frozen=True)
class Case:
    """One machine and its trials.

    Attributes:
        name: case_NNN. family: of `FAMILIES`. kind: of `KINDS` or `ON_REQUEST`. machine: sound. planted: what is wrong.
        reference: what was there before, in a case of kind "change", else None. change: what has grown since, likewise.
        earlier: the trials of the reference. viscosity: then, over the later one.
    """

    name: str
    family: str
    kind: str
    machine: Any
    planted: tuple[Planted, ...]
    reference: tuple[Planted, ...] | None = None
    change: str | None = None
    earlier: tuple[Motion, ...] = ()
    viscosity: float = 1.0

    def faulty(self, leave_out: Sequence[str] = (), before: bool = False) -> Any:
        """The machine with its effects, without those named; or as it was `before`, in its earlier trials."""
        model = FAMILIES[self.family].model
        found = replace(self.machine, trials=self.earlier) if before else self.machine
        later = () if before else tuple(one for one in self.planted if one.effect not in leave_out)
        for one in (*(self.reference or ()), *later):
            found = model.with_settings(found, one.settings)
        return model.at_viscosity(found, self.viscosity) if before else found


def cases(n: int, seed: int, machine: str = "joints", kinds: Sequence[str] = ()) -> list[Case]:
    """The cases in the order in which they are numbered, kinds and families mixed.

    Args:
        n: how many. seed: of everything. machine: of `MACHINES`, or "joints" for all of them in turn.
        kinds: of `KINDS` and `ON_REQUEST`; none for all of `KINDS`.

    Raises:
        UsageError: a kind or a machine that does not exist.
    """
    if machine != "joints" and machine not in MACHINES:
        raise UsageError(f"machine '{machine}', expected joints, {', '.join(MACHINES)}", field="--machine")
    known = list(MACHINES)
    asked = known if machine == "joints" else [machine]
    rng = np.random.default_rng([seed, n, len(asked), known.index(asked[0])])
    order = apportion(shares_of(kinds, KINDS, ON_REQUEST), n, rng)
    plans: dict[tuple[str, str], Iterator[Any]] = {}
    found = []
    for index, (kind, family) in enumerate(zip(order, _families(order, asked, rng), strict=True)):
        plan = plans.setdefault((family, kind), _wishes(FAMILIES[family], family, kind, rng))
        own = np.random.default_rng([seed, list(FAMILIES).index(family), index])
        found.append(_case(index, family, kind, next(plan), own))
    return found


def _families(order: Sequence[str], asked: Sequence[str], rng: np.random.Generator) -> list[str]:
    """The family of each case: the machines in turn, their variants in their shares; twice recorded is the first one."""
    found = []
    for index, kind in enumerate(order):
        variants = MACHINES[asked[index % len(asked)]]
        found.append(next(iter(variants)) if kind == CHANGE else asked[index % len(asked)])
    for machine in asked:
        places = [i for i, kind in enumerate(order) if kind != CHANGE and asked[i % len(asked)] == machine]
        for place, family in zip(places, apportion(MACHINES[machine], len(places), rng), strict=True):
            found[place] = family
    return found


def _names(family: Family, name: str, outside: bool) -> list[str]:
    recipes = family.effects.RECIPES
    return [
        key
        for key, recipe in recipes.items()
        if recipe.outside == outside and (not family.electric or name in recipe.families)
    ]


def _wishes(family: Family, name: str, kind: str, rng: np.random.Generator) -> Iterator[Any]:
    """What the cases of a kind are about: (effect, size), a number of effects, a change, or nothing."""
    recipes, known = family.effects.RECIPES, _names(family, name, False)
    if kind == "single":
        sized = [key for key in known if len(recipes[key].sizes) > 1]
        return _alternating(
            endless([(key, "typical") for key in known], rng),
            endless([(key, size) for key in sized for size in SIZES[::2]], rng),
        )
    if kind == "mixture":
        return endless((2, 2, 3), rng)
    if kind == "place":
        return endless([(key, "typical") for key in known if not recipes[key].machine], rng)
    if kind == "outside":
        return endless([(key, "typical") for key in _names(family, name, True)], rng)
    if kind == CHANGE:
        return endless(CHANGES[family.electric], rng)
    return endless((None,), rng)


def _alternating(first: Iterator[Any], second: Iterator[Any]) -> Iterator[Any]:
    while True:
        yield next(first)
        yield next(second)


def _case(index: int, family: str, kind: str, wish: Any, rng: np.random.Generator) -> Case:
    name, draw, effects = f"case_{index:03d}", FAMILIES[family].draw, FAMILIES[family].effects
    for _ in range(ATTEMPTS):
        machine = draw(rng)
        if kind == "none":
            return Case(name, family, kind, machine, effects.with_ordinary(machine, (), rng))
        if kind == CHANGE:
            found = changed(machine, wish, rng)
            if found is not None:
                before, later = found
                earlier, viscosity = earlier_trials(machine, rng), earlier_viscosity(rng)
                return Case(name, family, kind, machine, later, before, wish, earlier, viscosity)
            continue
        planted = _mixed(machine, wish, rng) if kind == "mixture" else _one(machine, kind, wish, rng)
        if planted:
            return Case(name, family, kind, machine, effects.with_ordinary(machine, planted, rng))
    raise HqpipeError(f"{name}: no machine shows {wish} in {ATTEMPTS} draws; this is an error of hqpipe, report it")


def _one(machine: Any, kind: str, wish: tuple[str, str], rng: np.random.Generator) -> tuple[Planted, ...]:
    """One effect of a size, at times beside the ordinary friction; nothing where this machine does not show it."""
    key, size = wish
    family = FAMILIES[machine.family]
    if key not in family.effects.possible(machine, kind == "outside"):
        return ()
    if kind == "place" and len(machine.names) < 2:
        return ()
    alone = kind == "place" or (kind == "outside" and len(machine.names) > 1 and rng.random() < 0.4)
    joints = (str(rng.choice(machine.names)),) if alone else machine.names
    found = [family.effects.plant(machine, key, size, joints, rng)]
    if family.electric and key != FRICTION and rng.random() < ORDINARY:
        found.append(ordinary_friction(machine, rng))
    return tuple(found)


def _mixed(machine: Any, count: int, rng: np.random.Generator) -> tuple[Planted, ...]:
    """Two or three effects of typical size; a third of them in one joint where there are several."""
    effects = FAMILIES[machine.family].effects
    chosen: list[str] = []
    for key in rng.permutation(effects.possible(machine)):
        if len(chosen) < count and not any({str(key), other} in EXCLUSIVE for other in chosen):
            chosen.append(str(key))
    if len(chosen) < count:
        return ()
    found = []
    for key in chosen:
        alone = len(machine.names) > 1 and not effects.RECIPES[key].machine and rng.random() < 1.0 / 3.0
        joints = (str(rng.choice(machine.names)),) if alone else machine.names
        found.append(effects.plant(machine, key, "typical", joints, rng))
    return tuple(found)


def describe(case: Case) -> dict[str, Any]:
    """What answers.json says of the machine of a case, beside its effects."""
    return families.describe(case.machine)


def write(case: Case, folder: Path, writer: Any, leave_out: Sequence[str] = (), before: bool = False) -> None:
    """Simulate the machine of a case and write its log set.

    Args:
        folder: made. writer: `hqpipe.logs.writer.LogSetWriter`, handed in because this package imports no reader of logs.
        leave_out: effects that the machine does not have. before: the reference of a case of kind "change".
    """
    machine = case.faulty(leave_out, before)
    log, (mode, source) = machine.logger, families.control(machine)
    kinds = dict(zip(machine.names, machine.kinds, strict=True)) if "prismatic" in machine.kinds else None
    with writer(
        folder,
        base="fixed",
        control_mode=mode,
        effort_source=source,
        rate_hz=log.rate_hz,
        clock_source="logger",
        kinds=kinds,
    ) as out:
        for trial in machine.trials:
            known = families.stated(machine, trial)
            out.add(
                trial.file,
                families.columns(machine, trial),
                split=trial.split,
                repairable=log.jitter > 0.0,
                **known,
            )
