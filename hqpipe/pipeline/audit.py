"""Checks of the current artifacts as a whole: their state, every byte, and the chain between them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hqpipe.errors import HqpipeError, IntegrityError
from hqpipe.pipeline.hashing import SHORT
from hqpipe.pipeline.manifest import Manifest
from hqpipe.pipeline.plan import KEEP, Decision, Planner, explicit_source
from hqpipe.pipeline.project import Project
from hqpipe.pipeline.stage import Input, Stage
from hqpipe.pipeline.store import Store

CURRENT, STALE, MISSING, DAMAGED = "current", "stale", "missing", "damaged"


@dataclass(frozen=True)
class Status:
    """One artifact against the configuration.

    Args:
        decision: what the next run would do, and why.
        manifest: record of the current artifact; None if there is none or it is unreadable.
    """

    decision: Decision
    manifest: Manifest | None

    @property
    def state(self) -> str:
        """``current``, ``stale``, ``missing`` or ``damaged``."""
        if self.decision.action == KEEP:
            return CURRENT
        kinds = {reason.kind for reason in self.decision.reasons}
        if "damaged" in kinds:
            return DAMAGED
        return MISSING if "missing" in kinds else STALE

    @property
    def settled(self) -> bool:
        """Whether nothing is left to do: it is current, or runs alone and nobody asked for it since."""
        return self.state == CURRENT or (self.decision.stage.alone and self.state != DAMAGED)

    @property
    def profile(self) -> str | None:
        """Profile with which the artifact was made."""
        return self.manifest.provenance["profile"] if self.manifest else None

    def to_json(self) -> dict[str, Any]:
        made = self.manifest
        return {
            **self.decision.to_json(),
            "artifact": self.decision.stage.artifact,
            "state": self.state,
            "current_key": made.key if made else None,
            "profile": self.profile,
            "created": made.provenance["created"] if made else None,
            "wall_time_s": made.provenance["wall_time_s"] if made else None,
            "gate_failures": made.gate_failures if made else [],
            "metrics": made.metrics if made else {},
        }


def status(planner: Planner) -> list[Status]:
    """The state of every artifact, each byte of the current ones verified."""
    stages = list(planner.project.table.values())
    decisions = planner.preview(stages, report_damage=True)
    return [Status(decision, _manifest(planner.project.store, decision.stage)) for decision in decisions]


def _manifest(store: Store, stage: Stage) -> Manifest | None:
    """Record of the stage's current artifact; None where `status` says ``missing`` or ``damaged``."""
    try:
        entry = store.current(stage.artifact)
    except IntegrityError:
        return None
    return entry.manifest if entry else None


@dataclass(frozen=True)
class Check:
    """What `verify` found about one artifact: problems fail it, notes do not."""

    artifact: str
    files: int
    problems: tuple[HqpipeError, ...]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        return {
            "artifact": self.artifact,
            "files": self.files,
            "problems": [str(problem) for problem in self.problems],
            "notes": list(self.notes),
        }


def verify(project: Project) -> list[Check]:
    """Hash every file of the current artifacts again, and check that each was made from the current ones.

    The configuration plays no part: `status` compares with that.
    """
    return [_check(project, stage) for stage in project.table.values()]


def _check(project: Project, stage: Stage) -> Check:
    try:
        key = project.store.current_key(stage.artifact)
        entry = project.store.current(stage.artifact)
        if entry is not None:
            entry.check_stage(stage.name)
    except HqpipeError as error:
        return Check(stage.artifact, 0, (_fixed_by(stage, error),), ())
    if entry is None:
        problems = (_fixed_by(stage, project.store.gone(stage.artifact)),) if key else ()
        return Check(stage.artifact, 0, problems, () if key else ("not made",))
    problems, notes = [_fixed_by(stage, error) for error in entry.problems()], []
    for name, source in entry.manifest.sources.items():
        recorded = entry.manifest.recipe.inputs[name]
        needed = next((each for each in stage.inputs if each.name == name), None)
        if needed is None or source["artifact"] not in (None, needed.artifact):
            notes.append(f"made with an input {name} that {stage.name} no longer has")
        elif source["artifact"] is None:
            notes += _outside(needed, source["path"], recorded)
        elif wrong := _chain_problem(project.store, needed, recorded):
            # What runs alone is not made again with the chain; it still tells what it was made from.
            message = f"{entry.shown}: input {name}: {wrong}"
            if stage.alone:
                notes.append(message)
            else:
                problems.append(IntegrityError(message, file=entry.shown, fix=f"run `hqpipe {stage.name}`"))
    return Check(stage.artifact, len(entry.manifest.outputs), tuple(problems), tuple(notes))


def _fixed_by(stage: Stage, error: HqpipeError) -> HqpipeError:
    """The error, with the command that repairs the artifact where it is damage."""
    if isinstance(error, IntegrityError):
        error.fix = f"make it again with `hqpipe {stage.name} --force`"
    return error


def _chain_problem(store: Store, needed: Input, recorded: str) -> str | None:
    """What is wrong with the recorded content of an input that is an artifact."""
    artifact = needed.artifact
    try:
        entry = store.current(artifact)
    except HqpipeError as error:
        return error.message
    if entry is None:
        return f"made from {artifact} {recorded[:SHORT]}…, which is gone"
    content = needed.content(entry.manifest.outputs)
    if content != recorded:
        return f"made from {artifact} {recorded[:SHORT]}…, but the current one is {content[:SHORT]}…"
    return None


def _outside(needed: Input, path: str, recorded: str) -> list[str]:
    """A note if a folder from outside is gone or differs by now; the artifact itself is still good."""
    try:
        content = explicit_source(Path(path), needed).content
    except HqpipeError as error:
        return [f"made from a folder that cannot be checked: {error}"]
    return [] if content == recorded else [f"input {needed.name}: {path} has changed since"]
