"""A first draft of a mapping file, from the names and values of the fields, with the reason for every line."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from hqpipe.logs.columns import joint_column
from hqpipe.logs.imports import guess_values as values_of
from hqpipe.logs.imports.arrays import listed
from hqpipe.logs.imports.guess_commands import drop_still, resolve_commands, resolve_errors, resolve_velocities
from hqpipe.logs.imports.guess_fields import Draft, NamedField, clocks_of, fields_of
from hqpipe.logs.imports.guess_joints import Joints, drop_bare, drop_incomplete, joints_of_fields
from hqpipe.logs.imports.recording import Recording
from hqpipe.logs.imports.recording_kinds import still_fields
from hqpipe.logs.imports.units import COUNTS, UNITS, kinds_of, to_si

_SLIDING = re.compile(r"stroke|displacement|cylinder|slide|rail|prismatic", re.IGNORECASE)
_MODES = {"position_command": "position", "effort_command": "torque", "valve_command": "valve"}
_ORDER = (
    "position",
    "velocity",
    "effort",
    "position_command",
    "error",
    "effort_command",
    "valve_command",
    "current",
    "duty",
)
_ORDER += ("voltage", "temperature", "pressure_a", "pressure_b")


def draft_map(recording: Recording, still: Collection[tuple[str, str]] | None = None) -> Draft:
    """Draft a mapping for recordings like this one.

    Args:
        still: (stream, field) that hold one value throughout in all of these recordings; None for those of this one.
    """
    draft = Draft()
    fields = fields_of(recording, draft)
    clocks = clocks_of(recording, fields, draft)
    joints = joints_of_fields(fields, draft)
    if not joints:
        draft.unclear.append(f"which fields are positions of joints? no name says so{_measured(recording)}")
    drop_bare(joints, draft)
    drop_still(joints, still_fields(recording) if still is None else still, draft)
    resolve_velocities(joints)
    resolve_errors(joints)
    resolve_commands(joints, clocks, draft)
    drop_incomplete(joints, draft)
    units = _units(joints, clocks, draft)
    _write_joints(joints, units, draft)
    _write_shared(fields, draft)
    _write_head(draft)
    return draft


def _measured(recording: Recording) -> str:
    """Fields that may be positions by the units that the file states."""
    kinds = ("angle", "length")
    names = [n for s in recording.streams for n, unit in s.units.items() if unit in UNITS and UNITS[unit].kind in kinds]
    return f" (in units of angle or length: {listed(names)})" if names else ""


def _units(
    joints: Joints, clocks: Mapping[str, np.ndarray], draft: Draft
) -> dict[str, dict[str, tuple[dict[str, Any], str]]]:
    """Joint → channel → (unit and the like, reason); joints with one habit are judged together."""
    found: dict[str, dict[str, tuple[dict[str, Any], str]]] = {name: {} for name in joints}
    groups: dict[tuple[str, bool], list[str]] = {}
    for name, channels in joints.items():
        parts = channels["position"][0]
        slides = bool(_SLIDING.search(parts.short)) or UNITS.get(parts.unit, UNITS["rad"]).kind == "length"
        groups.setdefault((parts.unit, slides), []).append(name)
    for (_, slides), names in groups.items():
        for channel in (
            "position",
            *(c for c in dict.fromkeys(c for n in names for c in joints[n]) if c != "position"),
        ):
            having = [n for n in names if channel in joints[n]]
            guess = _unit_of([joints[n][channel][0] for n in having], channel, slides, draft)
            for name in having:
                found[name][channel] = guess[0], guess[1] + _own_range(joints[name][channel][0], guess[1], len(having))
                if channel in ("position_command", "error") and not joints[name][channel][0].unit:
                    found[name][channel] = found[name]["position"][0], "as the position"
                if channel == "velocity" and not joints[name][channel][0].unit:
                    found[name][channel] = _velocity(joints[name], found[name]["position"][0], clocks, slides)
                if channel == "valve_command":
                    found[name][channel] = values_of.valve_scaling(joints[name][channel][0].values)
    return found


def _own_range(each: NamedField, reason: str, joints: int) -> str:
    """The range of one of several joints that were judged together, where that is in doubt."""
    if joints == 1 or "CHECK" not in reason:
        return ""
    return f"; this one {np.nanmin(each.values):.4g} … {np.nanmax(each.values):.4g}"


def _unit_of(parts: Sequence[NamedField], channel: str, slides: bool, draft: Draft) -> tuple[dict[str, Any], str]:
    stated = parts[0].unit
    allowed = kinds_of(joint_column("joint", channel)) or kinds_of(joint_column("joint", "position"))
    if stated in UNITS and UNITS[stated].kind in allowed and stated != COUNTS:
        return {"unit": stated}, "the unit is stated"
    if stated and stated not in UNITS:
        draft.unclear.append(f"the unit '{stated}' of '{parts[0].name}' is not known: name one that is, or a scale")
    samples = [part.values for part in parts]
    if channel in ("position", "position_command", "error"):
        if guess := values_of.position_unit(samples, slides):
            return {"unit": guess[0]}, guess[1]
        draft.unclear.append(f"'{parts[0].name}' counts: replace counts_per_turn by that of the encoder")
        return {"unit": COUNTS, "counts_per_turn": 4096}, "CHECK: whole numbers; counts per turn are not in the file"
    if channel.startswith("pressure"):
        guess = values_of.pressure_unit(samples)
        return {"unit": guess[0]}, guess[1]
    if channel == "current":
        guess = values_of.current_unit(samples)
        return {"unit": guess[0]}, guess[1]
    if channel == "duty":
        return values_of.valve_scaling(samples[0])
    usual = {"effort": "N" if slides else "N·m", "effort_command": "N" if slides else "N·m", "voltage": "V"}
    unit = usual.get(channel) or {"temperature": "°C"}.get(channel, "")
    return ({"unit": unit}, "CHECK: no unit is stated, SI is assumed") if unit else ({}, "")


def _velocity(
    channels: Mapping[str, list[NamedField]],
    position: Mapping[str, Any],
    clocks: Mapping[str, np.ndarray],
    slides: bool,
) -> tuple[dict[str, Any], str]:
    """Unit of a velocity, from its slope against the derivative of the position."""
    place, speed = channels["position"][0], channels["velocity"][0]
    unit = UNITS.get(str(position.get("unit")))
    if place.stream is speed.stream and unit and np.isfinite(unit.factor) and place.stream.name in clocks:
        time = clocks[place.stream.name]
        if guess := values_of.velocity_unit(time, to_si(place.values, unit), speed.values):
            return {"unit": guess[0]}, guess[1]
    return {
        "unit": "m/s" if slides else "rad/s"
    }, "CHECK: it does not follow the derivative of the position; SI is assumed"


def _write_joints(
    joints: Joints,
    units: Mapping[str, Mapping[str, tuple[dict[str, Any], str]]],
    draft: Draft,
) -> None:
    content: dict[str, Any] = {}
    for name, channels in joints.items():
        content[name] = {}
        for channel, parts in sorted(channels.items(), key=lambda item: _ORDER.index(item[0])):
            unit, reason = units[name][channel]
            here = ("joints", name, "position_command" if channel == "error" else channel)
            entry = {"field": parts[0].name, **unit}
            if channel == "error":
                place = {"field": channels["position"][0].name, **units[name]["position"][0]}
                sign, reason = values_of.error_sign(channels["position"][0].values, parts[0].values)
                entry = {"sum": [place, entry | ({"sign": -1} if sign < 0 else {})]}
            content[name][here[2]] = entry
            earlier = draft.reasons.get(here)
            draft.reasons[here] = f"{earlier}; {reason}" if earlier else reason
    draft.content["joints"] = content


def _write_shared(fields: list[NamedField], draft: Draft) -> None:
    shared: dict[str, Any] = {}
    for each in fields:
        column = each.meaning.channel
        if "/" not in column:
            continue
        if column in shared:
            draft.left[each.name] = f"a second {column}"
            continue
        unit, reason = each.unit, "the unit is stated"
        if unit not in UNITS or UNITS[unit].kind not in kinds_of(column):
            unit, reason = {"supply/oil_temperature": "°C", "supply/voltage": "V"}.get(column, ""), "SI is assumed"
            if column == "supply/pressure":
                unit, reason = values_of.pressure_unit([each.values])
        shared[column] = {"field": each.name, "unit": unit}
        draft.reasons[("shared", column)] = reason
    if shared:
        draft.content["shared"] = shared


def _write_head(draft: Draft) -> None:
    channels = [channel for entry in draft.content["joints"].values() for channel in entry]
    modes = [mode for channel, mode in _MODES.items() if channel in channels]
    if modes:
        draft.content["control_mode"] = modes[0]
        draft.reasons[("control_mode",)] = f"the joints have {next(c for c, m in _MODES.items() if m == modes[0])}"
    if "effort" not in channels:
        draft.left["(no effort)"] = "no field is named like a torque or force"
