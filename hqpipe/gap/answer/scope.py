"""Where a cause lies: in the machine, in a group of joints or in one joint."""

from __future__ import annotations

from collections.abc import Sequence

MACHINE, GROUP, JOINT = "machine", "group", "joint"
NEARLY_ALL = 0.8


def scope_of(members: Sequence[str], joints: Sequence[str]) -> str:
    """machine (nearly all joints: some may be too still to show it), group (several) or joint."""
    if len(joints) > 1 and len(members) >= NEARLY_ALL * len(joints):
        return MACHINE
    return GROUP if len(members) > 1 else JOINT
