"""Reading the files of a log set whole, and repairing what can be repaired."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil, log10
from pathlib import Path

from hqpipe.logs.assemble import assemble
from hqpipe.logs.checks import check_clock, check_values
from hqpipe.logs.clocks import clock
from hqpipe.logs.columns import TIME, RawTable, check_names
from hqpipe.logs.drive import merged
from hqpipe.logs.manifest import Manifest, TrialEntry
from hqpipe.logs.overlap import Fingerprint, fingerprint
from hqpipe.logs.repair.all_files import repair_files
from hqpipe.logs.repair.one_file import Repaired, Source, look_through
from hqpipe.logs.split import infer_split
from hqpipe.logs.trajectory import AsRecorded, Excerpt, Repair, Trajectory, Trial


@dataclass(frozen=True, eq=False)
class Logs:
    """The files of a log set, repaired.

    Attributes:
        trials: in the order of the files; of a file that was cut, each stretch is one.
        prints: file → fingerprint of its samples as recorded. repairs: what was done.
        as_recorded: file, or section of one → before its repair.
    """

    trials: list[Trial]
    prints: dict[str, Fingerprint]
    repairs: list[Repair]
    as_recorded: dict[str, AsRecorded]


def read_whole(
    folder: Path,
    readers: Mapping[str, type],
    files: list[str],
    printed: Mapping[str, str],
    manifest: Manifest | None,
    *,
    command: str | None,
    stated_hz: float | None,
    strict: bool,
    all_heldout: bool,
) -> Logs:
    """Read and repair files.

    Args:
        folder, readers, manifest: of the log set. files: in it. printed: those of which fingerprints are taken.
        command: channel of the control mode. stated_hz: nominal rate, or None.
        strict: refuse what would have to be repaired. all_heldout: a lone trial is not split.

    Raises:
        LogError: a file cannot be used.
    """
    sources, prints = {}, {}
    for file in files:
        table = readers[Path(file).suffix].read(folder / file)
        if strict:
            check_as_recorded(table)
        sources[file] = look_through(table)
        if file in printed:
            prints[file] = fingerprint(sources[file].table)
    found = repair_files(sources, command=command, stated_hz=stated_hz, strict=strict)
    stretches = {file: named_stretches(file, found.sources[file], parts) for file, parts in found.repaired.items()}
    return Logs(_trials(stretches, manifest, all_heldout), prints, found.repairs, found.as_recorded)


def _trials(
    stretches: dict[str, list[tuple[str, Trajectory]]], manifest: Manifest | None, all_heldout: bool
) -> list[Trial]:
    if manifest is None and all_heldout:
        return [Trial(name, "heldout", None, t) for parts in stretches.values() for name, t in parts]
    if manifest is None:
        return infer_split(stretches)
    entries = {entry.file: entry for entry in manifest.trials}
    return [trial_of(name, entries[file], manifest, t) for file, parts in stretches.items() for name, t in parts]


def trial_of(name: str, entry: TrialEntry, manifest: Manifest | None, trajectory: Trajectory) -> Trial:
    """A stretch of the file of an entry as a trial called `name`."""
    base, drive, load = (manifest.base, manifest.drive, manifest.load) if manifest else (None, {}, {})
    return Trial(
        name,
        entry.split,
        entry.command,
        trajectory,
        entry.base or base,
        merged(drive, entry.drive),
        merged(load, entry.load),
    )


def check_as_recorded(table: RawTable) -> None:
    """Refuse a file that would have to be repaired.

    Raises:
        LogError: names file, column and row.
    """
    check_names(table)
    check_values(table)
    check_clock(table.path, clock(table.columns[TIME]))


def named_stretches(file: str, source: Source, found: Repaired) -> list[tuple[str, Trajectory]]:
    """Trajectories of the stretches of a file, with where they lie in it."""
    whole = source.clock.seconds
    parts = [(part.start, assemble(part.data.table, part.data.observed)) for part in found.stretches]
    if len(parts) == 1 and parts[0][1].duration > whole - source.clock.dt:
        return [(file, parts[0][1])]
    digits = max(0, ceil(-log10(10.0 * source.clock.dt)))  # ten samples, the shortest stretch
    return [
        (
            f"{file} ({start:.{digits}f}–{start + t.duration:.{digits}f} s)",
            replace(t, excerpt=Excerpt(file, start, whole)),
        )
        for start, t in parts
    ]
