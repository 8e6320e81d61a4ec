"""The column names of `hqpipe-log/1` and their units."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs.spelling import CLOCKS, joint_and_channel, near_channel, near_position

TIME = "time"

# channel of a joint → unit (a revolute joint; metres and newtons for a prismatic one)
CHANNELS = {
    "position": "rad",
    "velocity": "rad/s",
    "effort": "N·m",
    "position_command": "rad",
    "effort_command": "N·m",
    "valve_command": "1",
    "current": "A",
    "duty": "1",
    "pressure_a": "Pa",
    "pressure_b": "Pa",
}

COMMAND_CHANNEL = {"position": "position_command", "torque": "effort_command", "valve": "valve_command"}
"""Control mode → channel that is commanded."""

PARTIAL = ("current", "duty")
"""Channels that some joints may have and others not, as drives of different makes do; such a column is kept as it is."""

SHARED_UNITS = {
    "supply/pressure": "Pa",
    "supply/oil_temperature": "°C",
    "supply/voltage": "V",
    **{f"base/position/{a}": "m" for a in "xyz"},
    **{f"base/orientation/{a}": "1" for a in "xyzw"},
    **{f"base/linear_velocity/{a}": "m/s" for a in "xyz"},
    **{f"base/angular_velocity/{a}": "rad/s" for a in "xyz"},
    **{f"imu/linear_acceleration/{a}": "m/s²" for a in "xyz"},
    "command/vx": "m/s",
    "command/vy": "m/s",
    "command/wz": "rad/s",
}

MOST_JOINTS = 512  # assumption: ten times a humanoid with hands; every joint is compared with every other one
_LONGEST = 100  # characters of the name of a joint, which stands in messages, tables and figures
_LONGEST_COLUMN = 300  # characters, for the same reason


@dataclass(frozen=True)
class RawTable:
    """What a reader returns: columns as stored, not yet checked.

    Attributes:
        path: the file, for messages.
        columns: name → (T,) numeric array.
        metadata: the file's own text metadata.
    """

    path: Path
    columns: Mapping[str, np.ndarray]
    metadata: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Shape:
    """What a reader says of a file before it reads it.

    Attributes:
        path: the file. names: its columns, in order. rows: their length.
        dt: median sample time, s; NaN where the clock does not tell, or was not read.
    """

    path: Path
    names: tuple[str, ...]
    rows: int
    dt: float

    def empty(self) -> RawTable:
        """A table with these columns and no rows."""
        return RawTable(self.path, {name: np.empty(0) for name in self.names})


def joint_column(joint: str, channel: str) -> str:
    return f"joint/{joint}/{channel}"


def unit_of(column: str) -> str:
    """Unit of a column of the format, or "" for one that the format does not know."""
    parts = column.split("/")
    if column == TIME:
        return "s"
    if len(parts) == 3 and parts[0] == "joint":
        return CHANNELS.get(parts[2], "")
    if len(parts) == 4 and parts[0] == "foot" and parts[2] == "force":
        return "N"
    return SHARED_UNITS.get(column, "1" if column.endswith("/contact") else "")


def joints_of(columns: Iterable[str]) -> tuple[str, ...]:
    """Joint names in the order of their first column."""
    parts = (name.split("/") for name in columns)
    return tuple(dict.fromkeys(p[1] for p in parts if len(p) == 3 and p[0] == "joint"))


def order_columns(columns: Iterable[str], joints: Iterable[str]) -> list[str]:
    """The canonical order: time, the channels of each joint, then the rest by name."""
    names = set(columns)
    known = [TIME, *(joint_column(j, c) for j in joints for c in CHANNELS)]
    first = [name for name in known if name in names]
    return first + sorted(names - set(first))


def check_names(table: RawTable) -> None:
    """Refuse a table whose columns are missing or misspelt.

    Raises:
        LogError: names the file, the column and the near match.
    """
    if TIME not in table.columns:
        near = _near_time(table.columns)
        fix = f"rename column '{near}' to 'time'" if near else "add it"
        hint = f" – did you mean '{near}'?" if near else ""
        what = f"no column 'time'{hint}; expected seconds since the trial began"
        raise _wrong(table, TIME, what, fix)
    joints = joints_of(table.columns)
    for name in table.columns:
        _check_column(table, name, joints)
    if not joints:
        near = near_position(table.columns)
        fix = (
            f"rename column {_quoted(near[0])} to '{near[1]}'" if near else "name the columns of every joint like that"
        )
        more = f" and {len(table.columns) - 6} more" if len(table.columns) > 6 else ""
        found = ", ".join(name[:_LONGEST] for name in sorted(table.columns)[:6]) + more
        what = f"no column joint/<name>/position; the file has {found}"
        raise _wrong(table, joint_column("<name>", "position"), what, fix)
    if len(joints) > MOST_JOINTS:
        what = f"{len(joints)} joints, expected at most {MOST_JOINTS}"
        raise _wrong(table, "joint", what, "leave out the joints that are not to be identified")
    for position in (joint_column(joint, "position") for joint in joints):
        if position not in table.columns:
            what = f"no column '{position}'; every joint needs its position"
            raise _wrong(table, position, what, "record it, or drop the columns of the joint")
    _check_complete(table, joints)
    _check_shared(table)


def _check_column(table: RawTable, name: str, joints: tuple[str, ...]) -> None:
    """Refuse a column that means a channel of a joint which is not there under its right name."""
    parts = name.split("/")
    if (len(name) > _LONGEST_COLUMN or not name.isprintable()) and parts[0] != "joint":
        what = f"the name of column {_quoted(name)} is longer than {_LONGEST_COLUMN} characters, or cannot be printed"
        raise _wrong(table, name, what, "rename or drop it")
    if len(parts) == 3 and parts[0] == "joint":
        _check_joint_name(table, parts[1])
        lacking = [c for c in CHANNELS if joint_column(parts[1], c) not in table.columns]
        if parts[2] not in CHANNELS and (meant := near_channel(parts[2], lacking)):
            raise _misspelt(table, name, joint_column(parts[1], meant), "or drop it if it is something else")
        return
    meant = joint_and_channel(name, joints, CHANNELS)
    if meant and (right := joint_column(*meant)) not in table.columns:
        raise _misspelt(table, name, right, "or drop it if it is something else")
    if parts[0] in ("joint", "joints"):
        what = f"column {_quoted(name)}: expected joint/<name>/<channel>"
        raise _wrong(table, name, what, f"rename it, with a channel of {', '.join(CHANNELS)}, or drop it")


def _check_joint_name(table: RawTable, joint: str) -> None:
    """Refuse a name that cannot be shown."""
    reason = None
    if not joint or joint != joint.strip():
        reason = "is empty, or begins or ends with a space"
    elif len(joint) > _LONGEST:
        reason = f"has {len(joint)} characters, expected at most {_LONGEST}"
    elif not joint.isprintable():
        reason = "holds characters that cannot be printed, such as a line break"
    if reason:
        raise _wrong(table, "joint", f"the joint name {_quoted(joint)} {reason}", "rename the columns of the joint")


def _check_complete(table: RawTable, joints: tuple[str, ...]) -> None:
    for channel in (name for name in CHANNELS if name not in PARTIAL):
        having = [j for j in joints if joint_column(j, channel) in table.columns]
        if having and len(having) < len(joints):
            lacking = joint_column(next(j for j in joints if j not in having), channel)
            what = f"no column '{lacking}' although joint {having[0]} has '{channel}'"
            raise _wrong(table, lacking, what, "record it for every joint, or drop it for all")


def _check_shared(table: RawTable) -> None:
    for name in table.columns:
        if name.split("/")[0] in ("base", "supply", "imu", "command") and name not in SHARED_UNITS:
            absent = [known for known in SHARED_UNITS if known not in table.columns]
            if close := difflib.get_close_matches(name, absent, 1, 0.9):
                raise _misspelt(table, name, close[0], "or drop it if it is something else")


def _near_time(names: Iterable[str]) -> str | None:
    """A column that seems to be the clock."""
    folded = {name.strip().casefold(): name for name in names}
    known = next((name for name in (TIME, *CLOCKS) if name in folded), None)
    close = [known] if known else difflib.get_close_matches(TIME, folded, 1, 0.6)
    return folded[close[0]] if close else None


def _misspelt(table: RawTable, name: str, right: str, otherwise: str) -> LogError:
    what = f"column {_quoted(name)} is unknown (did you mean '{right}'?)"
    return _wrong(table, name, what, f"rename column {_quoted(name)} to '{right}', {otherwise}")


def _quoted(name: str) -> str:
    """A name in quotes on one line, its beginning if it is long."""
    return repr(name if len(name) <= _LONGEST else name[: _LONGEST - 1] + "…")


def _wrong(table: RawTable, column: str, what: str, fix: str) -> LogError:
    return LogError(f"{table.path}: {what}", file=table.path, field=column, fix=fix)
