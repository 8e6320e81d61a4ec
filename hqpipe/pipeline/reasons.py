"""Why a stage reruns: the differences between what made the current artifact and what is wanted now."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from hqpipe.pipeline.hashing import SHORT
from hqpipe.pipeline.manifest import Manifest, Recipe


@dataclass(frozen=True)
class Reason:
    """One cause.

    Args:
        kind: ``missing``, ``forced``, ``parameter``, ``seed``, ``input``, ``upstream``, ``robot``, ``code``
            or ``damaged``.
        name: the parameter, input or artifact that it is about.
        old, new: what the current artifact was made with and what is wanted; None where that means nothing.
    """

    kind: str
    name: str
    old: Any = None
    new: Any = None

    @property
    def text(self) -> str:
        """The cause in words."""
        if self.kind == "missing":
            return f"{self.name} has not been made"
        if self.kind == "upstream":
            return f"input {self.name} is made again"
        if self.kind in ("forced", "damaged"):
            return self.name
        label = {"parameter": self.name, "input": f"input {self.name}", "code": "code version"}
        return f"{label.get(self.kind, self.kind)} {_shown(self.old)} → {_shown(self.new)}"

    def to_json(self) -> dict[str, Any]:
        return {**asdict(self), "text": self.text}


def _opened(value: Any, other: Any) -> Any:
    """A mapping without entries for a mapping that one side lacks, so that its entries are told one by one."""
    return {} if value is None and isinstance(other, dict) else value


def _shown(value: Any) -> str:
    return "(not set)" if value is None else f"{value}"


def differences(current: Manifest, wanted: Recipe) -> tuple[Reason, ...]:
    """What differs between the recipe of the current artifact and the wanted one; empty if nothing does."""
    made = current.recipe
    found = []
    if made.version != wanted.version:
        found.append(Reason("code", made.stage, made.version, wanted.version))
    found += parameter_differences(made.params, wanted.params)
    if made.seed != wanted.seed:
        found.append(Reason("seed", "seed", made.seed, wanted.seed))
    for name in sorted(made.inputs.keys() | wanted.inputs.keys()):
        old, new = made.inputs.get(name), wanted.inputs.get(name)
        if old != new:
            found.append(Reason("input", name, old and old[:SHORT], new and new[:SHORT]))
    if made.robot != wanted.robot:
        found.append(Reason("robot", "robot", made.robot[:SHORT], wanted.robot[:SHORT]))
    return tuple(found)


def parameter_differences(old: Any, new: Any, name: str = "") -> list[Reason]:
    """Differing leaves of two parameter mappings, named by their dotted path."""
    old, new = _opened(old, new), _opened(new, old)
    if not isinstance(old, dict) or not isinstance(new, dict):
        return [] if old == new else [Reason("parameter", name, old, new)]
    found = []
    for key in sorted(old.keys() | new.keys()):
        found += parameter_differences(old.get(key), new.get(key), f"{name}.{key}" if name else key)
    return found
