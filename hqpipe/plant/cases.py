"""The withheld-effect cases: which machine moves how, and what is wrong with it. No candidate effect is known here.

`cases(n, seed, kinds)` always gives the same list. The machine without effects is in `hqpipe.plant.case_machine`, the
effects in `hqpipe.plant.case_effects`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hqpipe.drawing import apportion, endless, shares_of
from hqpipe.plant.case_effects import RECIPES, SIZES, Recipe, sized_supply
from hqpipe.plant.case_machine import BASE, sound_machine
from hqpipe.plant.config import PlantConfig

__all__ = ["BASE", "FAINT", "KINDS", "ON_REQUEST", "Case", "Motion", "Planted", "cases", "sound_machine"]

FAINT = (1.0 / 16.0, 2.0)  # sizes over the small one: from what nothing can see to where most is seen
KINDS = {"none": 0.10, "single": 0.40, "mixture": 0.25, "place": 0.10, "outside": 0.15}
"""Share of each kind of case: no effect; one in all joints; two to four; one in some joints or for some time; one that
no library of the diagnosis holds."""
ON_REQUEST = {"faint": 0.40}
"""Kinds that are made only when they are asked for, with their weight beside others: one effect in all joints at a size
round the limit of detection."""

JOINTS = tuple(f"{leg}{kind}" for leg in ("LF", "RF", "LH", "RH") for kind in "RPK")  # robot.yaml
LEGS, JOINT_KINDS = ("LF", "RF", "LH", "RH"), ("R", "P", "K")
MOTIONS = {"gantry": 0.4, "trot": 0.4, "both": 0.2}
FIT_SECONDS, HELDOUT_SECONDS = 9.0, 7.0
LOAD_CELLS, PRESSURES = 0.25, 0.15  # share of the cases that need neither
MIXED = (2, 3, 4)

# Effects that cannot be told apart by their nature, or that need the same field of the plant.
EXCLUSIVE = (
    {"torque_bias", "position_bias"},  # a constant offset of torque and of command are one term of the model
    {"orifice_flow", "position_dependent_stiffness"},  # both are made by the cylinder's volumes
    {"unsigned_sensor", "torque_bias"},  # what comes first, the offset or the lost sign, is a convention
    {"unsigned_sensor", "torque_scale"},
    {"orifice_flow", "torque_scale"},  # another piston area is a scale too, seen from the pressures
)
_LASTING = {
    *("gain_drift", "integral_action", "unsigned_sensor", "channel_skew", "backlash"),
    *("orifice_flow", "position_dependent_stiffness"),
}
"""Not planted in a time span: they have a memory, or are another cylinder, and so no state that comes and goes."""


@dataclass(frozen=True)
class Planted:
    """One effect in some joints.

    Attributes:
        effect: its name. layer: "actuator" or "sensing". outside: no library of the diagnosis holds it.
        joints: where. scope: "machine", "group" or "joint", as in diagnosis.json.
        size: "small", "typical" or "large"; None if it has no size.
        span: start and end as shares of each trial, None for all of it.
        parameters: as in diagnosis.json, None where that has no such number.
        overrides: of one joint, or of the machine, for `PlantConfig`.
        factor: size over the small one (`Recipe.draw_faint`) of a faint effect, else None.
    """

    effect: str
    layer: str
    outside: bool
    joints: tuple[str, ...]
    scope: str
    size: str | None
    span: tuple[float, float] | None
    parameters: dict[str, float | None]
    overrides: dict[str, Any]
    factor: float | None = None

    def plant_overrides(self, seconds: float) -> dict[str, Any]:
        """Overrides of a trial that lasts `seconds`."""
        if self.span:
            time = [round(share * seconds, 3) for share in self.span]
            return {"spans": [{"time": time, "joints": list(self.joints), **self.overrides}]}
        if self.joints == JOINTS:
            return self.overrides
        return {"joints": {joint: self.overrides for joint in self.joints}}


@dataclass(frozen=True)
class Motion:
    """One trial: `motion` is "gantry" or "trot"; `split` "fit" or "heldout"."""

    file: str
    motion: str
    seconds: float
    split: str
    seed: int


@dataclass(frozen=True)
class Case:
    """One machine and its trials.

    Attributes:
        name: case_NNN. kind: of `KINDS` or `ON_REQUEST`. excitation: of `MOTIONS`. effort_source: "pressure" or
            "load_cell".
        pressures: whether the chamber pressures are logged. seed: of motion and noise. planted: what is wrong.
    """

    name: str
    kind: str
    excitation: str
    effort_source: str
    pressures: bool
    seed: int
    planted: tuple[Planted, ...]

    def trials(self) -> tuple[Motion, ...]:
        """Half of the time each where both motions are recorded."""
        motions = ("gantry", "trot") if self.excitation == "both" else (self.excitation,)
        plan = [
            (motion, round(total / len(motions), 1), split)
            for split, total in (("fit", FIT_SECONDS), ("heldout", HELDOUT_SECONDS))
            for motion in motions
        ]
        return tuple(
            Motion(f"trial_{i + 1}.parquet", m, s, split, self.seed + i) for i, (m, s, split) in enumerate(plan)
        )

    def machine(self, seconds: float, leave_out: Sequence[str] = ()) -> dict[str, Any]:
        """Overrides for `PlantConfig`, without the effects named in `leave_out`.

        Args:
            seconds: length of the trial, which places time spans.
        """
        config = PlantConfig(sound_machine(self.effort_source))
        for planted in self.planted:
            if planted.effect not in leave_out:
                config = config.merged(PlantConfig(planted.plant_overrides(seconds)))
        return dict(config.overrides)


def cases(n: int, seed: int, kinds: Sequence[str] = ()) -> list[Case]:
    """The cases in the order in which they are numbered, kinds mixed.

    Args:
        n: how many. seed: of everything. kinds: of `KINDS` and `ON_REQUEST`; none for all of `KINDS`.

    Raises:
        UsageError: a kind that does not exist.
    """
    rng, shares = np.random.default_rng([seed, n]), shares_of(kinds, KINDS, ON_REQUEST)
    order = apportion(shares, n, rng), apportion(MOTIONS, n, rng)
    drawn = {kind: _planted_of(kind, rng) for kind in shares}
    return [
        _case(index, kind, motion, drawn[kind], rng) for index, (kind, motion) in enumerate(zip(*order, strict=True))
    ]


def _case(index: int, kind: str, motion: str, plan: Iterator[Any], rng: np.random.Generator) -> Case:
    entries = next(plan)
    recipes = [RECIPES[name] for name, *_ in entries]
    if motion == "gantry" and any(recipe.gantry is None for recipe in recipes):
        motion = "trot"
    needs_cell = any(recipe.load_cell for recipe in recipes)
    source = "load_cell" if needs_cell or rng.random() < LOAD_CELLS else "pressure"
    pressures = any(recipe.pressures for recipe in recipes) or bool(rng.random() < PRESSURES)
    pressures = pressures and not any(recipe.other_area for recipe in recipes)
    planted = _sized(tuple(_plant(entry, motion, source, rng) for entry in entries))
    seed = int(rng.integers(1, 2**31 - 10))
    return Case(f"case_{index:03d}", kind, motion, source, pressures, seed, planted)


def _plant(entry: tuple[Any, ...], motion: str, source: str, rng: np.random.Generator) -> Planted:
    name, size, joints, span, *faint = entry
    recipe, factor = RECIPES[name], faint[0] if faint else None
    value = recipe.draw(size, motion, rng) if factor is None else recipe.draw_faint(factor, motion, rng)
    overrides, parameters = recipe.build(value, source, rng)
    if factor is not None:
        overrides = dict(PlantConfig(overrides).merged(PlantConfig(recipe.faint)).overrides)
    scope = "machine" if joints == JOINTS else "joint" if len(joints) == 1 else "group"
    return Planted(name, recipe.layer, recipe.outside, joints, scope, size, span, parameters, overrides, factor)


def _sized(planted: tuple[Planted, ...]) -> tuple[Planted, ...]:
    """With a supply that is as large as the pistons that it feeds."""
    by_name = {one.effect: one for one in planted}
    if not {"supply_droop", "orifice_flow"} <= set(by_name):
        return planted
    supply, pistons = by_name["supply_droop"], by_name["orifice_flow"]
    overrides = sized_supply(supply.overrides, pistons.overrides, len(pistons.joints) / len(JOINTS))
    return tuple(replace(one, overrides=overrides) if one is supply else one for one in planted)


def _planted_of(kind: str, rng: np.random.Generator) -> Iterator[list[tuple[Any, ...]]]:
    """Lists of (effect, size, joints, span), with the factor where it is faint; one list a case."""
    makers = {
        "none": _nothing,
        "single": _single,
        "mixture": _mixture,
        "place": _place,
        "outside": _outside,
        "faint": _faint,
    }
    return makers[kind](rng)


def _nothing(rng: np.random.Generator) -> Iterator[list[tuple[Any, ...]]]:
    while True:
        yield []


def _single(rng: np.random.Generator) -> Iterator[list[tuple[Any, ...]]]:
    """Every second case of typical size."""
    names = [r.name for r in RECIPES.values() if not r.outside and not r.pressures]
    typical, others = (
        endless(names, rng),
        endless([(n, s) for n in names for s in SIZES[::2] if len(RECIPES[n].trot) > 1], rng),
    )
    while True:
        name = next(typical)
        yield [(name, _size(RECIPES[name], "typical"), JOINTS, None)]
        name, size = next(others)
        yield [(name, size, JOINTS, None)]


def _faint(rng: np.random.Generator) -> Iterator[list[tuple[Any, ...]]]:
    """The effects that have a size and show in all joints, in turn, at sizes drawn log-uniformly."""
    names = [r.name for r in RECIPES.values() if not r.outside and not r.pressures and len(r.trot) > 1]
    for name in endless(names, rng):
        factor = float(np.exp(rng.uniform(*np.log(FAINT))))
        yield [(name, None, JOINTS, None, factor)]


def _outside(rng: np.random.Generator) -> Iterator[list[tuple[Any, ...]]]:
    names = endless([r.name for r in RECIPES.values() if r.outside], rng)
    for name in names:
        recipe = RECIPES[name]
        joints = JOINTS if recipe.machine or rng.random() < 0.6 else _some_joints(recipe, rng)
        yield [(name, "typical", joints, None)]


def _place(rng: np.random.Generator) -> Iterator[list[tuple[Any, ...]]]:
    """One joint, a leg, a kind of joint, or a quarter to a third of the time, in turn."""
    names = [r.name for r in RECIPES.values() if not r.outside and not r.machine]
    anywhere = endless(names, rng)
    for_a_time = endless([name for name in names if name not in _LASTING and not RECIPES[name].pressures], rng)
    for scope in endless(("joint", "leg", "kind", "span"), rng):
        if scope == "span":
            name, start = next(for_a_time), rng.uniform(0.1, 0.6)
            yield [(name, "typical", JOINTS, (round(start, 3), round(start + rng.uniform(0.25, 0.33), 3)))]
            continue
        name = next(anywhere)
        scope = "leg" if scope == "kind" and RECIPES[name].pressures else scope  # as in `_some_joints`
        yield [(name, _size(RECIPES[name], "typical"), _joints_of(scope, rng), None)]


def _mixture(rng: np.random.Generator) -> Iterator[list[tuple[Any, ...]]]:
    """Two to four effects of typical size, half of them in all joints, the others where they please."""
    names = [r.name for r in RECIPES.values() if not r.outside]
    for count in endless(MIXED, rng):
        chosen: list[str] = []
        while len(chosen) < count:
            name = str(rng.choice(names))
            if name not in chosen and not any({name, other} in EXCLUSIVE for other in chosen):
                chosen.append(name)
        yield [_mixed(name, rng) for name in chosen]


def _mixed(name: str, rng: np.random.Generator) -> tuple[Any, ...]:
    recipe = RECIPES[name]
    # Without its sign a torque hides what else is wrong with its joint.
    local = recipe.pressures or name == "unsigned_sensor"
    everywhere = recipe.machine or (not local and rng.random() < 0.5)
    return (name, _size(recipe, "typical"), JOINTS if everywhere else _some_joints(recipe, rng), None)


def _size(recipe: Recipe, wanted: str) -> str | None:
    return wanted if len(recipe.trot) > 1 else None


def _some_joints(recipe: Recipe, rng: np.random.Generator) -> tuple[str, ...]:
    # A sensor's gain is seen beside other joints of its kind, so that a whole kind has no reference.
    scopes = ["joint", "leg"] if recipe.pressures else ["joint", "leg", "kind"]
    return _joints_of(str(rng.choice(scopes)), rng)


def _joints_of(scope: str, rng: np.random.Generator) -> tuple[str, ...]:
    """A joint, the joints of a leg, or those of a kind."""
    if scope == "joint":
        return (str(rng.choice(JOINTS)),)
    if scope == "leg":
        leg = str(rng.choice(LEGS))
        return tuple(joint for joint in JOINTS if joint.startswith(leg))
    kind = str(rng.choice(JOINT_KINDS))
    return tuple(joint for joint in JOINTS if joint.endswith(kind))
