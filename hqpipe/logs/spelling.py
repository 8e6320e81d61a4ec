"""Columns under other names than the format's: only used to word an error."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping

CLOSE = 0.75  # assumption: a shorter likeness is another quantity, not a misspelling

CLOCKS = ("t", "timestamp", "time_s", "times", "stamp", "sec", "secs", "seconds", "clock", "time_stamp", "timestamps")

# what other tools call a channel
SYNONYMS = {
    "torque": "effort",
    "tau": "effort",
    "force": "effort",
    "trq": "effort",
    "eff": "effort",
    "efforts": "effort",
    "torques": "effort",
    "measured_torque": "effort",
    "torque_measured": "effort",
    "effort_measured": "effort",
    "measured_effort": "effort",
    "q": "position",
    "pos": "position",
    "angle": "position",
    "positions": "position",
    "qd": "velocity",
    "dq": "velocity",
    "qdot": "velocity",
    "vel": "velocity",
    "speed": "velocity",
    "velocities": "velocity",
    "q_des": "position_command",
    "qdes": "position_command",
    "q_ref": "position_command",
    "target": "position_command",
    "position_target": "position_command",
    "target_position": "position_command",
    "desired_position": "position_command",
    "position_desired": "position_command",
    "position_cmd": "position_command",
    "torque_command": "effort_command",
    "tau_des": "effort_command",
    "tau_cmd": "effort_command",
}
_JOINT = re.compile(r"joints?[/._:\- ]+(.+)", re.IGNORECASE | re.DOTALL)
_SEPARATORS = re.compile(r"[/._:\- ]+")


def near_channel(channel: str, known: Iterable[str], close: float = CLOSE) -> str | None:
    """The channel that another name stands for, of those in `known`; None for something else."""
    folded = _SEPARATORS.sub("_", channel.strip().casefold())
    names = list(known)
    meant = folded if folded in names else SYNONYMS.get(folded)
    if meant:
        return meant if meant in names else None
    found = difflib.get_close_matches(folded, names, 1, close)
    return found[0] if found else None


def joint_and_channel(column: str, joints: Iterable[str], channels: Mapping[str, str]) -> tuple[str, str] | None:
    """What a column like joint.knee.position, Joint/knee/torque or knee_position means; None for something else.

    Args:
        column: its name. joints: that are known from other columns. channels: of the format.
    """
    named = {joint.casefold(): joint for joint in joints}
    match = _JOINT.fullmatch(column)
    rest = match[1] if match else column
    cuts = [found for found in _SEPARATORS.finditer(rest) if 0 < found.start() and found.end() < len(rest)]
    for exact in (True, False):
        for cut in cuts:  # the longest channel first: position_command before command
            joint, channel = rest[: cut.start()], rest[cut.end() :]
            if not match and joint.casefold() not in named:
                continue
            known = near_channel(channel, channels, 1.0 if exact else CLOSE)
            if known:
                return named.get(joint.casefold(), joint), known
    return None


def near_position(columns: Iterable[str]) -> tuple[str, str] | None:
    """Of a table without joints, a column that seems to be a position, and the name that it should have."""
    for column in columns:
        *_, last = cuts = [None, *_SEPARATORS.finditer(column)]
        if len(cuts) > 1 and last.start() > 0 and near_channel(column[last.end() :], ("position",), 1.0):
            return column, f"joint/{column[: last.start()]}/position"
    bare = next((name for name in columns if near_channel(name, ("position",), 1.0)), None)
    return (bare, "joint/<name>/position") if bare else None
