"""Groups of joints that a common cause could lie in: a leg, a kind of joint, the machine; read off the names."""

from __future__ import annotations

from collections.abc import Sequence

MACHINE, GROUP, JOINT = "machine", "group", "joint"
NEARLY_ALL = 0.8


def groups(joints: Sequence[str]) -> list[tuple[str, ...]]:
    """Sets of at least two joints, but not all, whose names share a beginning or an end.

    LFR, LFP, LFK share a leg; LFK and RHK a kind; "knee_left" and "knee_right" a word.
    """
    found: dict[tuple[str, ...], None] = {}
    for key in {key for name in joints for key in _keys(name)}:
        members = tuple(name for name in joints if key in _keys(name))
        if 2 <= len(members) < len(joints):
            found[members] = None
    return sorted(found, key=lambda members: (-len(members), [joints.index(name) for name in members]))


def _keys(name: str) -> set[tuple[str, str]]:
    """Beginnings and ends of a name: its words, or its last letter and what stands before."""
    words = name.split("_")
    if len(words) > 1:
        return {("begins", words[0]), ("ends", words[-1])}
    return {("begins", name[:-1]), ("ends", name[-1])} if len(name) > 1 else set()


def scope_of(members: Sequence[str], joints: Sequence[str]) -> str:
    """machine (nearly all joints: some may be too still to show it), group (several) or joint."""
    if len(joints) > 1 and len(members) >= NEARLY_ALL * len(joints):
        return MACHINE
    return GROUP if len(members) > 1 else JOINT
