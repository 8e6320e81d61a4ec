"""What is wrong with a machine: effects, their numbers joint by joint, and the settings that they stand for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

Numbers = dict[str, float | None]
Built = tuple[dict[str, float], Numbers]
"""Fields of a joint and their values, and the numbers as in diagnosis.json."""
SIZES = ("small", "typical", "large")
SCATTER = (0.05, 0.15)  # half width of the uniform scatter between joints, which so differ by 10 to 30 %


@dataclass(frozen=True)
class Planted:
    """One effect in some joints.

    Attributes:
        effect: as in diagnosis.json; for what no library holds a name of its own. layer: in which it is found.
        outside: no library of the diagnosis holds it.
        joints: where. scope: "machine", "group" or "joint".
        size: of `SIZES`, None if it has no size.
        parameters: joint → as in diagnosis.json, None where that has no such number.
        settings: joint → field of the simulated machine → value.
        ordinary: what every such machine has, friction or the lag of a spool, beside the effect that the case is about.
    """

    effect: str
    layer: str
    outside: bool
    joints: tuple[str, ...]
    scope: str
    size: str | None
    parameters: dict[str, dict[str, float | None]]
    settings: dict[str, dict[str, float]] = field(repr=False)
    ordinary: bool = False

    def mean(self) -> dict[str, float | None]:
        """Mean over the joints, which scatter."""
        found: dict[str, float | None] = {}
        for name in next(iter(self.parameters.values()), {}):
            values = [numbers[name] for numbers in self.parameters.values()]
            found[name] = None if any(v is None for v in values) else sum(values) / len(values)
        return found

    def answer(self) -> dict[str, Any]:
        """For answers.json."""
        return {
            "effect": self.effect,
            "layer": self.layer,
            "outside": self.outside,
            "joints": list(self.joints),
            "scope": self.scope,
            "size": self.size,
            "span": None,
            "parameters": self.mean(),
            "per_joint": self.parameters,
            "ordinary": self.ordinary,
        }


class Sized(Protocol):
    """What every recipe of an effect says.

    Attributes:
        sizes: small, typical, large; or one number. outside: no library holds it.
        machine: belongs to all joints by nature. signed: has either sign, the same in all joints.
    """

    @property
    def sizes(self) -> tuple[float, ...]: ...
    @property
    def outside(self) -> bool: ...
    @property
    def machine(self) -> bool: ...
    @property
    def signed(self) -> bool: ...


def one_setting(setting: str, number: str | None = None) -> Callable[[Any, int, float, np.random.Generator], Built]:
    """How an effect is planted that is one field of the simulated machine, and one number of diagnosis.json or none."""

    def build(machine: Any, j: int, size: float, rng: np.random.Generator) -> Built:
        return {setting: size}, {} if number is None else {number: size}

    return build


def plant_recipe(
    recipe: Sized,
    effect: str,
    layer: str,
    size: str | None,
    joints: Sequence[str],
    names: Sequence[str],
    build: Callable[[str, float], Built],
    rng: np.random.Generator,
    ordinary: bool = False,
) -> Planted:
    """An effect of a size in some joints, scattered between them.

    Args:
        size: of `SIZES`; None for a typical one. joints: where. names: of all joints of the machine.
        build: joint's name, size as a number → what it stands for. ordinary: as in `Planted`.
    """
    sized = len(recipe.sizes) > 1
    level = recipe.sizes[SIZES.index(size or "typical")] if sized else recipe.sizes[0]
    level *= rng.uniform(0.85, 1.15)
    if recipe.signed and rng.random() < 0.5:
        level = -level
    half = rng.uniform(*SCATTER)
    settings: dict[str, dict[str, float]] = {}
    parameters: dict[str, Numbers] = {}
    for name in joints:
        if recipe.machine and settings:  # one number for all
            first = next(iter(settings))
            settings[name], parameters[name] = settings[first], parameters[first]
            continue
        own = level if recipe.machine else level * rng.uniform(1.0 - half, 1.0 + half)
        fields, numbers = build(name, own)
        settings[name] = {field: float(value) for field, value in fields.items()}
        parameters[name] = {what: None if value is None else float(value) for what, value in numbers.items()}
    scope = "machine" if tuple(joints) == tuple(names) else "joint" if len(joints) == 1 else "group"
    planted_size = size if sized else None
    return Planted(effect, layer, recipe.outside, tuple(joints), scope, planted_size, parameters, settings, ordinary)


@dataclass(frozen=True)
class Motion:
    """One trial.

    Attributes:
        file: its name. split: "fit" or "heldout". seconds: length. seed: of the motion and the noise.
        names: of the motion of each joint, `hqpipe.benchmark.cases.motions.MOTIONS`.
        gain, load: factors on the gains of the position loop and on the load's mass in this trial.
        turns: the joints move one after the other, in equal shares of the time, and rest before and after.
    """

    file: str
    split: str
    seconds: float
    seed: int
    names: tuple[str, ...]
    gain: float = 1.0
    load: float = 1.0
    turns: bool = False
