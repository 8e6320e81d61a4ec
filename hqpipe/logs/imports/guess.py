"""A first draft of a mapping file, from the names and values of the fields, with the reason for every line."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hqpipe.logs.columns import CHANNELS as COMPLETE
from hqpipe.logs.columns import joint_column
from hqpipe.logs.imports import guess_values as values_of
from hqpipe.logs.imports.arrays import listed
from hqpipe.logs.imports.guess_fields import Draft, NamedField, clocks_of, fields_of
from hqpipe.logs.imports.recording import Recording
from hqpipe.logs.imports.units import COUNTS, UNITS, kinds_of, to_si

_SLIDING = re.compile(r"stroke|displacement|cylinder|slide|rail|prismatic", re.IGNORECASE)
_MODES = {"position_command": "position", "effort_command": "torque", "valve_command": "valve"}
_ALIKE = (0.5, 2.0)  # slope of a command over what it commands; assumption: beyond it is no target of the position
_GENERIC = ("command", "error")
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
_SEPARATORS = re.compile(r"[^A-Za-z0-9]+")


def draft_map(recording: Recording) -> Draft:
    """Draft a mapping for recordings like this one."""
    draft = Draft()
    fields = fields_of(recording, draft)
    clocks = clocks_of(recording, fields, draft)
    joints = _joints(fields, draft)
    if not joints:
        draft.unclear.append(f"which fields are positions of joints? no name says so{_measured(recording)}")
    _resolve_velocities(joints)
    _resolve_errors(joints)
    _resolve_commands(joints, clocks, draft)
    _drop_incomplete(joints, draft)
    units = _units(joints, clocks, draft)
    _write_joints(joints, units, draft)
    _write_shared(fields, draft)
    _write_head(draft)
    return draft


def _joints(fields: list[NamedField], draft: Draft) -> dict[str, dict[str, list[NamedField]]]:
    """Joint → channel → fields, of joints that have a position."""
    found: dict[str, dict[str, list[NamedField]]] = {}
    for each in fields:
        if each.meaning.channel != "clock" and "/" not in each.meaning.channel:
            found.setdefault(each.meaning.joint, {}).setdefault(each.meaning.channel, []).append(each)
    real = {name: channels for name, channels in found.items() if "position" in channels}
    nameless = found.get("")
    if nameless and len(real) == 1 and "" not in real:  # `u` beside `knee_pos`
        (only,) = real.values()
        for channel, parts in nameless.items():
            only.setdefault(channel, []).extend(parts)
    for name, channels in found.items():
        if name in real or (not name and len(real) == 1):
            continue
        for each in (f for parts in channels.values() for f in parts):
            draft.left[each.name] = f"no position of a joint '{name}'" if name else "which joint is it of?"
    if "" in real:
        if len(real) == 1:
            return {"joint": real[""]}
        real["joint"] = real.pop("")
    return real


def _measured(recording: Recording) -> str:
    """Fields that may be positions by the units that the file states."""
    kinds = ("angle", "length")
    names = [n for s in recording.streams for n, unit in s.units.items() if unit in UNITS and UNITS[unit].kind in kinds]
    return f" (in units of angle or length: {listed(names)})" if names else ""


def _resolve_velocities(joints: dict[str, dict[str, list[NamedField]]]) -> None:
    """Where `qd` and `dq` stand side by side, one of them is a desired position."""
    for channels in joints.values():
        position = channels["position"][0]
        for each in list(channels.get("velocity", ())) if len(channels.get("velocity", ())) > 1 else ():
            slope = _slope(each, position)
            if slope and _ALIKE[0] < slope < _ALIKE[1] and "position_command" not in channels:
                channels["velocity"].remove(each)
                channels["position_command"] = [each]


def _resolve_errors(joints: dict[str, dict[str, list[NamedField]]]) -> None:
    """Keep the error of a joint only where it tells the target."""
    for channels in joints.values():
        errors = channels.pop("error", [])
        if errors and "position_command" not in channels and errors[0].stream is channels["position"][0].stream:
            channels["error"] = errors[:1]


def _slope(first: NamedField, second: NamedField) -> float | None:
    return values_of.slope_of(first.values, second.values) if first.stream is second.stream else None


def _resolve_commands(
    joints: dict[str, dict[str, list[NamedField]]], clocks: Mapping[str, np.ndarray], draft: Draft
) -> None:
    """What plain commands command, and targets that only their errors tell; the same for every joint."""
    kinds: dict[str, dict[str, NamedField]] = {}  # name without the joint → joint → field
    for name, channels in joints.items():
        for each in channels.pop("command", ()):
            kinds.setdefault(_SEPARATORS.sub("", each.short.replace(name, "")).casefold(), {})[name] = each
    whole = {kind: parts for kind, parts in kinds.items() if len(parts) == len(joints)}
    draft.left |= {
        f.name: "not every joint has such a command" for k, p in kinds.items() if k not in whole for f in p.values()
    }
    known = {channel for channels in joints.values() for channel in channels}
    if not known & {"position_command", "error"}:
        targets = [kind for kind, parts in whole.items() if all(_is_target(f, joints[n]) for n, f in parts.items())]
        _take_command("position_command", targets, "it runs with the position", whole, joints, draft)
    if "valve_command" not in known and whole:
        score = {
            k: np.mean([_drive(f, joints[n]["position"][0], clocks) for n, f in p.items()]) for k, p in whole.items()
        }
        best = max(score, key=score.__getitem__)
        names = ", ".join(next(iter(parts.values())).short for parts in whole.values())
        reason = "CHECK: no target of the position, so taken for the valve"
        reason += f"; of {names} it goes best with the velocity" if len(whole) > 1 else ""
        _take_command("valve_command", [best], reason, whole, joints, draft)
    draft.left |= {f.name: "another command is taken" for parts in whole.values() for f in parts.values()}


def _take_command(
    channel: str,
    kinds: list[str],
    reason: str,
    whole: dict[str, dict[str, NamedField]],
    joints: dict[str, dict[str, list[NamedField]]],
    draft: Draft,
) -> None:
    """Make the first of `kinds` that channel of every joint, and drop it from `whole`."""
    for name, each in whole.pop(kinds[0]).items() if kinds else ():
        joints[name][channel] = [each]
        draft.reasons[("joints", name, channel)] = reason


def _is_target(command: NamedField, channels: Mapping[str, list[NamedField]]) -> bool:
    slope = _slope(command, channels["position"][0])
    return slope is not None and _ALIKE[0] < slope < _ALIKE[1]


def _drive(command: NamedField, position: NamedField, clocks: Mapping[str, np.ndarray]) -> float:
    """How well a command goes with the velocity, 0…1."""
    if command.stream is not position.stream or position.stream.name not in clocks:
        return 0.0
    velocity = values_of.derivative(clocks[position.stream.name], position.values)
    present = np.isfinite(velocity) & np.isfinite(command.values)
    if present.sum() < 10 or np.ptp(command.values[present]) == 0 or np.ptp(velocity[present]) == 0:
        return 0.0
    return float(abs(np.corrcoef(command.values[present], velocity[present])[0, 1]))


def _drop_incomplete(joints: dict[str, dict[str, list[NamedField]]], draft: Draft) -> None:
    """Leave out channels that only some joints have, and second fields of one channel."""
    for channel in {c for channels in joints.values() for c in channels}:
        lacking = [name for name, channels in joints.items() if channel not in channels]
        if lacking and (channel in COMPLETE or channel in _GENERIC):
            for channels in joints.values():
                for each in channels.pop(channel, ()):
                    draft.left[each.name] = f"a {channel}, which joint '{lacking[0]}' has not"
    for name, channels in joints.items():
        for channel, parts in channels.items():
            for each in parts[1:]:
                draft.left[each.name] = f"a second {channel} of '{name}' beside '{parts[0].name}'"


def _units(
    joints: dict[str, dict[str, list[NamedField]]], clocks: Mapping[str, np.ndarray], draft: Draft
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
    joints: dict[str, dict[str, list[NamedField]]],
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
