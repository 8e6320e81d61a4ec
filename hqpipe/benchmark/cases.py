"""The withheld cases of servos, arms and cylinders: which machine moves how, and what is wrong with it.

`cases(n, seed, machine, kinds)` always gives the same list.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from hqpipe.benchmark import cylinder, cylinder_effects, electric, electric_effects
from hqpipe.benchmark.planted import SIZES, Motion, Planted
from hqpipe.drawing import apportion, endless, shares_of
from hqpipe.errors import HqpipeError, UsageError

FAMILIES = ("servo", "arm", "cylinder")
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
FRICTION = "coulomb_friction"
ORDINARY = 0.5  # share of the other electric cases whose machine has the dry friction that real ones have
NOTHING = "nothing"
CHANGES = {
    "electric": (FRICTION, "payload", "backlash", NOTHING, NOTHING),
    "cylinder": ("valve_lag", "valve_deadband", "direction_asymmetry", NOTHING, NOTHING),
}
"""What has grown between two recordings of the same machine."""
ATTEMPTS = 500  # machines drawn until one shows what is asked for


@dataclass(frozen=True)
class Case:
    """One machine and its trials.

    Attributes:
        name: case_NNN. family: of `FAMILIES`. kind: of `KINDS` or `ON_REQUEST`. machine: sound. planted: what is wrong.
        reference: what was there before, in a case of kind "change", else None. change: what has grown since, likewise.
        earlier: the trials of the reference.
    """

    name: str
    family: str
    kind: str
    machine: Any
    planted: tuple[Planted, ...]
    reference: tuple[Planted, ...] | None = None
    change: str | None = None
    earlier: tuple[Motion, ...] = ()

    def faulty(self, leave_out: Sequence[str] = (), before: bool = False) -> Any:
        """The machine with its effects, without those named; or as it was `before`, in its earlier trials."""
        found = replace(self.machine, trials=self.earlier) if before else self.machine
        for one in (*(self.reference or ()), *(() if before else self.planted)):
            if before or one.effect not in leave_out:
                found = _rooms(self.family)[0].with_settings(found, one.settings)
        return found


def _rooms(family: str) -> tuple[ModuleType, ModuleType]:
    """Modules of the machine and of its effects."""
    return (cylinder, cylinder_effects) if family == "cylinder" else (electric, electric_effects)


def _draw(family: str, rng: np.random.Generator) -> Any:
    draws = {"servo": electric.draw_servo, "arm": electric.draw_arm, "cylinder": cylinder.draw_cylinder}
    return draws[family](rng)


def cases(n: int, seed: int, machine: str = "joints", kinds: Sequence[str] = ()) -> list[Case]:
    """The cases in the order in which they are numbered, kinds and families mixed.

    Args:
        n: how many. seed: of everything. machine: of `FAMILIES`, or "joints" for all of them in turn.
        kinds: of `KINDS` and `ON_REQUEST`; none for all of `KINDS`.

    Raises:
        UsageError: a kind or a machine that does not exist.
    """
    if machine != "joints" and machine not in FAMILIES:
        raise UsageError(f"machine '{machine}', expected joints, {', '.join(FAMILIES)}", field="--machine")
    families = FAMILIES if machine == "joints" else (machine,)
    rng = np.random.default_rng([seed, n, len(families), FAMILIES.index(families[0])])
    order = apportion(shares_of(kinds, KINDS, ON_REQUEST), n, rng)
    plans: dict[tuple[str, str], Iterator[Any]] = {}
    found = []
    for index, kind in enumerate(order):
        family = families[index % len(families)]
        plan = plans.setdefault((family, kind), _wishes(family, kind, rng))
        found.append(
            _case(index, family, kind, next(plan), np.random.default_rng([seed, FAMILIES.index(family), index]))
        )
    return found


def _names(family: str, outside: bool) -> list[str]:
    recipes = _rooms(family)[1].RECIPES
    return [
        key
        for key, recipe in recipes.items()
        if recipe.outside == outside and (family == "cylinder" or family in recipe.families)
    ]


def _wishes(family: str, kind: str, rng: np.random.Generator) -> Iterator[Any]:
    """What the cases of a kind are about: (effect, size), a number of effects, a change, or nothing."""
    recipes = _rooms(family)[1].RECIPES
    if kind == "single":
        sized = [name for name in _names(family, False) if len(recipes[name].sizes) > 1]
        return _alternating(
            endless([(name, "typical") for name in _names(family, False)], rng),
            endless([(name, size) for name in sized for size in SIZES[::2]], rng),
        )
    if kind == "mixture":
        return endless((2, 2, 3), rng)
    if kind == "place":
        return endless([(name, "typical") for name in _names(family, False) if not recipes[name].machine], rng)
    if kind == "outside":
        return endless([(name, "typical") for name in _names(family, True)], rng)
    if kind == "change":
        return endless(CHANGES["cylinder" if family == "cylinder" else "electric"], rng)
    return endless((None,), rng)


def _alternating(first: Iterator[Any], second: Iterator[Any]) -> Iterator[Any]:
    while True:
        yield next(first)
        yield next(second)


def _case(index: int, family: str, kind: str, wish: Any, rng: np.random.Generator) -> Case:
    name = f"case_{index:03d}"
    for _ in range(ATTEMPTS):
        machine = _draw(family, rng)
        if kind == "none":
            return Case(name, family, kind, machine, _with_ordinary(machine, family, (), rng))
        if kind == "change":
            return _changed(name, family, machine, wish, rng)
        planted = _mixed(machine, family, wish, rng) if kind == "mixture" else _one(machine, family, kind, wish, rng)
        if planted:
            return Case(name, family, kind, machine, _with_ordinary(machine, family, planted, rng))
    raise HqpipeError(f"{name}: no machine shows {wish} in {ATTEMPTS} draws; this is an error of hqpipe, report it")


def _with_ordinary(
    machine: Any, family: str, planted: tuple[Planted, ...], rng: np.random.Generator
) -> tuple[Planted, ...]:
    """With what every such machine has and no layer's base model knows of."""
    if family != "cylinder":
        return planted
    return cylinder_effects.with_spools(machine, cylinder_effects.with_load(machine, planted, rng))


def _one(machine: Any, family: str, kind: str, wish: tuple[str, str], rng: np.random.Generator) -> tuple[Planted, ...]:
    """One effect of a size, at times beside the ordinary friction; nothing where this machine does not show it."""
    key, size = wish
    effects = _rooms(family)[1]
    if key not in effects.possible(machine, kind == "outside"):
        return ()
    if kind == "place" and len(machine.names) < 2:
        return ()
    alone = kind == "place" or (kind == "outside" and len(machine.names) > 1 and rng.random() < 0.4)
    joints = (str(rng.choice(machine.names)),) if alone else machine.names
    found = [effects.plant(machine, key, size, joints, rng)]
    if family != "cylinder" and key != FRICTION and rng.random() < ORDINARY:
        found.append(_ordinary(machine, rng))
    return tuple(found)


def _ordinary(machine: Any, rng: np.random.Generator) -> Planted:
    size = str(rng.choice(SIZES[:2]))
    return electric_effects.plant(machine, FRICTION, size, machine.names, rng, ordinary=True)


def _mixed(machine: Any, family: str, count: int, rng: np.random.Generator) -> tuple[Planted, ...]:
    """Two or three effects of typical size; a third of them in one joint where there are several."""
    effects = _rooms(family)[1]
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


def _changed(name: str, family: str, machine: Any, change: str, rng: np.random.Generator) -> Case:
    """The same machine recorded twice; in between something has grown, or nothing has."""
    effects = _rooms(family)[1]
    if family == "cylinder":
        before: tuple[Planted, ...] = ()
        later = () if change == NOTHING else (effects.plant(machine, change, "typical", machine.names, rng),)
    else:
        before = (_ordinary(machine, rng),)
        later = _grown(machine, change, before[0], rng)
    earlier = tuple(replace(trial, seed=int(rng.integers(1, 2**31 - 1))) for trial in machine.trials)
    return Case(name, family, "change", machine, later, before, change, earlier)


def _grown(machine: Any, change: str, friction: Planted, rng: np.random.Generator) -> tuple[Planted, ...]:
    """What is there later and was not before, in all joints; a load on the last one."""
    if change == NOTHING:
        return ()
    if change == "payload":
        return (electric_effects.payload(machine, float(rng.uniform(0.3, 0.8))),)
    if change == "backlash":
        return (electric_effects.plant(machine, change, "typical", machine.names, rng),)
    factor = float(rng.uniform(1.6, 2.5))
    settings = {j: {"coulomb": fields["coulomb"] * factor} for j, fields in friction.settings.items()}
    parameters = {
        j: {"friction_nm": (numbers["friction_nm"] or 0.0) * (factor - 1.0), "asymmetry_nm": 0.0}
        for j, numbers in friction.parameters.items()
    }
    return (replace(friction, settings=settings, parameters=parameters, ordinary=False, size="typical"),)


def describe(case: Case) -> dict[str, Any]:
    """What answers.json says of the machine of a case, beside its effects."""
    machine = case.machine
    found: dict[str, Any] = {"family": case.family, "joints": list(machine.names), "kinds": list(machine.kinds)}
    found["rate_hz"], found["jitter"] = machine.logger.rate_hz, machine.logger.jitter
    if case.family == "cylinder":
        return found | {
            "stops": machine.stops,
            "natural_lag_s": float(machine.axes["lag"][0]),
            "neutral": [float(value) for value in machine.axes["neutral"]],
            "speed_per_command": [float(v) / machine.radius_of(j) for j, v in enumerate(machine.top_speed)],
        }
    scale = machine.logger.effort_scale
    return found | {
        "coupling": machine.coupling,
        "drive": "duty" if machine.joints["by_duty"].any() else "torque",
        "stated": sorted(machine.states) if case.family == "servo" else [],
        "effort_unit": "A" if (scale != 1.0).any() else "N·m",
        "typical_torque": [float(value) for value in machine.torque],
        "inertia": [float(value) for value in machine.inertia],
        "gravity": [float(value) for value in machine.gravity],
        "kp": [float(value) for value in machine.joints["kp"]],
        "kd": [float(value) for value in machine.joints["kd"] + machine.joints["back_emf"]],
    }


def write(case: Case, folder: Path, writer: Any, leave_out: Sequence[str] = (), before: bool = False) -> None:
    """Simulate the machine of a case and write its log set.

    Args:
        folder: made. writer: `hqpipe.logs.writer.LogSetWriter`, which this room does not know.
        leave_out: effects that the machine does not have. before: the reference of a case of kind "change".
    """
    machine = case.faulty(leave_out, before)
    if case.family == "cylinder":
        from hqpipe.benchmark.cylinder_record import record
    else:
        from hqpipe.benchmark.electric_record import record, stated
    log = machine.logger
    position = case.family == "servo" or (case.family == "arm" and "position_command" in log.channels)
    mode = "valve" if case.family == "cylinder" else "position" if position else None
    source = ("pressure" if log.pressures else None) if case.family == "cylinder" else log.effort_source
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
            columns = record(machine, trial)
            known = {} if case.family == "cylinder" else stated(machine, trial)
            out.add(trial.file, columns, split=trial.split, repairable=log.jitter > 0.0, **known)
