"""Held-out data that fit trials contain: a copy of a file, a part of one, the same numbers saved in another way.

Positions and measured loads are compared sample by sample, at any distance in time. Commands are not: they may well be the
same in two trials. Names of files, clocks, the order of columns and their encoding make no difference.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs.checks import clock
from hqpipe.logs.columns import TIME, RawTable, joint_column, joints_of
from hqpipe.logs.pieces import PIECE, Pieces, cut, stretch

_LOADS = ("effort", "pressure_a")  # the first one that is recorded
_ROWS = (50, 1000)  # a stretch lasts a second, within these bounds where the clock is slow or counts no seconds
_CHANGES = 100  # of samples in it, all channels of a joint together: a signal that stands still is no evidence
_ENDS = 2 * PIECE  # rows at the two ends of a stretch that whole pieces leave out


@dataclass(frozen=True, eq=False)
class Fingerprint:
    """What is kept of a file to compare it with others.

    Attributes:
        path: the file. channels: column → its pieces. dt: sample time, s.
    """

    path: Path
    channels: Mapping[str, Pieces]
    dt: float


@dataclass(frozen=True)
class Shared:
    """Samples of a held-out trial that a fit trial has too.

    Attributes:
        fit, heldout: the files. columns: alike. first, last: rows of the held-out file.
        whole: everything that was measured at the joint and moves is alike.
    """

    fit: Path
    heldout: Path
    columns: tuple[str, ...]
    first: int
    last: int
    whole: bool


def compared_columns(names: Iterable[str]) -> list[str]:
    """Of the columns of a file those that are compared: position and measured load of every joint."""
    known, found = list(names), []
    for joint in joints_of(known):
        loads = [column for load in _LOADS if (column := joint_column(joint, load)) in known]
        found += [joint_column(joint, "position"), *loads[:1]]
    return found


def fingerprint(table: RawTable) -> Fingerprint:
    """Of a file that has been read; its samples are finite."""
    dt = float(np.median(np.diff(clock(table.columns[TIME]))))
    return Fingerprint(table.path, {name: cut(table.columns[name]) for name in compared_columns(table.columns)}, dt)


def fingerprint_file(readers: Mapping[str, Any], path: Path) -> Fingerprint:
    """Of a file that is too long to be read whole, one column after the other.

    Raises:
        LogError: it cannot be read.
    """
    reader = readers[path.suffix]
    shape = reader.shape(path)
    columns = reader.read_columns(path, compared_columns(shape.names))
    return Fingerprint(path, {name: cut(values) for name, values in columns}, shape.dt)


def check_apart(fit: Sequence[Fingerprint], heldout: Sequence[Fingerprint]) -> list[str]:
    """Refuse held-out trials that repeat a second or more of a fit trial.

    Returns:
        Warnings about joints of which one channel is repeated and another one is not.

    Raises:
        LogError: names both files and the rows.
    """
    suspects = []
    pool = _pool(fit)
    for trial in heldout:
        joints = _joints_in(pool, trial)
        found = [shared for joint in joints for other in fit if (shared := _shared(joint, other, trial))]
        if whole := next((shared for shared in found if shared.whole), None):
            raise _refusal(whole)
        suspects += found[:1]
    return [
        f"{s.heldout.name}: {s.columns[0]} repeats that of {s.fit.name}, a fit trial, bit for bit (rows {s.first} to "
        f"{s.last - 1}) although what else was measured differs: a simulation without noise, or a changed copy, which would "
        "make the held-out error too small"
        for s in suspects
    ]


def _pool(fit: Sequence[Fingerprint]) -> dict[str, np.ndarray]:
    """Column → the pieces of all fit trials: most held-out trials have none of them and need no closer look."""
    names = dict.fromkeys(name for trial in fit for name in trial.channels)
    return {
        name: np.concatenate([trial.channels[name].digest for trial in fit if name in trial.channels]) for name in names
    }


def _joints_in(pool: Mapping[str, np.ndarray], trial: Fingerprint) -> list[str]:
    """Joints of which the pool knows enough samples."""
    found = {}
    for name, pieces in trial.channels.items():
        known = np.isin(pieces.digest, pool.get(name, np.empty(0, np.uint64)))
        if int(np.diff(pieces.start)[known].sum()) >= _rows(trial):
            found[name.split("/")[1]] = None
    return list(found)


def _rows(trial: Fingerprint) -> int:
    """How many rows a stretch must have, less those at its ends."""
    return int(np.clip(1.0 / trial.dt, *_ROWS)) - _ENDS


def _shared(joint: str, fit: Fingerprint, heldout: Fingerprint) -> Shared | None:
    """What two trials share at one joint."""
    alike, differs, changes, rows = [], False, 0, []
    for name, pieces in heldout.channels.items():
        if name.split("/")[1] != joint or name not in fit.channels:
            continue
        first, last, moved = stretch(fit.channels[name], pieces)
        if last - first >= _rows(heldout):
            alike.append(name)
            rows += [first, last]
            changes += moved
        elif int(pieces.changes.sum()) >= _CHANGES // 2:
            differs = True
    if changes < _CHANGES:
        return None
    return Shared(fit.path, heldout.path, tuple(alike), min(rows), max(rows), whole=not differs)


def _refusal(shared: Shared) -> LogError:
    return LogError(
        f"{shared.heldout}: rows {shared.first} to {shared.last - 1} repeat {shared.fit.name} bit for bit "
        f"({' and '.join(shared.columns)}): one is a held-out trial, the other one a fit trial, and no fit may see what "
        "is held out",
        file=shared.heldout,
        field=shared.columns[0],
        fix="give both trials the same split, leave one of them out, or cut the shared rows from one of them",
    )
