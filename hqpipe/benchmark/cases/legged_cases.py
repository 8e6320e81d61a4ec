"""The withheld cases of legged machines: which robot moves how, and what is wrong with it.

`cases(n, seed, kinds)` always gives the same list.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.benchmark.cases.legged.draw import LeggedMachine, draw_machine, with_settings
from hqpipe.benchmark.cases.legged.effects import RECIPES, LeggedRecipe
from hqpipe.benchmark.cases.legged.outside import OUTSIDE, ordinary
from hqpipe.benchmark.cases.legged.robots import ROBOTS
from hqpipe.benchmark.cases.planted import SIZES, Built, Planted, plant_recipe
from hqpipe.drawing import apportion, endless, shares_of
from hqpipe.errors import HqpipeError

KINDS = {"none": 0.10, "single": 0.40, "mixture": 0.25, "place": 0.10, "outside": 0.15}
"""Share of each kind: no effect; one; two to four; one in a place or a time span; one that no library holds."""
EXCLUSIVE = (  # two that the same logs could not tell apart by any method
    {"valve_lag", "valve_delay"},
    {"valve_lag", "command_delay"},
    {"valve_delay", "command_delay"},
    {"channel_skew", "command_delay"},
    {"channel_skew", "valve_delay"},
    {"torque_bias", "position_bias"},
    {"position_bias", "integral_action"},
    {"gain_drift", "leakage_drift"},
    {"backlash", "transmission_compliance"},
    {"unsigned_sensor", "channel_skew"},
    {"unsigned_sensor", "torque_bias"},
)
SCOPES = {"machine": 0.35, "kind": 0.2, "leg": 0.15, "joint": 0.15, "group": 0.15}
"""Where an effect that may be anywhere is; assumption."""
SPAN = 0.5  # share of the "place" cases that have a time span
ATTEMPTS = 200  # machines drawn until one shows what is asked for


@dataclass(frozen=True)
class Spanned(Planted):
    """An effect that may act for a part of each trial.

    Attributes:
        span: start and end as shares of the trial, None for all of it. faulty: joints in which there is more of it than in
            a sound machine; empty if these are all joints that have it.
    """

    span: tuple[float, float] | None = None
    faulty: tuple[str, ...] = ()

    def answer(self) -> dict[str, Any]:
        span = None if self.span is None else list(self.span)
        return super().answer() | {"span": span, "faulty_joints": list(self.faulty or self.joints)}


@dataclass(frozen=True)
class Case:
    """One machine and its trials.

    Attributes:
        name: case_NNN. kind: of `KINDS`. machine: sound. planted: what is wrong. also: ordinary effects of the machine.
    """

    name: str
    kind: str
    machine: LeggedMachine
    planted: tuple[Spanned, ...]
    also: tuple[Spanned, ...]

    def faulty(self, leave_out: Sequence[str] = ()) -> LeggedMachine:
        """The machine with its effects, without those named."""
        found = self.machine
        for one in self.planted:
            if one.effect not in leave_out:
                found = with_settings(found, one.settings)
        spans = [one.span for one in self.planted if one.span is not None]
        return replace(found, span=spans[0] if spans else None)


def cases(n: int, seed: int, kinds: Sequence[str] = ()) -> list[Case]:
    """The cases in the order in which they are numbered; the three robots in turn.

    Args:
        n: how many. seed: of everything. kinds: of `KINDS`; none for all of them.

    Raises:
        UsageError: a kind that does not exist.
    """
    rng = np.random.default_rng([seed, n, 31])
    order = apportion(shares_of(kinds, KINDS, {}), n, rng)
    plans: dict[str, Iterator[Any]] = {}
    first = int(rng.integers(len(ROBOTS)))
    found = []
    for index, kind in enumerate(order):
        wish = next(plans.setdefault(kind, _wishes(kind, rng)))
        found.append(_case(index, kind, wish, (first + index) % len(ROBOTS), np.random.default_rng([seed, 31, index])))
    return found


def _wishes(kind: str, rng: np.random.Generator) -> Iterator[Any]:
    """What the cases of a kind are about: (effect, size), a number of effects, or nothing."""
    if kind == "single":
        sized = [key for key, recipe in RECIPES.items() if len(recipe.sizes) > 1]
        typical = endless([(key, "typical") for key in RECIPES], rng)
        others = endless([(key, size) for key in sized for size in SIZES[::2]], rng)
        return _alternating(typical, others)
    if kind == "mixture":
        return endless((2, 2, 3, 4), rng)
    if kind == "place":
        return endless([(key, "typical") for key, recipe in RECIPES.items() if not recipe.machine], rng)
    if kind == "outside":
        return endless([(key, "typical") for key in OUTSIDE], rng)
    return endless((None,), rng)


def _alternating(first: Iterator[Any], second: Iterator[Any]) -> Iterator[Any]:
    while True:
        yield next(first)
        yield next(second)


def shows(recipe: LeggedRecipe, machine: LeggedMachine) -> bool:
    """Whether the logs of a machine can show an effect at all."""
    if recipe.name == "supply_droop" and machine.logger.supply:
        return True
    return recipe.source in (None, machine.logger.effort_source)


def _case(index: int, kind: str, wish: Any, robot: int, rng: np.random.Generator) -> Case:
    name = f"case_{index:03d}"
    for _ in range(ATTEMPTS):
        machine = draw_machine(ROBOTS[robot](), rng)
        planted = _planted(machine, kind, wish, rng)
        if planted is not None:
            return _with_ordinary(Case(name, kind, machine, planted, ()))
    raise HqpipeError(f"{name}: no machine shows {wish} in {ATTEMPTS} draws; this is an error of hqpipe, report it")


def _planted(machine: LeggedMachine, kind: str, wish: Any, rng: np.random.Generator) -> tuple[Spanned, ...] | None:
    """The effects of a case; None where this machine does not show them."""
    if kind == "none":
        return ()
    if kind == "mixture":
        return _mixture(machine, wish, rng)
    key, size = wish
    recipe = (OUTSIDE if kind == "outside" else RECIPES)[key]
    if not shows(recipe, machine):
        return None
    if kind == "place":
        if recipe.spans and rng.random() < SPAN:
            joints = _place(machine, "machine" if rng.random() < 0.5 else "group", rng)
            return (plant(machine, recipe, size, joints, rng, span=_span(rng)),)
        scope = str(rng.choice(["joint", "leg", "group"], p=[0.5, 0.25, 0.25]))
        return (plant(machine, recipe, size, _place(machine, scope, rng), rng),)
    return (plant(machine, recipe, size, _anywhere(machine, recipe, rng), rng),)


def _mixture(machine: LeggedMachine, count: int, rng: np.random.Generator) -> tuple[Spanned, ...]:
    chosen: list[str] = []
    for key in rng.permutation(list(RECIPES)):
        fits = shows(RECIPES[str(key)], machine) and not any({str(key), other} in EXCLUSIVE for other in chosen)
        if fits and len(chosen) < count:
            chosen.append(str(key))
    return tuple(plant(machine, RECIPES[key], "typical", _anywhere(machine, RECIPES[key], rng), rng) for key in chosen)


def _anywhere(machine: LeggedMachine, recipe: LeggedRecipe, rng: np.random.Generator) -> tuple[str, ...]:
    if recipe.machine:
        return machine.names
    return _place(machine, str(rng.choice(list(SCOPES), p=list(SCOPES.values()))), rng)


def _place(machine: LeggedMachine, scope: str, rng: np.random.Generator) -> tuple[str, ...]:
    """Joints of a scope: all, those of a kind, those of a leg, one, or any two to five."""
    names, robot = machine.names, machine.robot
    if scope == "machine":
        return names
    if scope == "kind":
        kind = str(rng.choice(sorted(set(robot.kinds))))
        return tuple(name for name, own in zip(names, robot.kinds, strict=True) if own == kind)
    if scope == "leg":
        first = int(rng.integers(len(robot.legs))) * robot.per_leg
        return names[first : first + robot.per_leg]
    count = 1 if scope == "joint" else int(rng.integers(2, 6))
    chosen = set(rng.choice(len(names), count, replace=False).tolist())
    return tuple(name for j, name in enumerate(names) if j in chosen)


def _span(rng: np.random.Generator) -> tuple[float, float]:
    """Shares of a trial: at least a fifth of it, at most four fifths; a third each begins with it, ends with it, or neither."""
    length = float(rng.uniform(0.2, 0.8))
    where = int(rng.integers(3))
    start = 0.0 if where == 0 else 1.0 - length if where == 1 else float(rng.uniform(0.0, 1.0 - length))
    return round(start, 3), round(start + length, 3)


def plant(
    machine: LeggedMachine,
    recipe: LeggedRecipe,
    size: str | None,
    joints: Sequence[str],
    rng: np.random.Generator,
    span: tuple[float, float] | None = None,
) -> Spanned:
    """An effect of a size in some joints, scattered between them."""

    def build(name: str, level: float) -> Built:
        return recipe.build(machine, machine.names.index(name), level, rng)

    found = plant_recipe(recipe, recipe.name, recipe.layer, size, joints, machine.names, build, rng)
    settings = {"supply": next(iter(found.settings.values()))} if recipe.machine else found.settings
    shared = {
        name: getattr(found, name) for name in ("effect", "layer", "outside", "joints", "scope", "size", "parameters")
    }
    return Spanned(**shared, settings=settings, span=span)


def _with_ordinary(case: Case) -> Case:
    """The case with what its machine has anyway.

    Where an effect is planted that sound joints have as well, to a lesser degree, naming it in all of them is right, and
    in the faulty ones it is needed.
    """
    names, planted, also = case.machine.names, list(case.planted), []
    lapped = {joint for one in planted if one.effect == "valve_deadband" and one.span is None for joint in one.joints}
    for effect, parameters in ordinary(case.machine).items():
        if effect == "valve_underlap":  # a spool whose lands overlap has no open centre
            parameters = {name: numbers for name, numbers in parameters.items() if name not in lapped}
            if not parameters:
                continue
        same = next((i for i, one in enumerate(planted) if one.effect == effect), None)
        if same is None:
            joints = tuple(name for name in names if name in parameters)
            layer = "sensing" if effect == "position_bias" else "actuator"
            scope = "machine" if joints == names else "joint" if len(joints) == 1 else "group"
            also.append(Spanned(effect, layer, False, joints, scope, None, parameters, {}, ordinary=True))
            continue
        one = planted[same]
        if one.span is None:
            merged = parameters | one.parameters
            joints = tuple(name for name in names if name in merged)
            scope = "machine" if joints == names else one.scope
            merged = {name: merged[name] for name in joints}
            planted[same] = replace(one, joints=joints, scope=scope, parameters=merged, faulty=one.joints)
    return replace(case, planted=tuple(planted), also=tuple(also))


def describe(case: Case) -> dict[str, Any]:
    """What answers.json says of the machine of a case, beside its effects."""
    machine, log = case.machine, case.machine.logger
    return {
        "family": machine.robot.name,
        "joints": list(machine.names),
        "rate_hz": 1000.0 / log.every,
        "effort_source": log.effort_source,
        "velocity": log.speed,
        "pressures": log.pressures,
        "supply": log.supply,
        "policy_hz": 1000.0 / log.policy_ticks,
        "trials": [trial.motion for trial in machine.trials],
    }


def write(case: Case, folder: Path, writer: Any, leave_out: Sequence[str] = ()) -> None:
    """Simulate the machine of a case and write its log set.

    Args:
        folder: made. writer: `hqpipe.logs.writer.LogSetWriter`, handed in because this package imports no reader of logs.
        leave_out: effects that the machine does not have.
    """
    from hqpipe.benchmark.cases.legged.record import record

    machine = case.faulty(leave_out)
    with writer(
        folder,
        robot=machine.robot.robot,
        base="fixed",
        control_mode="position",
        effort_source=machine.logger.effort_source,
        rate_hz=1000.0 / machine.logger.every,
        clock_source="controller tick",
    ) as out:
        for trial in machine.trials:
            out.add(trial.file, record(machine, trial), split=trial.split)
