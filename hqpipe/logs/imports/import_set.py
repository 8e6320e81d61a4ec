"""Foreign files to a log set: read, convert, split, write."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from hqpipe.errors import LogError, UsageError
from hqpipe.logs.checks import MIN_SAMPLES, check_length
from hqpipe.logs.columns import TIME, RawTable, check_names, joints_of
from hqpipe.logs.drive import merged
from hqpipe.logs.imports.convert import Converted, convert
from hqpipe.logs.imports.joined import join_files
from hqpipe.logs.imports.log_map import LogMap, TrialRule
from hqpipe.logs.imports.mapping import SKIP
from hqpipe.logs.imports.recording import ImportLogError, Recording
from hqpipe.logs.imports.sources import Found, SourceFile
from hqpipe.logs.imports.summary import Import, TrialSummary, outliers, summarise
from hqpipe.logs.joint_kinds import PRISMATIC, REVOLUTE
from hqpipe.logs.manifest import SPLITS
from hqpipe.logs.split import split_rows
from hqpipe.logs.writer import LogSetWriter
from hqpipe.system.durable import move_into_place, new_folder, remove, write_file

MAP = "import-map.yaml"
"""The mapping that a log set was imported with lies in it under this name."""

MOVES = 0.1
"""Of the largest spread of a joint's position over the trials, from which it moves in one; assumption."""
_NAME = re.compile(r"[^A-Za-z0-9._-]+")
_LONGEST_NAME = 100  # characters of a file's name
Progress = Callable[[float, float, str], None]
PerJoint = dict[str, dict[str, float]]


@dataclass(frozen=True, eq=False)
class _Trial:
    """A converted trial that is not written yet."""

    stem: str
    source: str
    rule: TrialRule
    converted: Converted
    drive: PerJoint
    load: PerJoint
    notes: tuple[str, ...]


@dataclass
class _Writing:
    """What was written and skipped so far.

    Attributes:
        last: the latest trial whose split nobody states; it may have to be held out. earlier: those before it, which were
            written to be fitted, without their columns. spreads: joint → spread of its position, of these and of the last one.
    """

    writer: LogSetWriter
    trials: list[TrialSummary] = field(default_factory=list)
    skipped: dict[str, list[str]] = field(default_factory=dict)
    names: set[str] = field(default_factory=set)
    last: _Trial | None = None
    earlier: list[_Trial] = field(default_factory=list)
    spreads: list[dict[str, float]] = field(default_factory=list)

    def skip(self, reason: str, name: str) -> None:
        self.skipped.setdefault(reason, []).append(name)

    def free_name(self, recording: Recording) -> str:
        """A name for the trial's file that no other trial has."""
        stem = recording.path.name if recording.path.is_dir() else recording.path.stem
        parts = [stem, recording.name] if recording.name else [stem]
        return self._free(_NAME.sub("_", "_".join(parts)).strip("._")[:_LONGEST_NAME] or "trial")

    def _free(self, base: str) -> str:
        """A name like this that no trial has."""
        name, count = base, 1
        while name.casefold() in self.names:
            count += 1
            name = f"{base}_{count}"
        self.names.add(name.casefold())
        return name

    def take(self, trial: _Trial) -> None:
        """Write a trial, or the one before it whose split nobody states."""
        check_names(RawTable(Path(trial.source), trial.converted.columns))
        check_length(Path(trial.source), len(trial.converted.columns[TIME]))
        if trial.rule.split:
            self.write(trial, trial.rule.split)
            return
        if self.last:
            self.write(self.last, "fit")
            self.earlier.append(replace(self.last, converted=replace(self.last.converted, columns={})))
        self.last = trial
        self.spreads.append(_spreads(trial.converted.columns))

    def write(self, trial: _Trial, split: str) -> None:
        file = f"{trial.stem}.parquet"
        columns = trial.converted.columns
        self.writer.add(
            file,
            columns,
            split=split,
            command=trial.rule.command,
            base=trial.rule.base,
            drive=trial.drive,
            load=trial.load,
            clock_source=trial.converted.clock_source,
            repairable=True,
        )
        self.trials.append(summarise(file, trial.source, split, columns, trial.notes))

    def finish(self) -> None:
        """Write the last trial: held out where no other one is, and in two parts if it is the only one. Where a joint of the
        others does not move in it, as in recordings of one joint at a time, the last part of every trial is held out."""
        if self.last is None:
            return
        if any(trial.split == "heldout" for trial in self.trials):
            self.write(self.last, "fit")
        elif len(self.earlier) == len(self.trials) and not _all_move_in_the_last(self.spreads):
            for trial in self.earlier:
                whole = self.writer.taken_back(f"{trial.stem}.parquet")
                self._write_cut(replace(trial, converted=replace(trial.converted, columns=whole)))
            self.trials = self.trials[len(self.earlier) :]
            self._write_cut(self.last)
        else:
            self.write(self.last, "heldout")

    def _write_cut(self, trial: _Trial) -> None:
        """Write the two parts of a trial; of several trials one that is too short for it is fitted whole."""
        parts = _cut(trial)
        shortest = min(len(part.converted.columns[TIME]) for part in parts)
        if shortest < MIN_SAMPLES:
            if not self.earlier:
                raise _too_short(trial, shortest)
            self.write(trial, "fit")
            return
        for part, split in zip(parts, SPLITS, strict=True):
            self.write(replace(part, stem=self._free(part.stem)), split)


def _spreads(columns: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Joint → standard deviation of its position."""
    names = {joint: f"joint/{joint}/position" for joint in joints_of(columns)}
    found = {joint: columns[name] for joint, name in names.items() if name in columns}
    return {joint: float(np.nanstd(values)) for joint, values in found.items() if np.isfinite(values).any()}


def _all_move_in_the_last(spreads: Sequence[Mapping[str, float]]) -> bool:
    """Whether the last of several trials shows each joint that moves in one of them; of a lone trial nothing else is left."""
    joints = {joint for each in spreads for joint in each}
    most = {joint: max(each.get(joint, 0.0) for each in spreads) for joint in joints}
    return len(spreads) > 1 and all(spreads[-1].get(joint, 0.0) >= MOVES * most[joint] for joint in joints)


def import_logs(
    found: Found,
    log_map: LogMap,
    map_text: str,
    out: Path,
    *,
    strict: bool = False,
    progress: Progress = lambda *_: None,
) -> Import:
    """Read the files, convert what fits the mapping, and write the log set; `out` appears only when it is complete.

    Args:
        found: the files. log_map: how to read them. map_text: the same as a file, kept in the log set.
        out: a folder that is not there, or empty.
        strict: refuse what would be skipped or dropped.

    Raises:
        UsageError: `out` holds something. ImportLogError: no file fits, or strict and one does not.
    """
    check_free(out)
    if log_map.join:
        found = join_files(found, log_map.join, log_map.path)
    folder = new_folder(out)
    try:
        writing = _Writing(_writer(folder, log_map))
        _skip_found(writing, found, strict)
        _write_trials(writing, found.files, log_map, strict, progress)
        writing.finish()
        if not writing.trials:
            raise _nothing(writing, log_map)
        writing.writer.close()
        write_file(folder / MAP, map_text)
        move_into_place(folder, out)
    except BaseException:
        remove(folder)
        raise
    return Import(out, tuple(writing.trials), writing.skipped, tuple(outliers(writing.trials)), log_map)


def check_free(out: Path) -> None:
    """Refuse a target that holds something.

    Raises:
        UsageError: it does.
    """
    if out.is_symlink() or (out.exists() and (not out.is_dir() or any(out.iterdir()))):
        raise UsageError(f"{out} exists already", file=out, field="--out", fix="name a new folder, or remove it first")


def _skip_found(writing: _Writing, found: Found, strict: bool) -> None:
    """Note what is there and will not be read."""
    left = [(path, f"same bytes as {first.name}") for path, first in found.copies.items()]
    left += [(path, "no reader for this kind of file") for path in found.unknown]
    left += [(path, "a folder inside a folder, which is not looked into") for path in found.folders]
    left += [(path, "not named as join in the mapping says") for path in found.unmatched]
    for path, reason in left:
        if strict:
            fix = "leave it out, name a folder inside as SRC of its own, or import without --strict"
            raise ImportLogError(f"{path}: {reason}", file=path, fix=fix)
        writing.skip(reason, path.name)


def _write_trials(
    writing: _Writing, files: tuple[SourceFile, ...], log_map: LogMap, strict: bool, progress: Progress
) -> None:
    for done, file in enumerate(files):
        progress(done, len(files), file.path.name)
        try:
            recordings = file.reader.read(file.path)
        except LogError as error:
            if strict or (error.fix or "").startswith("pip install"):
                raise
            writing.skip(reason_of(error, file.path), file.path.name)
            continue
        for recording in recordings:
            name = f"{file.path.name}/{recording.name}" if recording.name else file.path.name
            rule = _rule_of(log_map, name)
            if rule.split == SKIP:
                writing.skip("split: skip in the mapping", name)
                continue
            try:
                writing.take(_converted(writing, recording, log_map, rule, name, strict))
            except LogError as error:
                if strict:
                    raise
                writing.skip(reason_of(error, file.path), name)


def _converted(
    writing: _Writing, recording: Recording, log_map: LogMap, rule: TrialRule, name: str, strict: bool
) -> _Trial:
    converted = convert(recording, log_map, strict=strict)
    joints = joints_of(converted.columns)
    stated = {
        key: {joint: values for joint, values in getattr(recording, key).items() if joint in joints}
        for key in ("drive", "load")
    }
    return _Trial(
        writing.free_name(recording),
        name,
        rule,
        converted,
        merged(merged(stated["drive"], log_map.drive), rule.drive),
        merged(merged(stated["load"], log_map.load), rule.load),
        (*recording.notes, *converted.notes),
    )


def _cut(whole: _Trial) -> list[_Trial]:
    """A trial in two parts, with the gap between them that the reader of log sets would leave in a lone one."""
    time = whole.converted.columns[TIME]
    parts = []
    for (start, stop), place in zip(
        split_rows(len(time), float(np.median(np.diff(time)))), ("first", "last"), strict=True
    ):
        columns = {name: values[start:stop] for name, values in whole.converted.columns.items()}
        columns[TIME] = columns[TIME] - columns[TIME][0]
        notes = (*whole.notes, f"the {place} part of a recording")
        converted = replace(whole.converted, columns=columns)
        parts.append(replace(whole, stem=f"{whole.stem}_{place}", converted=converted, notes=notes))
    return parts


def _too_short(lone: _Trial, rows: int) -> ImportLogError:
    return ImportLogError(
        f"{lone.source}: {len(lone.converted.columns[TIME])} rows: the end of a lone recording is held out, and of this one "
        f"that is {rows} rows, expected at least {MIN_SAMPLES}",
        file=Path(lone.source),
        fix="give a longer recording, or a second one",
    )


def _writer(folder: Path, log_map: LogMap) -> LogSetWriter:
    return LogSetWriter(
        folder,
        robot=log_map.robot,
        base=log_map.base,
        control_mode=log_map.control_mode,
        effort_source=log_map.effort_source,
        rate_hz=log_map.rate_hz,
        drive=log_map.drive,
        load=log_map.load,
        kinds=_kinds(log_map),
    )


def _kinds(log_map: LogMap) -> dict[str, str]:
    """Joint → type, where one of them slides; empty where all turn, as a log set without types says."""
    said = {joint: log_map.sliding(joint) for joint in joints_of(log_map.sources)}
    kinds = {joint: PRISMATIC if slides else REVOLUTE for joint, slides in said.items() if slides is not None}
    return kinds if PRISMATIC in kinds.values() else {}


def _rule_of(log_map: LogMap, name: str) -> TrialRule:
    """The first rule that a file, or a recording in it (`file/name`), matches."""
    names = (name, name.partition("/")[0])
    matches = (r for r in log_map.trials if any(fnmatchcase(n, p) for p in r.files for n in names))
    return next(matches, TrialRule(()))


def reason_of(error: LogError, path: Path) -> str:
    """What is wrong, without the file, so that files with the same problem can be told together."""
    text = error.message
    for prefix in (f"{path}: ", f"{path} ", f"{path.name}: "):
        text = text.removeprefix(prefix)
    return text


def _nothing(writing: _Writing, log_map: LogMap) -> ImportLogError:
    reasons = "; ".join(f"{len(names)} × {reason}" for reason, names in list(writing.skipped.items())[:4])
    what = f"{log_map.path}: no file could be imported with it ({reasons or 'no file found'})"
    return ImportLogError(what, file=log_map.path, fix="correct the mapping, or draft one with --guess")
