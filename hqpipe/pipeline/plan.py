"""What each stage needs: to run, to be restored from the store, or nothing."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hqpipe.errors import IntegrityError, UsageError
from hqpipe.pipeline.config import Settings
from hqpipe.pipeline.hashing import hash_files
from hqpipe.pipeline.manifest import Recipe, is_artifact
from hqpipe.pipeline.project import Project
from hqpipe.pipeline.reasons import Reason, differences
from hqpipe.pipeline.stage import Input, Stage
from hqpipe.pipeline.store import read_entry

RUN, RESTORE, KEEP = "run", "restore", "keep"


@dataclass(frozen=True)
class Source:
    """A folder that a stage reads, verified or hashed.

    Args:
        path: the folder.
        content: hash over the files in it that are read.
        artifact: name under ``artifacts/``, None for a folder from outside.
        key: key of the result in it, None if it is no artifact.
    """

    path: Path
    content: str
    artifact: str | None
    key: str | None

    def to_json(self) -> dict[str, str | None]:
        """As recorded in the manifest; a place in the store is told by its key alone."""
        return {"artifact": self.artifact, "key": self.key, "path": None if self.artifact else str(self.path)}


@dataclass(frozen=True)
class Decision:
    """What is to be done about one stage.

    Args:
        stage: the stage.
        action: ``run``, ``restore`` (an earlier result has the wanted key) or ``keep``.
        reasons: why; empty for ``keep``.
        recipe: what is wanted; None while an input is still to be made.
        sources: input name → the folder; an input that is still to be made is absent.
    """

    stage: Stage
    action: str
    reasons: tuple[Reason, ...]
    recipe: Recipe | None
    sources: Mapping[str, Source]

    @property
    def why(self) -> str:
        """The reasons in one line."""
        if self.action == KEEP:
            return "nothing changed"
        return ", ".join(reason.text for reason in self.reasons)

    def to_json(self) -> dict[str, Any]:
        return {
            "stage": self.stage.name,
            "action": self.action,
            "reasons": [reason.to_json() for reason in self.reasons],
            "key": self.recipe.key if self.recipe else None,
        }


class Planner:
    """Decides about stages of one project with one set of settings.

    Args:
        project: the project.
        settings: resolved settings of at least the stages that will be asked about.
        force: run even what is up to date.
        explicit: input name → folder given on the command line instead of an artifact.
    """

    def __init__(
        self,
        project: Project,
        settings: Settings,
        *,
        force: bool = False,
        explicit: Mapping[str, Path] | None = None,
    ) -> None:
        self.project = project
        self.settings = settings
        self.force = force
        self.explicit = dict(explicit or {})
        self.robot_hash = project.robot_hash()

    def source(self, stage: Stage, needed: Input) -> Source:
        """The folder that `stage` reads as `needed`, with every byte of it hashed.

        Raises:
            UsageError: it does not exist.
            IntegrityError: it is an artifact and a file in it was changed.
        """
        if needed.name in self.explicit:
            return explicit_source(self.explicit[needed.name], needed)
        maker = self.project.table.maker(needed.artifact)
        with _fixed_by(f"make it again with `{self._command(maker)} --force`"):
            entry = self.project.store.current(needed.artifact)
            if entry is not None:
                entry.check_stage(maker.name)
                entry.verify()
                return Source(entry.path, needed.content(entry.manifest.outputs), needed.artifact, entry.manifest.key)
        shown = self.project.store.shown(needed.artifact)
        raise UsageError(
            f"{stage.name} needs {shown}, which has not been made",
            file=shown,
            fix=f"run `{self._command(maker)}` or give a folder with {needed.option}",
        )

    def reads(self, stage: Stage, made: Collection[str] = ()) -> list[Input]:
        """The inputs of a stage, less the optional ones that it does without.

        Args:
            made: artifacts that will be made before.
        """

        def wanted(needed: Input) -> bool:
            if needed.artifact is None or needed.name in self.explicit:
                return needed.name in self.explicit
            if not needed.optional:
                return True
            there = needed.artifact in made or self.project.store.current(needed.artifact) is not None
            return there and not self.explicit

        return [needed for needed in stage.inputs if wanted(needed)]

    def decide(self, stage: Stage, sources: Mapping[str, Source], made: Collection[str] = ()) -> Decision:
        """What to do about `stage` when it reads `sources`.

        An input that is absent from `sources` is taken as still to be made (`made` names artifacts that will be). A
        result that would be kept or restored is verified byte by byte.

        Raises:
            IntegrityError: that result was changed; `force` runs the stage instead.
            UsageError: something that is no artifact stands in the artifact's place.
        """
        pending = [needed.name for needed in self.reads(stage, made) if needed.name not in sources]
        recipe = self.recipe(stage, sources)
        if self.force:
            self.project.store.check_link(stage.artifact)
            reasons = (Reason("forced", "forced"),)
            return Decision(stage, RUN, reasons, None if pending else recipe, sources)
        with _fixed_by(f"make it again with `{self._command(stage)} --force`"):
            return self._compare(stage, sources, pending, recipe)

    def _compare(self, stage: Stage, sources: Mapping[str, Source], pending: list[str], recipe: Recipe) -> Decision:
        """Compare the wanted recipe, in which the `pending` inputs are absent, with what there is."""
        current = self.project.store.current(stage.artifact)
        reasons = [Reason("upstream", name) for name in pending]
        if current is None:
            reasons.insert(0, Reason("missing", stage.artifact))
        else:
            current.check_stage(stage.name)
            made = current.manifest.recipe.inputs
            known = {**recipe.inputs, **{name: made[name] for name in pending if name in made}}
            reasons += differences(current.manifest, replace(recipe, inputs=known))
        if pending:
            return Decision(stage, RUN, tuple(reasons), None, sources)
        stored = self.project.store.get(recipe.key)
        if stored is None:
            return Decision(stage, RUN, tuple(reasons), recipe, sources)
        if current is not None and current.manifest.key == recipe.key:
            current.verify()
            return Decision(stage, KEEP, (), recipe, sources)
        stored.verify()
        return Decision(stage, RESTORE, tuple(reasons), recipe, sources)

    def _command(self, stage: Stage) -> str:
        """What to type to run `stage` in the profile of these settings."""
        profile = self.settings.profile
        default = self.project.configuration.file.profile
        return f"hqpipe {stage.name}" + ("" if profile == default else f" --profile {profile}")

    def recipe(self, stage: Stage, sources: Mapping[str, Source]) -> Recipe:
        """What decides the content of the stage's artifact."""
        settings = self.settings.stages[stage.name]
        return Recipe(
            stage=stage.name,
            version=stage.version,
            params=settings.params.model_dump(mode="json"),
            seed=settings.seed,
            inputs={name: source.content for name, source in sources.items()},
            robot=self.robot_hash,
        )

    def preview(self, stages: list[Stage], *, report_damage: bool = False) -> list[Decision]:
        """Decide about a chain without changing anything; what will run makes its readers run.

        Args:
            stages: in the order of the table.
            report_damage: give a damaged artifact the reason ``damaged`` instead of raising.

        Raises:
            UsageError: a stage before the first one would be needed and has no artifact.
            IntegrityError: as in `decide`.
        """
        decisions: dict[str, Decision] = {}
        for stage in stages:
            try:
                decisions[stage.artifact] = self.decide(stage, self._previewed_sources(stage, decisions), decisions)
            except IntegrityError as error:
                if not report_damage:
                    raise
                reasons = (Reason("damaged", str(error)),)
                decisions[stage.artifact] = Decision(stage, RUN, reasons, None, {})
        return list(decisions.values())

    def _previewed_sources(self, stage: Stage, decisions: Mapping[str, Decision]) -> dict[str, Source]:
        """The sources of `stage` that exist once `decisions` are carried out, except what has yet to run."""
        sources = {}
        for needed in self.reads(stage, decisions):
            upstream = decisions.get(needed.artifact)
            if upstream is None or needed.name in self.explicit:
                sources[needed.name] = self.source(stage, needed)
            elif upstream.recipe is not None and upstream.action != RUN:
                entry = self.project.store.get(upstream.recipe.key)
                if entry is None:  # another process has removed it since
                    raise self.project.store.gone(needed.artifact)
                key = entry.manifest.key
                content = needed.content(entry.manifest.outputs)
                sources[needed.name] = Source(entry.path, content, needed.artifact, key)
        return sources


def explicit_source(path: Path, needed: Input) -> Source:
    """A folder that the user named: verified if it is an artifact, hashed otherwise.

    Raises:
        UsageError: there is no such folder, or it is empty.
        IntegrityError: it is an artifact and was changed.
    """
    folder, option = path.resolve(), needed.option
    if not folder.is_dir():
        what = "is a file, expected its folder" if folder.is_file() else "no such folder"
        raise UsageError(f"{option} {path}: {what}", file=path, field=option, fix="give the folder with the files")
    if is_artifact(folder):
        with _fixed_by(f"make it again, or give another folder with {option}"):
            entry = read_entry(folder)
            entry.verify()
        return Source(folder, needed.content(entry.manifest.outputs), None, entry.manifest.key)
    if not any(folder.iterdir()):
        fix = "give the folder with the files"
        raise UsageError(f"{option} {path}: the folder is empty", file=path, field=option, fix=fix)
    return Source(folder, needed.content(hash_files(folder, links=True)), None, None)


@contextmanager
def _fixed_by(fix: str) -> Iterator[None]:
    """Let an IntegrityError that is raised inside name the command that repairs it."""
    try:
        yield
    except IntegrityError as error:
        error.fix = fix
        raise
