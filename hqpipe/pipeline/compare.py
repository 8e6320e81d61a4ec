"""What differs between two results: how they were made, and what came out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hqpipe.pipeline.hashing import SHORT
from hqpipe.pipeline.manifest import Manifest
from hqpipe.pipeline.reasons import Reason, differences, parameter_differences


@dataclass(frozen=True)
class Difference:
    """Two results side by side.

    Args:
        stages: names of the stages that made them.
        keys: their keys.
        causes: what differs in how they were made.
        metrics: metrics that differ.
        files: files that differ, are absent in one, or were added.
        versions: package versions and git commits that differ.
    """

    stages: tuple[str, str]
    keys: tuple[str, str]
    causes: tuple[Reason, ...]
    metrics: tuple[Reason, ...]
    files: tuple[str, ...]
    versions: tuple[Reason, ...]

    def to_json(self) -> dict[str, Any]:
        return {
            "stages": list(self.stages),
            "keys": list(self.keys),
            "causes": [reason.to_json() for reason in self.causes],
            "metrics": [reason.to_json() for reason in self.metrics],
            "files": list(self.files),
            "versions": [reason.to_json() for reason in self.versions],
        }

    def lines(self) -> list[str]:
        """The same for people."""
        lines = [f"{stage} {key[:SHORT]}…" for stage, key in zip(self.stages, self.keys, strict=True)]
        groups = {
            "made with": [reason.text for reason in self.causes],
            "metrics": [reason.text for reason in self.metrics],
            "files": list(self.files),
            "versions": [reason.text for reason in self.versions],
        }
        for title, items in groups.items():
            lines.append(f"{title}: {'' if items else 'the same'}".rstrip())
            lines += [f"  {item}" for item in items]
        return lines


def compare(old: Manifest, new: Manifest) -> Difference:
    """Everything that differs from `old` to `new`."""
    names = sorted(old.outputs.keys() | new.outputs.keys())
    versions = ("hqpipe", "python", "packages", "git", "machine", "profile")
    return Difference(
        stages=(old.recipe.stage, new.recipe.stage),
        keys=(old.key, new.key),
        causes=differences(old, new.recipe),
        metrics=tuple(parameter_differences(old.metrics, new.metrics)),
        files=tuple(name for name in names if old.outputs.get(name) != new.outputs.get(name)),
        versions=tuple(
            reason
            for name in versions
            for reason in parameter_differences(old.provenance.get(name), new.provenance.get(name), name)
        ),
    )
