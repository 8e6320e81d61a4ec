"""The gap in diagnosis.json: joint by joint in the joint's own unit, and pooled without one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hqpipe.gap.residuals.joint_scale import pooled
from hqpipe.logs.joint_kinds import unit_of
from hqpipe.logs.trajectory import LogSet

SIZES = ("before", "after", "noise_floor", "persistence")
UNLIKE = 100.0
"""Largest over smallest scale from which joints of unknown kind are given no common size; assumption: drives of one machine
differ less where their unit is the same, and where they do not the size would be that of the largest alone."""


def output_unit(log_set: LogSet, joint: str) -> str:
    """Unit of the torque of a joint; as of one that turns where its kind is not known."""
    return unit_of("N·m", log_set.kinds.get(joint))


def common_unit(log_set: LogSet, scale: np.ndarray, units: Sequence[str] | None = None) -> str | None:
    """The unit in which errors of all joints may be pooled; None where there is none.

    Args:
        scale: (J,), see `hqpipe.gap.residuals.joint_scale`. units: (J,) of the outputs; those of the actuator layer without it.
    """
    units = set(units or [output_unit(log_set, joint) for joint in log_set.joints])
    known = len(log_set.kinds) == len(log_set.joints)
    return units.pop() if len(units) == 1 and (known or unlikeness(scale) <= UNLIKE) else None


def unlikeness(scale: np.ndarray) -> float:
    """Largest over smallest scale of the joints that have one."""
    finite = scale[np.isfinite(scale)]
    return float(finite.max() / finite.min()) if len(finite) else 1.0


def undeclared(log_set: LogSet, scale: np.ndarray) -> list[str]:
    """What to know where joints of unknown kind are too unlike for one unit."""
    if len(log_set.kinds) == len(log_set.joints) or unlikeness(scale) <= UNLIKE:
        return []
    finite = np.where(np.isfinite(scale), scale, np.nan)
    large, small = (log_set.joints[int(pick(finite))] for pick in (np.nanargmax, np.nanargmin))
    return [
        f"the outputs of {large} and {small} differ {unlikeness(scale):,.0f}-fold, so that errors are pooled without a unit: "
        f"if one of them slides and the other turns, say so in logset.yaml, as joints: {{{small}: {{type: prismatic}}}}"
    ]


def gap_entry(
    log_set: LogSet, squares: Mapping[str, np.ndarray], scale: np.ndarray, units: Sequence[str] | None = None
) -> dict[str, Any]:
    """unit, the sizes in it, the same without a unit, and both of each joint.

    Args:
        squares: (J,) mean squared error by the names of `SIZES`, in the squared unit of each joint. scale: (J,).
        units: (J,) of the outputs; those of the actuator layer without it.
    """
    units = units or [output_unit(log_set, joint) for joint in log_set.joints]
    unit = common_unit(log_set, scale, units)
    known = np.where(np.isfinite(scale), scale, np.nan)
    joints = [
        {
            "joint": joint,
            "type": log_set.kinds.get(joint),
            "unit": units[j],
            "scale": _digits(known[j]),
            **{name: _digits(np.sqrt(squares[name][j])) for name in SIZES},
            "normalised": {name: _digits(np.sqrt(squares[name][j]) / known[j]) for name in SIZES},
        }
        for j, joint in enumerate(log_set.joints)
    ]
    return {
        "unit": unit,
        **{name: _digits(np.sqrt(np.mean(squares[name]))) if unit else None for name in SIZES},
        "normalised": {name: _digits(pooled(squares[name], scale)) for name in SIZES},
        "joints": joints,
    }


def _digits(value: float) -> float | None:
    """Six significant digits, which is more than any log knows; None for what is not a number."""
    return float(f"{value:.6g}") if np.isfinite(value) else None
