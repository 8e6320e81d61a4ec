"""What is wrong with a machine: effects, their numbers joint by joint, and the settings that they stand for."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

SIZES = ("small", "typical", "large")


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


@dataclass(frozen=True)
class Motion:
    """One trial.

    Attributes:
        file: its name. split: "fit" or "heldout". seconds: length. seed: of the motion and the noise.
        names: of the motion of each joint, `hqpipe.benchmark.motions.MOTIONS`.
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
