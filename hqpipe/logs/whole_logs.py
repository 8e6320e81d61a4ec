"""Reading the files of a log set whole, and repairing what can be repaired."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil, log10
from pathlib import Path

from hqpipe.errors import LogError
from hqpipe.logs.assemble import assemble
from hqpipe.logs.checks import check_clock, check_values
from hqpipe.logs.clocks import SAME_RATE, clock, shared_dt
from hqpipe.logs.columns import TIME, RawTable, check_names
from hqpipe.logs.drive import merged
from hqpipe.logs.manifest import Manifest, TrialEntry
from hqpipe.logs.overlap import Fingerprint, fingerprint
from hqpipe.logs.repair.losses import leave_out, leave_out_far
from hqpipe.logs.repair.one_file import Repaired, Source, look_through, repair
from hqpipe.logs.repair.report import as_recorded, describe
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
    sources, repairs = leave_out(sources, command)
    dt = shared_dt([(s.clock.dt, s.rows) for s in sources.values()], stated_hz)
    if strict:
        check_rates(sources, dt)
    sources, far = leave_out_far(sources, dt)
    repairs += far
    repaired = {file: repair(source, dt) for file, source in sources.items()}
    repairs += describe(sources, repaired, dt)
    stretches = {file: named_stretches(file, sources[file], found) for file, found in repaired.items()}
    if empty := [file for file, found in stretches.items() if not found]:
        repairs.append(Repair("trial", f"{', '.join(empty)}: no stretch without a long gap; left out", tuple(empty)))
        if len(empty) == len(stretches):
            raise _only_gaps(folder / empty[0])
    stretches = {file: found for file, found in stretches.items() if found}
    before = {file: as_recorded(sources[file], found) for file, found in repaired.items()}
    return Logs(_trials(stretches, manifest, all_heldout), prints, repairs, before)


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


def check_rates(sources: Mapping[str, Source], dt: float) -> None:
    """Refuse files of different rates.

    Raises:
        LogError: names the file.
    """
    for source in sources.values():
        if abs(source.clock.dt / dt - 1.0) > SAME_RATE:
            path = source.table.path
            raise LogError(
                f"{path}: runs at {1.0 / source.clock.dt:.6g} Hz, expected {1.0 / dt:.6g} Hz as the other trials",
                file=path,
                field=TIME,
                fix="record all trials at one rate, or make a log set of its own for each rate",
            )


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


def _only_gaps(path: Path) -> LogError:
    what = "no stretch of ten samples without a gap that is too long to be bridged"
    return LogError(f"{path}: {what}", file=path, field=TIME, fix="record it again, or drop the trial")
