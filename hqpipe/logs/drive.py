"""What a logset.yaml states of the drives and loads of the joints."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hqpipe.errors import LogError, near_match, shown

DRIVE = {
    "kp": "N·m/rad",
    "kd": "N·m·s/rad",
    "torque_constant": "N·m/A",
    "ohm": "Ω",
    "control_hz": "Hz",
    "supply_v": "V",
    "firmware_kp": "the firmware's own unit",
    "firmware_kd": "the firmware's own unit",
}
"""Quantity of a drive → unit: gains of its position loop, motor constant and resistance, rate of the loop, and supply. Gains
that the firmware counts in a unit of its own have names of their own."""
LOAD = {"mass_kg": "kg", "lever_m": "m", "arm_mass_kg": "kg"}
"""Quantity of a load → unit: a known mass at a known distance from the axis, and the mass of the arm that carries it."""
EVERY_JOINT = "*"
Stated = dict[str, dict[str, float]]
"""Joint, or `EVERY_JOINT`, → quantity → number."""


def read_stated(path: Path, field: str, raw: Any, known: Mapping[str, str]) -> Stated:
    """Numbers of one joint each, or of all joints where no joint is named.

    Args:
        path: logset.yaml. field: where in it. raw: what stands there. known: `DRIVE` or `LOAD`.

    Raises:
        LogError: an unknown quantity, or no number.
    """
    fix = f"write {{{', '.join(f'{name}: NUMBER' for name in known)}}}, or that for each joint by name; or leave it out"
    if raw is None:
        return {}
    if not isinstance(raw, dict) or not raw:
        raise LogError(f"{path}: {field} is {shown(raw)}, expected numbers", file=path, field=field, fix=fix)
    nested = all(isinstance(value, dict) for value in raw.values())
    return {
        str(joint): _numbers(path, f"{field}.{joint}" if nested else field, values, known, fix)
        for joint, values in (raw if nested else {EVERY_JOINT: raw}).items()
    }


def _numbers(path: Path, field: str, raw: dict[Any, Any], known: Mapping[str, str], fix: str) -> dict[str, float]:
    found = {}
    for name, value in raw.items():
        if name not in known:
            what = f"unknown field '{field}.{str(name)[:99]}'{near_match(str(name)[:99], known)}"
            raise LogError(f"{path}: {what}", file=path, field=f"{field}.{name}", fix=fix)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < 0:
            what = f"{field}.{name} is {shown(value)}, expected a number of {known[name]}, 0 or more"
            raise LogError(f"{path}: {what}", file=path, field=f"{field}.{name}", fix=fix)
        found[str(name)] = float(value)
    return found


def merged(general: Stated, own: Stated) -> Stated:
    """What a trial states beside what its log set states: the trial's word counts, joint by joint and number by number."""
    return {
        joint: general.get(joint, {}) | own.get(joint, {})
        for joint in (*general, *(j for j in own if j not in general))
    }


def of_joint(stated: Stated, joint: str) -> dict[str, float]:
    """Numbers of one joint."""
    return stated.get(EVERY_JOINT, {}) | stated.get(joint, {})
