"""Which command of a joint is which, from the values beside its name."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

import numpy as np

from hqpipe.logs.imports import guess_values as values_of
from hqpipe.logs.imports.guess_fields import Draft, NamedField
from hqpipe.logs.imports.guess_joints import Joints

_ALIKE = (0.5, 2.0)  # slope of a command over what it commands; assumption: beyond it is no target of the position
_COMMANDS = ("position_command", "effort_command", "valve_command", "command")
_SEPARATORS = re.compile(r"[^A-Za-z0-9]+")
_NUMBERED = re.compile(r"joint(\d+)")


def drop_still(joints: Joints, still: Collection[tuple[str, str]], draft: Draft) -> None:
    """Leave out commands that never change in any joint: what nobody commanded with says nothing of the control mode.

    Args:
        still: (stream, field) that hold one value throughout, in every recording.
    """
    kinds: dict[tuple[str, str], list[tuple[str, NamedField]]] = {}
    for name, channels in joints.items():
        for channel in _COMMANDS:
            for each in channels.get(channel, ()):
                kinds.setdefault((channel, _bare(each, name)), []).append((name, each))
    for (channel, _), parts in kinds.items():
        if not all((each.stream.name, each.short) in still for _, each in parts):
            continue
        for name, each in parts:
            joints[name][channel].remove(each)
            if not joints[name][channel]:
                del joints[name][channel]
            draft.left[each.name] = "a command that never changes"


def _bare(each: NamedField, joint: str) -> str:
    """The name of a field without that of its joint."""
    number = _NUMBERED.fullmatch(joint)
    return _SEPARATORS.sub("", each.short.replace(number[1] if number else joint, "")).casefold()


def resolve_velocities(joints: Joints) -> None:
    """Where `qd` and `dq` stand side by side, one of them is a desired position."""
    for channels in joints.values():
        position = channels["position"][0]
        for each in list(channels.get("velocity", ())) if len(channels.get("velocity", ())) > 1 else ():
            slope = _slope(each, position)
            if slope and _ALIKE[0] < slope < _ALIKE[1] and "position_command" not in channels:
                channels["velocity"].remove(each)
                channels["position_command"] = [each]


def resolve_errors(joints: Joints) -> None:
    """Keep the error of a joint only where it tells the target."""
    for channels in joints.values():
        errors = channels.pop("error", [])
        if errors and "position_command" not in channels and errors[0].stream is channels["position"][0].stream:
            channels["error"] = errors[:1]


def resolve_commands(joints: Joints, clocks: Mapping[str, np.ndarray], draft: Draft) -> None:
    """What plain commands command, and targets that only their errors tell; the same for every joint."""
    kinds: dict[str, dict[str, NamedField]] = {}  # name without the joint → joint → field
    for name, channels in joints.items():
        for each in channels.pop("command", ()):
            kinds.setdefault(_bare(each, name), {})[name] = each
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
    joints: Joints,
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


def _slope(first: NamedField, second: NamedField) -> float | None:
    return values_of.slope_of(first.values, second.values) if first.stream is second.stream else None
