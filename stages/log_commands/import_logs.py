"""``hqpipe logs import``: other programs' logs into a log set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from hqpipe.errors import UsageError
from hqpipe.pipeline.answer import answer
from hqpipe.pipeline.options import Folder, Name, json_option, traceback_option, with_options
from hqpipe.pipeline.progress import stage_progress
from hqpipe.pipeline.streams import stdout_to_stderr

_DRAFT = ".map.yaml"  # ends the name of a draft that stands beside the log set


@with_options(json_option(), traceback_option())
@click.command(name="import")
@click.argument("sources", metavar="SRC...", nargs=-1, required=True, type=Folder())
@click.option("--out", type=Folder(file_okay=False), required=True, help="Folder for the log set; not there yet.")
@click.option(
    "--map",
    "map_file",
    metavar="FILE",
    type=Folder(),
    help="The mapping file; with --guess or --preset, where to write one.",
)
@click.option(
    "--preset", metavar="NAME", type=Name(), help="A mapping for logs of a known form, see docs/how-to/import-logs.md."
)
@click.option("--guess", is_flag=True, help="Draft a mapping file from names and values, and import with it.")
@click.option("--strict", is_flag=True, help="Refuse what would be skipped, dropped or repaired.")
def import_logs(
    sources: tuple[Path, ...],
    out: Path,
    map_file: Path | None,
    preset: str | None,
    guess: bool,
    strict: bool,
    as_json: bool,
) -> None:
    """Make a log set of CSV, NPZ, HDF5, MAT and Parquet files, ROS and MCAP recordings, ULog, MDF and LeRobot.

    SRC are files, or folders whose files are taken (not those of folders inside). A mapping says which field is which channel.
    """
    from hqpipe.logs.imports.import_set import check_free
    from hqpipe.logs.imports.import_set import import_logs as run
    from hqpipe.logs.imports.sources import find_sources
    from hqpipe.stages.output.terminal import show

    check_free(out)
    with stage_progress("logs import") as progress, stdout_to_stderr():
        found = find_sources(sources)
        log_map, text, told = _mapping(found, out, map_file, preset, guess)
        show(*told)
        result = run(found, log_map, text, out, strict=strict, progress=progress)
    if as_json:
        answer(**result.to_json(), draft=told or None, next=f"hqpipe logs check {out}")
    show(*_summary(result))


def _mapping(
    found: Any, out: Path, map_file: Path | None, preset: str | None, guess: bool
) -> tuple[Any, str, list[str]]:
    """The mapping, its text, and what to say of it."""
    from hqpipe.files.documents import LARGEST_YAML, read_text
    from hqpipe.logs.imports.mapping import FIX, read_map
    from hqpipe.logs.imports.recording import ImportLogError

    if guess and preset:
        raise UsageError("--guess and --preset exclude each other", field="--guess", fix="give one of them")
    if not guess and not preset:
        if map_file is None:
            fix = "give --map FILE, or --guess to have a mapping file drafted, or --preset NAME"
            raise UsageError("no mapping says which field is which channel", field="--map", fix=fix)
        return read_map(map_file), read_text(map_file, FIX, LARGEST_YAML, ImportLogError), []
    target = map_file or out.with_name(f"{out.name}{_DRAFT}")
    if target.exists():
        fix = f"import with it: --map {target} without --{'guess' if guess else 'preset'}; or remove it first"
        raise UsageError(f"{target} exists already", file=target, field="--map", fix=fix)
    return _drafted(found, target) if guess else _of_preset(found, target, preset)


def _drafted(found: Any, target: Path) -> tuple[Any, str, list[str]]:
    """Draft a mapping from the most common kind of recording, write it, and read it as a person's."""
    from hqpipe.logs.imports.draft_file import draft_text
    from hqpipe.logs.imports.guess import draft_map
    from hqpipe.logs.imports.mapping import read_map
    from hqpipe.logs.imports.recording import ImportLogError
    from hqpipe.logs.imports.recording_kinds import recording_kinds
    from hqpipe.system.durable import write_file

    first, *others = recording_kinds(found)
    draft = draft_map(first.example, first.still)
    name = first.example.path.name
    text = draft_text(draft, name)
    target.parent.mkdir(parents=True, exist_ok=True)
    write_file(target, text)
    doubtful = sum("CHECK" in reason for reason in draft.reasons.values())
    told = [f"drafted {target} from {name}; {doubtful} lines say CHECK: read it before you trust what follows"]
    told += [f"  {field}: not used, {reason}" for field, reason in draft.left.items()]
    if others:
        told.append(f"  {len(others)} other kinds of header, e.g. {others[0].example.path.name}: not drafted")
    if draft.unclear:
        what = f"{target}: the draft lacks what only a person knows ({'; '.join(draft.unclear)})"
        fix = f"complete it, then import with --map {target}"
        raise ImportLogError(what, file=target, field="--guess", fix=fix)
    return read_map(target), text, told


def _of_preset(found: Any, target: Path, preset: str) -> tuple[Any, str, list[str]]:
    """The mapping that a preset makes for these recordings, written like a drafted one."""
    import yaml

    from hqpipe.logs.imports import PRESETS
    from hqpipe.logs.imports.mapping import read_map
    from hqpipe.logs.imports.recording_kinds import recording_kinds
    from hqpipe.system.durable import write_file

    content = PRESETS[preset]([kind.example for kind in recording_kinds(found)])
    text = f"# Made by --preset {preset}.\n" + yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    target.parent.mkdir(parents=True, exist_ok=True)
    write_file(target, text)
    return read_map(target), text, [f"preset {preset}: mapping written to {target}"]


def _summary(result: Any) -> list[Any]:
    """Tables of channels and trials, and lines on the rest."""
    from rich.table import Table

    channels = Table("channel", "smallest", "largest", "unit", title="Channels, after conversion", title_justify="left")
    for name, (low, high) in result.ranges().items():
        channels.add_row(name, f"{low:.4g}", f"{high:.4g}", result.unit(name))
    columns = ("trial", "split", "seconds", "rows", "Hz", "jitter", "gaps", "missing")
    trials = Table(*columns, title="Trials", title_justify="left")
    for each in result.trials:
        gaps = f"{each.gaps} (to {each.longest_s:.3g} s)" if each.gaps else ""
        missing = str(sum(each.missing.values())) if each.missing else ""
        cells = (
            each.file,
            each.split,
            f"{each.seconds:.1f}",
            str(each.samples),
            f"{each.rate_hz:.4g}",
            f"{each.jitter:.1%}",
        )
        trials.add_row(*cells, gaps, missing)
    lines = [f"note: {_some(files)}: {note}" for note, files in result.notes().items()]
    lines += [f"warning: {text}" for text in result.warnings]
    lines += [f"skipped {len(names)}: {_some(names)}: {reason}" for reason, names in result.skipped.items()]
    seconds = sum(each.seconds for each in result.trials)
    lines.append(
        f"{len(result.trials)} trials, {seconds:.0f} s, in {result.folder}; next: hqpipe logs check {result.folder}"
    )
    return [channels, trials, *lines]


def _some(names: list[str]) -> str:
    """Names on one line, the first of many."""
    return ", ".join(names) if len(names) <= 3 else f"{names[0]} and {len(names) - 1} more"
