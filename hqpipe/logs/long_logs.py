"""Reading log sets that would not fit into memory: every row is checked, evenly spaced sections are kept.

A section is a `Trial` of its own whose `Trajectory.excerpt` says where in the recorded trial it lies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.logs.columns import Shape, joints_of
from hqpipe.logs.manifest import Manifest, TrialEntry
from hqpipe.logs.overlap import fingerprint_file
from hqpipe.logs.repair.all_files import repair_files
from hqpipe.logs.repair.one_file import Source, look_through
from hqpipe.logs.sections import Rows, rows_within, sections, shares
from hqpipe.logs.size import check_size
from hqpipe.logs.split import split_rows
from hqpipe.logs.trajectory import Excerpt, Trajectory, Trial, recording_of
from hqpipe.logs.whole_logs import Logs, named_stretches, trial_of


@dataclass(frozen=True)
class Part:
    """A recorded trial: the rows of one file, or of the fit or held-out part of a lone one; `dt` in s."""

    entry: TrialEntry
    rows: Rows
    dt: float

    @property
    def count(self) -> int:
        return self.rows[1] - self.rows[0]

    @property
    def seconds(self) -> float:
        return self.count * self.dt


@dataclass(frozen=True)
class Plan:
    """What is read of a log set that holds more than `most` values per channel.

    Attributes:
        parts: recorded trials. kept: per part the rows of its sections, counted from the start of the file.
    """

    parts: tuple[Part, ...]
    kept: tuple[tuple[Rows, ...], ...]


def plan(
    folder: Path, readers: dict[str, Any], manifest: Manifest | None, outlines: Mapping[str, Shape], most: int
) -> Plan | None:
    """Sections of a long log set; None if it holds no more than `most` values per channel, and can be read whole.

    Args:
        folder, readers, manifest: of the log set. outlines: file → its columns and rows. most: samples × joints.

    Raises:
        LogError: a clock cannot be read, or even the clocks do not fit into memory.
    """
    used = list(outlines)
    names = outlines[used[0]].names
    joints = joints_of(names)
    extras = sum(not name.startswith("joint/") for name in names) - 1
    room = rows_within(most, len(joints), extras)
    if sum(shape.rows for shape in outlines.values()) <= room:
        return None
    check_size(folder, outlines.values(), rows_at_a_time=room)
    shapes = {file: readers[Path(file).suffix].shape(folder / file) for file in used}
    entries = list(manifest.trials) if manifest else [TrialEntry(file, "fit") for file in used]
    parts = _parts(entries, shapes, inferred=manifest is None)
    rooms = dict(
        zip(("fit", "heldout"), shares(*(_rows(parts, name) for name in ("fit", "heldout")), room), strict=True)
    )
    kept: dict[int, tuple[Rows, ...]] = {}
    for name, limit in rooms.items():
        mine = [i for i, part in enumerate(parts) if part.entry.split == name]
        if not mine:
            continue
        found = sections([(parts[i].count, parts[i].dt) for i in mine], limit)
        for i, rows in zip(mine, found, strict=True):
            kept[i] = tuple((start + parts[i].rows[0], stop + parts[i].rows[0]) for start, stop in rows)
    return Plan(tuple(parts), tuple(kept[i] for i in range(len(parts))))


def _rows(parts: Sequence[Part], split: str) -> int:
    return sum(part.count for part in parts if part.entry.split == split)


def _parts(entries: list[TrialEntry], shapes: dict[str, Shape], *, inferred: bool) -> list[Part]:
    whole = [Part(entry, (0, shapes[entry.file].rows), shapes[entry.file].dt) for entry in entries]
    if not inferred:
        return whole
    if len(whole) > 1:
        return [*whole[:-1], replace(whole[-1], entry=replace(entries[-1], split="heldout"))]
    shape = shapes[entries[0].file]
    fit, heldout = split_rows(shape.rows, shape.dt)
    return [Part(entries[0], fit, shape.dt), Part(replace(entries[0], split="heldout"), heldout, shape.dt)]


def read_sections(
    folder: Path,
    readers: dict[str, Any],
    the_plan: Plan,
    printed: Mapping[str, str],
    manifest: Manifest | None,
    *,
    command: str | None,
    stated_hz: float | None,
    strict: bool,
) -> Logs:
    """The sections of a plan, in the order of their trials, repaired like files of their own.

    Args:
        folder, readers: of the log set. the_plan: from `plan`. printed: files of which fingerprints are taken.
        manifest: of the log set. command, stated_hz, strict: as in `read_whole`.

    Raises:
        LogError: as `read_whole`.
    """
    places = _read_places(folder, readers, the_plan, strict)
    sources = {name: place.source for name, place in places.items()}
    kept = repair_files(sources, command=command, stated_hz=stated_hz, strict=strict)
    trials = []
    for name, found in kept.repaired.items():
        place = places[name]
        entry = the_plan.parts[place.part].entry
        for own, t in named_stretches(name, kept.sources[name], found):
            excerpt = Excerpt(entry.file, place.start + t.start, place.whole)
            trials.append(trial_of(own, entry, manifest, replace(t, excerpt=excerpt)))
    prints = {file: fingerprint_file(readers, folder / file) for file in printed}
    return Logs(trials, prints, kept.repairs, kept.as_recorded)


@dataclass(frozen=True, eq=False)
class _Place:
    """A section as recorded: index of its part, and s from the start of the part and its length."""

    part: int
    start: float
    whole: float
    source: Source


def _read_places(folder: Path, readers: dict[str, Any], the_plan: Plan, strict: bool) -> dict[str, _Place]:
    """Name → section."""
    found = {}
    for file in dict.fromkeys(part.entry.file for part in the_plan.parts):
        mine = [i for i, part in enumerate(the_plan.parts) if part.entry.file == file]
        ranges = [rows for i in mine for rows in the_plan.kept[i]]
        time, tables = readers[Path(file).suffix].read_rows(folder / file, ranges, strict=strict)
        owners = [i for i in mine for _ in the_plan.kept[i]]
        for i, (start, stop), table in zip(owners, ranges, tables, strict=True):
            rows = the_plan.parts[i].rows
            begin, end = time[rows[0]], time[rows[1] - 1]
            first = float(time[start] - begin)
            name = f"{file} ({first:.0f}–{time[stop - 1] - begin:.0f} s{_part(the_plan, i)})"
            found[name] = _Place(i, first, float(end - begin), look_through(table))
    return found


def _part(the_plan: Plan, index: int) -> str:
    """Names the part of a lone trial that is both fitted and held out."""
    entry = the_plan.parts[index].entry
    alone = sum(part.entry.file == entry.file for part in the_plan.parts) == 1
    return "" if alone else f" of its {'held-out' if entry.split == 'heldout' else 'fit'} part"


def joined(trials: Sequence[Trial]) -> list[Trial]:
    """One trial per recorded one, its sections put end to end on a clock without gaps: for checks that need no order."""
    groups: dict[tuple[str, str], list[Trial]] = {}
    for trial in trials:
        groups.setdefault((recording_of(trial), trial.split), []).append(trial)
    return [replace(group[0], file=file, trajectory=_end_to_end(group)) for (file, _), group in groups.items()]


def _end_to_end(group: list[Trial]) -> Trajectory:
    if len(group) == 1:
        return group[0].trajectory
    first, parts = group[0].trajectory, [trial.trajectory for trial in group]
    offsets = np.concatenate([[0.0], np.cumsum([part.duration + part.dt for part in parts[:-1]])])
    time = np.concatenate([part.time + offset for part, offset in zip(parts, offsets, strict=True)])
    channels = {name: np.concatenate([getattr(part, name) for part in parts]) for name in first.channels()}
    extra = {name: np.concatenate([part.extra[name] for part in parts]) for name in first.extra}
    return replace(first, time=time, extra=extra, observed=None, **channels)


def coverage(the_plan: Plan) -> str:
    """What share of the logs the sections are, as a warning."""
    texts = []
    for split, name in (("fit", "fit"), ("heldout", "held-out")):
        mine = [i for i, part in enumerate(the_plan.parts) if part.entry.split == split]
        ranges = [rows for i in mine for rows in the_plan.kept[i]]
        total = sum(the_plan.parts[i].seconds for i in mine)
        used = sum((stop - start) * the_plan.parts[i].dt for i in mine for start, stop in the_plan.kept[i])
        if mine:
            texts.append(
                f"{used:.0f} s of {total:.0f} s of {name} trials ({used / total:.0%}, {len(ranges)} evenly spaced "
                f"section{'s' if len(ranges) != 1 else ''})"
            )
    return (
        f"too long for memory: {' and '.join(texts)} were used; the time of every row was checked, everything else was judged "
        "on the sections"
    )
