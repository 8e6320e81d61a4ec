"""``hqpipe logs export``: a log set as MCAP (ROS 2) or CSV files."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from hqpipe.errors import UsageError
from hqpipe.pipeline.answer import answer
from hqpipe.pipeline.options import Folder, json_option, traceback_option, with_options
from hqpipe.pipeline.progress import stage_progress
from hqpipe.stages.log_commands.chosen import chosen_trials

FORMATS = ("mcap", "csv")
"""Of `hqpipe.logs.export.EXPORTERS`, which is not imported for the help."""


@with_options(json_option(), traceback_option())
@click.command()
@click.argument("folder", metavar="DIR", type=Folder())
@click.option("--out", type=Folder(), required=True, help="Folder for the files, or a file for a single trial.")
@click.option("--format", "kind", type=click.Choice(FORMATS), required=True, help="What to write.")
@click.option("--trial", "files", multiple=True, metavar="FILE", help="Export only this trial; repeatable.")
@click.option("--force", is_flag=True, help="Replace files that are there.")
def export(folder: Path, out: Path, kind: str, files: tuple[str, ...], force: bool, as_json: bool) -> None:
    """Write the log set DIR as files that other tools open, one per trial.

    mcap has ROS 2 messages for Foxglove and PlotJuggler, csv the columns of the log format. Files appear under their names when
    they are complete.
    """
    from hqpipe.logs.export import EXPORTERS
    from hqpipe.logs.export.targets import targets, write_all
    from hqpipe.logs.log_set import read_log_set

    log_set = read_log_set(folder, all_heldout=True)  # whole trials, whatever is to be fitted to them
    trials = chosen_trials(folder, log_set.trials, files)
    paths = targets(out, [trial.file for trial in trials], f".{kind}")
    if any(path.parent.resolve() == folder.resolve() for path in paths):
        what = f"{out} is the log set itself, whose folder holds trials only"
        raise UsageError(what, file=out, field="--out", fix="name another folder")
    write = EXPORTERS[kind]
    with stage_progress("logs export") as progress:

        def write_one(path: Path, index: int) -> None:
            progress(index, len(trials), trials[index].file)
            write(path, log_set, trials[index])

        write_all(out, paths, write_one, force=force)
    if as_json:
        answer(format=kind, files=[str(path) for path in paths])
    else:
        size = sum(path.stat().st_size for path in paths) / 1e6
        print(f"{out}: {len(paths)} {kind} file{'s' if len(paths) > 1 else ''}, {size:.1f} MB", file=sys.stderr)
