"""The column names of `hqpipe-log/1` and their units."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hqpipe.errors import LogError

TIME = "time"

# channel of a joint → unit (a revolute joint; metres and newtons for a prismatic one)
CHANNELS = {
    "position": "rad",
    "velocity": "rad/s",
    "effort": "N·m",
    "position_command": "rad",
    "effort_command": "N·m",
    "valve_command": "1",
    "pressure_a": "Pa",
    "pressure_b": "Pa",
}

# what other tools call the same channel: only used to word an error
_SYNONYMS = {
    "torque": "effort",
    "tau": "effort",
    "force": "effort",
    "q": "position",
    "pos": "position",
    "angle": "position",
    "qd": "velocity",
    "dq": "velocity",
    "vel": "velocity",
    "q_des": "position_command",
    "target": "position_command",
    "position_target": "position_command",
    "torque_command": "effort_command",
    "tau_des": "effort_command",
}

SHARED_UNITS = {
    "supply/pressure": "Pa",
    "supply/oil_temperature": "°C",
    **{f"base/position/{a}": "m" for a in "xyz"},
    **{f"base/orientation/{a}": "1" for a in "xyzw"},
    **{f"base/linear_velocity/{a}": "m/s" for a in "xyz"},
    **{f"base/angular_velocity/{a}": "rad/s" for a in "xyz"},
    **{f"imu/linear_acceleration/{a}": "m/s²" for a in "xyz"},
    "command/vx": "m/s",
    "command/vy": "m/s",
    "command/wz": "rad/s",
}

_CLOSE = 0.75  # assumption: a shorter likeness is another quantity, not a misspelling


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
    names = set(table.columns)
    if TIME not in names:
        raise LogError(f"{table.path}: no column 'time'{_near(TIME, names)}; expected seconds since the trial began")
    joints = joints_of(table.columns)
    for name in table.columns:
        parts = name.split("/")
        if parts[0] in ("joint", "joints") and len(parts) != 3 or parts[0] == "joints":
            raise LogError(f"{table.path}: column '{name}': expected joint/<name>/<channel>")
        if len(parts) == 3 and parts[0] == "joint":
            _check_channel(table, name, parts[1], parts[2])
    if not joints:
        shown = ", ".join(sorted(names)[:6])
        raise LogError(f"{table.path}: no column joint/<name>/position; the file has {shown}")
    for joint in joints:
        if joint_column(joint, "position") not in names:
            raise LogError(
                f"{table.path}: no column '{joint_column(joint, 'position')}'; every joint needs its position"
            )
    _check_complete(table, joints)
    _check_shared(table)


def _check_channel(table: RawTable, name: str, joint: str, channel: str) -> None:
    if channel in CHANNELS:
        return
    lacking = [c for c in CHANNELS if joint_column(joint, c) not in table.columns]
    meant = _SYNONYMS.get(channel)
    close = [meant] if meant in lacking else difflib.get_close_matches(channel, lacking, 1, _CLOSE)
    if close:
        raise LogError(
            f"{table.path}: column '{name}' is unknown – did you mean "
            f"'{joint_column(joint, close[0])}'? Rename it, or drop it if it is something else"
        )


def _check_complete(table: RawTable, joints: tuple[str, ...]) -> None:
    for channel in CHANNELS:
        having = [j for j in joints if joint_column(j, channel) in table.columns]
        if having and len(having) < len(joints):
            lacking = next(j for j in joints if j not in having)
            raise LogError(
                f"{table.path}: no column '{joint_column(lacking, channel)}' although joint {having[0]} has "
                f"'{channel}'; record it for every joint, or drop it for all"
            )


def _check_shared(table: RawTable) -> None:
    for name in table.columns:
        if name.split("/")[0] in ("base", "supply", "imu", "command") and name not in SHARED_UNITS:
            absent = [known for known in SHARED_UNITS if known not in table.columns]
            if close := difflib.get_close_matches(name, absent, 1, 0.9):
                raise LogError(f"{table.path}: column '{name}' is unknown – did you mean '{close[0]}'?")


def _near(name: str, known: Iterable[str]) -> str:
    folded = {k.lower(): k for k in known}
    close = difflib.get_close_matches(name, folded, 1, 0.5)
    return f" – did you mean '{folded[close[0]]}'?" if close else ""
