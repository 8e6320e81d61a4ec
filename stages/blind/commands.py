"""``hqpipe blind make`` and ``hqpipe blind score``: the diagnosis on data whose effect is withheld."""

from __future__ import annotations

import os
from pathlib import Path

import click

from hqpipe.errors import GateError
from hqpipe.pipeline.answer import answer
from hqpipe.pipeline.options import MAX_SEED, MAX_WORKERS, Folder, json_option, traceback_option, with_options
from hqpipe.pipeline.progress import stage_progress
from hqpipe.pipeline.streams import stdout_to_stderr

_WORKERS = click.option(
    "--workers",
    type=click.IntRange(1, MAX_WORKERS),
    default=lambda: os.cpu_count() or 1,
    show_default="all cores",
    help="Processes; the result does not depend on them.",
)


@click.group()
def blind() -> None:
    """Check the diagnosis on data whose effect is withheld."""


@with_options(json_option(), traceback_option())
@blind.command()
@click.option("--cases", "count", type=click.IntRange(1, 1000), default=300, show_default=True, help="How many.")
@click.option("--seed", type=click.IntRange(0, MAX_SEED), default=1, show_default=True, help="Seed of everything.")
@click.option(
    "--kind",
    "kinds",
    multiple=True,
    metavar="KIND",
    help="Make only this kind: none, single, mixture, place, outside; of the quadruped faint (for the limit of detection), "
    "of servo, arm and cylinder change (recorded twice); repeatable.  [default: all but faint and change]",
)
@click.option(
    "--machine",
    type=click.Choice(["quadruped", "legged", "servo", "arm", "cylinder", "joints"]),
    default="quadruped",
    show_default=True,
    help="What is simulated; legged are three hydraulic robots with other equations than the quadruped's, joints are servos, "
    "arms and cylinders in turn.",
)
@click.option("--out", type=Folder(file_okay=False), required=True, help="Folder for the cases.")
@_WORKERS
def make(count: int, seed: int, kinds: tuple[str, ...], machine: str, out: Path, workers: int, as_json: bool) -> None:
    """Simulate machines with and without effects; the answers lie apart from their logs.

    Complete cases are kept, so that the same command goes on where it was interrupted.
    """
    from hqpipe.stages.blind.make import make as make_cases
    from hqpipe.stages.output.terminal import show

    with stage_progress("blind make") as progress, stdout_to_stderr():
        made = make_cases(count, seed, out, workers, progress, kinds, machine)
    if as_json:
        answer(folder=str(out), cases=count, made=made)
    show(f"{count} cases in {out}, {made} of them made now; next: hqpipe blind score {out}")


@with_options(json_option(), traceback_option())
@blind.command()
@click.argument("folder", metavar="DIR", type=Folder(exists=True, file_okay=False))
@click.option("--without", multiple=True, metavar="EFFECT", help="Leave an effect out of the library; repeatable.")
@_WORKERS
def score(folder: Path, without: tuple[str, ...], workers: int, as_json: bool) -> None:
    """Diagnose the cases of DIR that lack a diagnosis, then open the answers and score.

    Exit 4 when an aim is missed.
    """
    from hqpipe.report.blind_groups import group_tables
    from hqpipe.report.blind_table import score_tables
    from hqpipe.stages.blind.score import missed_aims, score_folder
    from hqpipe.stages.output.terminal import show

    with stage_progress("blind score") as progress, stdout_to_stderr():
        result = score_folder(folder, without, workers, progress)
    if as_json:
        answer(**result)
    show(*group_tables(result), *score_tables(result))
    if missed := missed_aims(result):
        fix = "the page of the score names the cases behind each"
        raise GateError(f"{len(missed)} aims are missed: {'; '.join(missed)}", file=folder, fix=fix)
