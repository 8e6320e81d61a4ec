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
from hqpipe.logs.clocks import clock
from hqpipe.logs.columns import TIME, RawTable, joint_column, joints_of
from hqpipe.logs.pieces import PIECE, Pieces, cut, longest_stretch

_LOADS = ("effort", "pressure_a")  # the first one that is recorded; it and the position decide
_OTHERS = ("velocity", "current", "duty")  # they count where they are the same: a filtered copy of one proves nothing
_ROWS = (50, 1000)  # a stretch lasts a second, within these bounds where the clock is slow or counts no seconds
_SAMPLES = 100  # in it that change, all channels of a joint together: what stands still is no evidence
_JOINTS = 3  # at which coarse signals without noise repeat: by chance one joint may, in a machine that repeats well
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
    """Samples of one joint in a held-out trial that a fit trial has too.

    Attributes:
        fit, heldout: the files. columns: alike. first, stop: rows of the held-out file.
        whole: neither position nor load differs. certain: no other recording would share them.
    """

    fit: Path
    heldout: Path
    columns: tuple[str, ...]
    first: int
    stop: int
    whole: bool
    certain: bool


def compared_columns(names: Iterable[str]) -> list[str]:
    """Of the columns of a file those that are compared: what was measured at every joint."""
    known, found = dict.fromkeys(names), []
    for joint in joints_of(known):
        loads = [load for load in _LOADS if joint_column(joint, load) in known]
        found += [joint_column(joint, channel) for channel in ("position", *loads[:1], *_OTHERS)]
    return [name for name in found if name in known]


def fingerprint(table: RawTable) -> Fingerprint:
    """Of a file that has been read; NaN where a sample is missing."""
    dt = float(np.median(np.diff(clock(table.columns[TIME]))))
    names = compared_columns(table.columns)
    return Fingerprint(table.path, {name: _pieces(table.columns[name]) for name in names}, dt)


def fingerprint_file(readers: Mapping[str, Any], path: Path) -> Fingerprint:
    """Of a file that is too long to be read whole, one column after the other.

    Raises:
        LogError: it cannot be read.
    """
    reader = readers[path.suffix]
    shape = reader.shape(path)
    columns = reader.read_columns(path, compared_columns(shape.names))
    return Fingerprint(path, {name: _pieces(values) for name, values in columns}, shape.dt)


def _pieces(values: np.ndarray) -> Pieces:
    """Of a column; a missing sample repeats the one before, so that it tells nothing."""
    if values.dtype.kind != "f" or (present := np.isfinite(values)).all():
        return cut(values)
    last = np.maximum.accumulate(np.where(present, np.arange(len(values)), 0))
    return cut(np.nan_to_num(values[last]))


def check_apart(fit: Sequence[Fingerprint], heldout: Sequence[Fingerprint]) -> list[str]:
    """Refuse held-out trials that repeat a second or more of a fit trial.

    Returns:
        Warnings about joints of which one channel is repeated and another one is not.

    Raises:
        LogError: names both files and the rows.
    """
    pool = _pool(fit)
    alike: dict[tuple[tuple[str, ...], bool], list[Shared]] = {}
    for trial in heldout:
        joints = _joints_in(pool, trial)
        for other in fit:
            found = [shared for joint in joints if (shared := _shared(joint, other, trial))]
            whole = [shared for shared in found if shared.whole]
            if any(shared.certain for shared in whole) or len(whole) >= _JOINTS:
                raise _refusal(whole[0])
            for shared in found[:1]:
                alike.setdefault((shared.columns, shared.whole), []).append(shared)
    return [_warning(each) for each in alike.values()]


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
        if int(pieces.rows[known].sum()) >= _rows(trial):
            found[name.split("/")[1]] = None
    return list(found)


def _rows(trial: Fingerprint) -> int:
    """How many rows a stretch must have, less those at its ends."""
    return int(np.clip(1.0 / trial.dt, *_ROWS)) - _ENDS


def _shared(joint: str, fit: Fingerprint, heldout: Fingerprint) -> Shared | None:
    """What two trials share at one joint; None if it is too little to say anything."""
    alike, whole = {}, True
    for name, pieces in heldout.channels.items():
        _, owner, channel = name.split("/")
        if owner != joint or name not in fit.channels:
            continue
        found = longest_stretch(fit.channels[name], pieces)
        if found.stop - found.first >= _rows(heldout):
            alike[name] = found
        elif channel not in _OTHERS and len(pieces.digest) > 1:
            whole = False
    certain = sum(found.telling for found in alike.values()) >= _SAMPLES
    if not certain and (not whole or sum(found.changes for found in alike.values()) < _SAMPLES):
        return None
    moving = {name: found for name, found in alike.items() if found.changes}
    first, stop = min(found.first for found in moving.values()), max(found.stop for found in moving.values())
    return Shared(fit.path, heldout.path, tuple(moving), first, stop, whole, certain)


def _refusal(shared: Shared) -> LogError:
    return LogError(
        f"{shared.heldout}: {_repeats(shared)}; one is a held-out trial, the other one a fit trial, and no fit may see "
        "what is held out",
        file=shared.heldout,
        field=shared.columns[0],
        fix="give both trials the same split, leave one of them out, or cut the shared rows from one of them",
    )


def _warning(alike: Sequence[Shared]) -> str:
    """On pairs of trials that share the same columns; the first pair stands for the others."""
    shared = alike[0]
    more = f" (and {len(alike) - 1} more pairs of trials)" if len(alike) > 1 else ""
    if shared.whole:
        reason = "a machine that repeats its motion within the resolution of its sensor does so, and a copy does"
    elif all(column.endswith("/effort") for column in shared.columns):
        reason = "although the motion differs: a torque that was sent does so, which is effort_command, and a changed copy does"
    else:
        reason = "although what else was measured differs: a simulation without noise does so, and a changed copy does"
    return f"{shared.heldout.name}: {_repeats(shared)}{more}; {reason}, which would make the held-out error too small"


def _repeats(shared: Shared) -> str:
    columns = " and ".join(shared.columns)
    return f"rows {shared.first} to {shared.stop - 1} repeat {shared.fit.name}, bit for bit in {columns}"
