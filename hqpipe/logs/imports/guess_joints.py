"""Which fields make a joint, and which joints a log set can have."""

from __future__ import annotations

import re

from hqpipe.logs.columns import CHANNELS as COMPLETE
from hqpipe.logs.imports.guess_fields import Draft, NamedField

_GENERIC = ("command", "error")
"""Channels that stand for another one until it is known which."""

Joints = dict[str, dict[str, list[NamedField]]]
"""Joint → channel → fields."""

_MOTION = ("position", "velocity")


def joints_of_fields(fields: list[NamedField], draft: Draft) -> Joints:
    """The joints that have a position, with the fields that are theirs by name; what belongs to none goes to `draft.left`."""
    found: Joints = {}
    for each in fields:
        if each.meaning.channel != "clock" and "/" not in each.meaning.channel:
            found.setdefault(each.meaning.joint, {}).setdefault(each.meaning.channel, []).append(each)
    real = {name: channels for name, channels in found.items() if "position" in channels}
    for name in [name for name in found if name not in real]:
        for channel, parts in found[name].items():
            for each in parts:
                owner = _owner(each, real)
                if owner is None:
                    draft.left[each.name] = f"no position of a joint '{name}'" if name else "which joint is it of?"
                else:
                    real[owner].setdefault(channel, []).append(each)
    if "" in real:
        if len(real) == 1:
            return {"joint": real[""]}
        real["joint"] = real.pop("")
    return real


def _owner(each: NamedField, real: Joints) -> str | None:
    """The joint with a position that a field belongs to though its name is read as that of another one."""
    name = each.meaning.joint
    if not name:  # `u` beside `knee_pos`
        return next(iter(real)) if len(real) == 1 and "" not in real else None
    alike = [joint for joint in real if joint.casefold() == name.casefold()]  # `Knee_Current` beside `KNEE_pos`
    if len(alike) == 1:
        return alike[0]
    begins = {  # `q3_tau_J` beside `q3`
        joint: len(position.short)
        for joint, channels in real.items()
        for position in channels["position"]
        if re.match(rf"{re.escape(position.short)}[^a-z0-9]", each.short, re.IGNORECASE)
    }
    return max(begins, key=begins.__getitem__) if begins else None


def drop_bare(joints: Joints, draft: Draft) -> None:
    """Leave out what has only a position, or only motion, where other joints have more.

    A log set has a channel for every joint or for none, so that a point of the machine that is logged like a joint, such as the
    position of its hand, would cost the joints what they have more.
    """
    for known in (_MOTION[:1], _MOTION):
        more = {name: [c for c in channels if _of_all(c) and c not in known] for name, channels in joints.items()}
        has = list(dict.fromkeys(c for channels in more.values() for c in channels))
        for name in [name for name, channels in more.items() if has and not channels]:
            what = f"'{name}' has only {' and '.join(known)}, other joints have {', '.join(has)}: taken for no joint"
            draft.left |= {each.name: what for parts in joints.pop(name).values() for each in parts}


def drop_incomplete(joints: Joints, draft: Draft) -> None:
    """Leave out channels that only some joints have, and second fields of one channel."""
    for channel in {c for channels in joints.values() for c in channels}:
        lacking = [name for name, channels in joints.items() if channel not in channels]
        if lacking and _of_all(channel):
            for channels in joints.values():
                for each in channels.pop(channel, ()):
                    draft.left[each.name] = f"{channel}, which joint '{lacking[0]}' has not"
    for name, channels in joints.items():
        for channel, parts in channels.items():
            for each in parts[1:]:
                draft.left[each.name] = f"a second {channel} of '{name}' beside '{parts[0].name}'"


def _of_all(channel: str) -> bool:
    """Whether a log set has that channel for every joint or for none."""
    return channel in COMPLETE or channel in _GENERIC
