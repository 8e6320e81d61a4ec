"""Commands about artifacts and projects that run no stage."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

import click

from hqpipe.errors import HqpipeError, IntegrityError, UsageError
from hqpipe.pipeline.answer import answer
from hqpipe.pipeline.options import Folder, Name, explain_option, json_option, profile_option, with_options
from hqpipe.pipeline.stage import StageTable


@with_options(profile_option(), explain_option(), json_option())
@click.command()
@click.pass_obj
def status(table: StageTable, profile: str | None, explain: bool, as_json: bool) -> None:
    """Compare the artifacts with pipeline.yaml. Exit 3 unless every one of `run all` is current."""
    from hqpipe.pipeline import audit
    from hqpipe.pipeline.plan import Planner
    from hqpipe.pipeline.project import open_project

    project = open_project(table)
    settings = project.configuration.resolve(table.values(), profile=profile, robot=project.robot_folder())
    statuses = audit.status(Planner(project, settings))
    current = all(item.settled for item in statuses)
    if as_json:
        stages = [item.to_json() for item in statuses]
        error = None if current else _not_current(statuses).to_json()
        answer(profile=settings.profile, current=current, stages=stages, error=error)
    else:
        from hqpipe.pipeline.render import print_explanations, print_status

        print_status(statuses)
        if explain:
            print_explanations(statuses)
        _hint_profile(statuses, settings.profile)
    if not current:
        raise click.exceptions.Exit(IntegrityError.exit_code)


def _not_current(statuses: list[Any]) -> IntegrityError:
    """What `status` has to say against the artifacts, for scripts; people read the table."""
    left = [f"{item.decision.stage.artifact} ({item.state})" for item in statuses if not item.settled]
    return IntegrityError(f"not current: {', '.join(left)}", fix="`hqpipe run all` makes what is missing or stale")


def _hint_profile(statuses: list[Any], profile: str) -> None:
    """Artifacts of another profile look stale in this one: say so."""
    stale = [item for item in statuses if item.manifest and item.decision.reasons]
    for other in sorted({item.profile for item in stale} - {profile}):
        print(f"compared with profile '{profile}'; made with '{other}': hqpipe status --profile {other}")


@with_options(json_option())
@click.command()
@click.pass_obj
def dag(table: StageTable, as_json: bool) -> None:
    """Show the stages in order, what each reads and what it writes."""
    if as_json:
        stages = [
            {
                "stage": stage.name,
                "artifact": stage.artifact,
                "version": stage.version,
                "alone": stage.alone,
                "inputs": {needed.name: needed.artifact for needed in stage.inputs if needed.artifact},
            }
            for stage in table.values()
        ]
        answer(stages=stages)
        return
    width = max(len(name) for name in table)
    for stage in table.values():
        reads = ", ".join(needed.artifact for needed in stage.inputs if needed.artifact) or "–"
        print(f"{stage.name:<{width}}  {reads} → {stage.artifact}{' (alone)' if stage.alone else ''}")


@with_options(json_option())
@click.command()
@click.pass_obj
def verify(table: StageTable, as_json: bool) -> None:
    """Hash every byte of the current artifacts again and check the chain between them. Exit 3 on damage."""
    from hqpipe.pipeline import audit
    from hqpipe.pipeline.project import open_project

    project = open_project(table)
    checks = audit.verify(project)
    problems = [problem for check in checks for problem in check.problems]
    if as_json:
        answer(artifacts=[check.to_json() for check in checks])
    else:
        from hqpipe.pipeline.render import print_checks

        print_checks(checks)
    if problems:
        first, lines = problems[0], [str(problem) for problem in problems[:-1]] + [problems[-1].message]
        raise IntegrityError("\n".join(lines), file=first.file, field=first.field, fix=problems[-1].fix)


@with_options(json_option())
@click.command()
@click.argument("a", type=Name())
@click.argument("b", type=Name())
@click.pass_obj
def diff(table: StageTable, a: str, b: str, as_json: bool) -> None:
    """Show what differs from artifact A to B: how they were made, metrics, files and versions.

    A and B are a name under artifacts/, a folder, or the first digits of a key.
    """
    from hqpipe.pipeline.compare import compare
    from hqpipe.pipeline.project import open_project

    store = open_project(table).store
    difference = compare(store.find(a).manifest, store.find(b).manifest)
    if as_json:
        answer(**difference.to_json())
    else:
        print("\n".join(difference.lines()))


@with_options(json_option())
@click.command()
@click.option("--dry-run", is_flag=True, help="List what would go; remove nothing.")
@click.option("--all", "scratch", is_flag=True, help="Also remove what unfinished stages have made so far.")
@click.pass_obj
def gc(table: StageTable, dry_run: bool, scratch: bool, as_json: bool) -> None:
    """Remove results that no current artifact, nor the last run of any profile, was made from."""
    from hqpipe.pipeline import collect_garbage
    from hqpipe.pipeline.lock import exclusive
    from hqpipe.pipeline.project import open_project

    store = open_project(table).store
    if dry_run or not store.folder.exists():
        garbage = collect_garbage.find_garbage(store, table, scratch=scratch)
    else:
        with exclusive(store.folder):
            store.remove_leftovers()
            garbage = collect_garbage.find_garbage(store, table, scratch=scratch)
            collect_garbage.remove(garbage)
    total = sum(item.size for item in garbage)
    if as_json:
        answer(dry_run=dry_run, bytes=total, removed=[str(item.path) for item in garbage])
        return
    for item in garbage:
        print(f"{item.path.name[:12]}  {item.size / 1e6:6.1f} MB  {item.content}")
    print(f"{'would free' if dry_run else 'freed'} {total / 1e6:.1f} MB in {len(garbage)} folders")


@with_options(json_option())
@click.command()
@click.argument("folder", metavar="DIR", type=Folder())
@click.pass_obj
def init(table: StageTable, folder: Path, as_json: bool) -> None:
    """Make DIR a project: write a pipeline.yaml into it."""
    from hqpipe.pipeline.config import FILE

    target = folder / FILE
    if target.exists():
        raise UsageError(f"{target} exists", file=target, fix="remove it first, or choose another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(table.template, target)
    except OSError as error:
        raise UsageError(
            f"cannot write {target}: {error.strerror}", file=target, fix="choose another folder"
        ) from error
    if as_json:
        answer(path=str(target))
    print(f"wrote {target}; next: cd {folder} && hqpipe run all --profile ci", file=sys.stderr)


@with_options(json_option())
@click.command()
@click.pass_obj
def doctor(table: StageTable, as_json: bool) -> None:
    """Check Python, packages, cores, disk and write access. Exit 1 if something is amiss."""
    from hqpipe.pipeline.doctor import examine
    from hqpipe.pipeline.project import find_root, open_project

    try:
        find_root(Path.cwd())
    except UsageError:
        artifacts = Path.cwd() / "artifacts"
    else:
        artifacts = open_project(table).store.folder
    findings = examine(artifacts)
    if as_json:
        answer(checks=[f.to_json() for f in findings])
    else:
        from hqpipe.pipeline.render import print_findings

        print_findings(findings)
    if failed := [finding.name for finding in findings if not finding.ok]:
        raise HqpipeError(f"not ready: {', '.join(failed)}", fix="the line of each check says what to do")
