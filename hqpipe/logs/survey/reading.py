"""Reading a log set to look at it: where the whole is refused, each file on its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from hqpipe.errors import LogError
from hqpipe.logs import LOG_READERS
from hqpipe.logs.columns import check_names
from hqpipe.logs.findings import Finding, groups_of
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.manifest import FILE, Manifest, read_manifest
from hqpipe.logs.repair.one_file import look_through, repair
from hqpipe.logs.repair.report import as_recorded
from hqpipe.logs.size import check_size
from hqpipe.logs.trajectory import AsRecorded, LogSet, Trial
from hqpipe.logs.units import unit_findings
from hqpipe.logs.whole_logs import named_stretches
from hqpipe.logs.wiring import wiring_findings

MOST = 4_000_000  # samples × joints; half an hour of two joints or 6 minutes of twelve at 1 kHz, read in seconds


@dataclass(frozen=True, eq=False)
class Reading:
    """What could be read of a folder.

    Attributes:
        folder: as given. log_set: None where the set is refused. trials: every one that can be read.
        control_mode: as stated or inferred; None where neither can be done.
        warnings: of the set; none where it is refused. looks: what looks wrong in single trials.
        refused: why the set cannot be used as it is. errors: file → why it cannot be read.
        as_recorded: file, or section that was read of it → before its repair.
    """

    folder: Path
    log_set: LogSet | None
    trials: tuple[Trial, ...]
    control_mode: str | None
    warnings: tuple[str, ...] = ()
    looks: tuple[Finding, ...] = ()
    refused: LogError | None = None
    errors: dict[str, LogError] = field(default_factory=dict)
    as_recorded: Mapping[str, AsRecorded] = field(default_factory=dict)


def read(folder: Path, most: int = MOST) -> Reading:
    """Read a log set, or whatever can be read of it.

    Args:
        folder: of the log set. most: samples × joints to keep, see `read_log_set`.

    Raises:
        LogError: there is no file to look at.
    """
    try:
        log_set = read_log_set(folder, most=most)
    except LogError as error:
        return _one_by_one(folder, error)
    told = {group.text for group in groups_of(log_set.findings)}
    rest = tuple(text for text in log_set.warnings if text.partition(": ")[2] not in told)
    return Reading(
        folder,
        log_set,
        log_set.trials,
        log_set.control_mode,
        rest,
        log_set.findings,
        as_recorded=log_set.as_recorded,
    )


def _one_by_one(folder: Path, refused: LogError) -> Reading:
    manifest = _manifest(folder)
    files = [entry.file for entry in manifest.trials] if manifest else _present(folder)
    if not files:
        raise refused
    splits = {entry.file: entry.split for entry in manifest.trials} if manifest else {}
    trials, before, errors = [], {}, {}
    for file in files:
        try:
            found, before[file] = _trials(folder, file, splits.get(file, ""))
            trials += found
        except LogError as error:
            errors[file] = error
    rate = manifest.rate_hz if manifest else None
    looks = [each for trial in trials for each in unit_findings(trial.file, trial.trajectory, rate)]
    if len({(t.trajectory.joints, tuple(t.trajectory.channels())) for t in trials}) == 1:
        looks += wiring_findings(trials)
    mode = manifest.control_mode if manifest else None
    return Reading(folder, None, tuple(trials), mode, (), tuple(looks), refused, errors, before)


def _manifest(folder: Path) -> Manifest | None:
    try:
        return read_manifest(folder / FILE, [], needs_fit=False)
    except LogError:  # or the file is absent; the error of the whole set says what is wrong with it
        return None


def _present(folder: Path) -> list[str]:
    """Files that look like trials; none in a folder that cannot be listed."""
    try:
        return sorted(path.name for path in folder.iterdir() if path.suffix in _readers())
    except OSError:
        return []


def _readers() -> dict[str, type]:
    return {suffix: reader for reader in LOG_READERS.values() for suffix in reader.suffixes}


def _trials(folder: Path, file: str, split: str) -> tuple[list[Trial], AsRecorded]:
    """The stretches of a file, on its own clock."""
    readers, path = _readers(), folder / file
    reader = readers.get(path.suffix)
    if reader is None:
        what = f"{path}: no reader for '{path.suffix}' (known: {', '.join(readers)})"
        raise LogError(what, file=path, fix=f"convert it to {next(iter(readers))}")
    check_size(folder, [reader.outline(path)])
    table = reader.read(path)
    check_names(table)
    source = look_through(table)
    found = repair(source, source.clock.dt)
    return [Trial(name, split, None, t) for name, t in named_stretches(file, source, found)], as_recorded(source, found)
