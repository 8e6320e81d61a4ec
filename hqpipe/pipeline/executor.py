"""Carries out decisions: runs stages into temporary folders and commits what they made."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hqpipe.errors import GateError, HqpipeError, IntegrityError, UsageError
from hqpipe.pipeline.context import StageContext
from hqpipe.pipeline.fault import unexpected
from hqpipe.pipeline.hashing import hash_files
from hqpipe.pipeline.manifest import MANIFEST, Manifest, gate_has_form
from hqpipe.pipeline.plan import KEEP, RUN, Decision, Planner
from hqpipe.pipeline.progress import stage_progress
from hqpipe.pipeline.provenance import provenance
from hqpipe.pipeline.stage import Stage
from hqpipe.pipeline.store import Entry
from hqpipe.pipeline.streams import stdout_to_stderr
from hqpipe.pipeline.tasks import Tasks
from hqpipe.system import durable
from hqpipe.system.failures import reported, system_failure
from hqpipe.system.memory import check_address_space

DONE = {"run": "ran", "restore": "restored", "keep": "kept"}


@dataclass(frozen=True)
class Outcome:
    """What happened to one stage.

    Args:
        decision: what was to be done, and why.
        entry: the artifact that is current now.
        wall_time_s: time spent now, not when the artifact was made.
        unreproduced: files that a forced run made differently from the same recipe.
    """

    decision: Decision
    entry: Entry
    wall_time_s: float
    unreproduced: tuple[str, ...] = ()

    @property
    def headline(self) -> str:
        return str(self.entry.manifest.metrics.get("headline", ""))

    def to_json(self) -> dict[str, Any]:
        return {
            **self.decision.to_json(),
            "action": DONE[self.decision.action],
            "key": self.entry.manifest.key,
            "path": str(self.entry.path),
            "wall_time_s": self.wall_time_s,
            "metrics": self.entry.manifest.metrics,
            "unreproduced": list(self.unreproduced),
        }


class Executor:
    """Runs stages of one project one after the other. The caller holds the project's lock.

    Args:
        planner: decides about each stage just before its turn.
        on_decision: called with each decision before it is carried out.
    """

    def __init__(self, planner: Planner, on_decision=lambda decision: None) -> None:
        self.planner = planner
        self.outcomes: list[Outcome] = []
        self._store = planner.project.store
        self._on_decision = on_decision

    def run(self, stages: list[Stage]) -> None:
        """Bring `stages` up to date in order; `outcomes` has what was reached, also after an error.

        Raises:
            HqpipeError: a stage failed (1), an input is missing (2) or changed (3).
            GateError: an artifact missed a threshold (4); it is committed all the same.
        """
        self._store.remove_leftovers()
        for stage in stages:
            sources = {needed.name: self.planner.source(stage, needed) for needed in self.planner.reads(stage)}
            decision = self.planner.decide(stage, sources)
            self._on_decision(decision)
            with reported(self._store.folder):
                outcome = self._carry_out(decision)
            self.outcomes.append(outcome)
            if failures := outcome.entry.manifest.gate_failures:
                shown = self._store.shown(stage.artifact)
                message = f"{stage.name}: {len(failures)} threshold(s) missed: {'; '.join(failures)}"
                fix = f"look at {shown}, then train longer or change the thresholds"
                raise GateError(message, file=shown, fix=fix)

    def _carry_out(self, decision: Decision) -> Outcome:
        started = time.monotonic()
        key = decision.recipe.key
        if decision.action == RUN:
            entry, unreproduced = self._run_stage(decision)
        else:
            entry, unreproduced = self._store.get(key), ()
        if decision.action != KEEP:
            self._store.make_current(decision.stage.artifact, key)
        return Outcome(decision, entry, round(time.monotonic() - started, 3), unreproduced)

    def _run_stage(self, decision: Decision) -> tuple[Entry, tuple[str, ...]]:
        """Run into a temporary folder, commit it, and compare with a replaced result of the same key."""
        key = decision.recipe.key
        scratch = self._store.scratch(key)
        if self.planner.force:
            durable.remove(scratch)
        tasks = self._tasks(decision)
        output = self._store.begin(key)
        try:
            scratch.mkdir(parents=True, exist_ok=True)
            started = time.monotonic()
            metrics = self._call(decision, output, scratch, tasks)
            record = {**provenance(self.planner.project.root), "profile": self.planner.settings.profile}
            if tasks.used:
                record["tasks"] = tasks.used
            manifest = Manifest(
                recipe=decision.recipe,
                sources={name: source.to_json() for name, source in decision.sources.items()},
                outputs=collect_outputs(decision.stage, output),
                metrics=metrics,
                provenance={**record, "wall_time_s": round(time.monotonic() - started, 3)},
            )
            unreproduced = self._changed_files(manifest)
            entry = self._store.commit(output, manifest)
        finally:
            self._store.discard(output)
            remove_if_empty(scratch)
        durable.remove(scratch)
        return entry, unreproduced

    def _tasks(self, decision: Decision) -> Tasks:
        recipe = decision.recipe
        common = {"stage": recipe.stage, "version": recipe.version, "robot": recipe.robot}
        return Tasks(self._store.tasks_folder, common, fresh=self.planner.force)

    def _call(self, decision: Decision, output: Path, scratch: Path, tasks: Tasks) -> dict[str, Any]:
        """Call the stage's function; an unexpected exception becomes one that names stage and place."""
        stage = decision.stage
        settings = self.planner.settings
        check_address_space(self._store.folder)
        run = stage.load_run()
        with stage_progress(stage.name) as progress, stdout_to_stderr():
            context = StageContext(
                params=settings.stages[stage.name].params,
                seed=settings.stages[stage.name].seed,
                workers=settings.workers,
                robot=self.planner.project.robot_folder(),
                inputs={name: source.path for name, source in decision.sources.items()},
                output=output,
                scratch=scratch,
                tasks=tasks,
                progress=progress,
            )
            try:
                metrics = run(context)
            except HqpipeError as error:
                error.message = f"{stage.name}: {error.message}"
                raise
            except Exception as error:
                if failure := system_failure(error, self._store.folder):
                    failure.message = f"{stage.name}: {failure.message}"
                    raise failure from error
                raise unexpected(stage.name, run, error) from error
        return check_metrics(stage, metrics)

    def _changed_files(self, manifest: Manifest) -> tuple[str, ...]:
        """Files that differ from an intact earlier result of the same recipe."""
        try:
            earlier = self._store.get(manifest.key)
        except IntegrityError:
            return ()
        if earlier is None:
            return ()
        old, new = earlier.manifest.outputs, manifest.outputs
        return tuple(sorted(name for name in old.keys() | new.keys() if old.get(name) != new.get(name)))


def collect_outputs(stage: Stage, folder: Path) -> dict[str, str]:
    """Hashes of what a stage wrote.

    Raises:
        HqpipeError: nothing, a file named like the manifest, or something that is no regular file.
    """
    try:
        outputs = hash_files(folder)
    except UsageError as error:
        message = f"{stage.name} made an artifact that cannot be kept: {error.message}"
        raise HqpipeError(message, file=error.file, fix=error.fix) from error
    if not outputs:
        message = f"{stage.name} wrote no file into its output folder"
        raise HqpipeError(message, file=folder, fix="let it write its result into context.output")
    if MANIFEST in outputs:
        message = f"{stage.name} wrote {MANIFEST}, a name that is kept for the artifact's record"
        raise HqpipeError(message, file=folder / MANIFEST, fix="give the file another name")
    return outputs


def check_metrics(stage: Stage, metrics: Any) -> dict[str, Any]:
    """Plain data of what a stage returned: arrays become lists; NaN and inf, which JSON lacks, become null.

    Raises:
        HqpipeError: it is not a mapping, holds something else, or its gate is not of the expected form.
    """
    if not isinstance(metrics, dict):
        raise HqpipeError(f"{stage.name} returned {type(metrics).__name__}, expected a dict of metrics")
    plain = _plain(stage, metrics, "metrics")
    gate = plain.get("gate")
    if gate is not None and not gate_has_form(gate):
        raise HqpipeError(f"{stage.name}: metrics.gate: expected {{passed: bool, failures: list}}, got {gate!r}")
    return plain


def _plain(stage: Stage, value: Any, name: str) -> Any:
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _plain(stage, item, f"{name}.{key}") for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(stage, item, f"{name}[{index}]") for index, item in enumerate(value)]
    if hasattr(value, "tolist"):
        return _plain(stage, value.tolist(), name)
    raise HqpipeError(f"{stage.name}: {name}: expected plain data, got {type(value).__name__}")


def remove_if_empty(folder: Path) -> None:
    """Remove a scratch folder into which nothing was written."""
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
