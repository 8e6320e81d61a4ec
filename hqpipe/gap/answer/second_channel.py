"""What chamber pressures logged beside the torque settle: a scale that no model shows, an offset that two could be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hqpipe.gap.answer.estimate import Estimate, pooled
from hqpipe.gap.answer.head import significant
from hqpipe.gap.answer.layer_causes import LayerCause
from hqpipe.gap.answer.scope import scope_of
from hqpipe.gap.checks.cross_check import CrossCheck, cross_check
from hqpipe.identify.uncertainty import NORMAL
from hqpipe.logs.trajectory import LogSet
from hqpipe.machine import EFFECTS

SCALE, BIAS, NULL_SHIFT = "torque_scale", "torque_bias", "position_bias"
LOG_PRESSURES = "log the chamber pressures beside the torque"  # what tells these from each other
CERTAIN = 0.98  # probability of a name that a second sensor confirms; assumption
ACCURACY_CLASS = 0.0025  # of common pressure transducers, with which the torque is compared
SAME = 0.1  # relative difference within which joints share one value


def measured(log_set: LogSet, without: Sequence[str] = ()) -> list[CrossCheck]:
    """Findings of the comparison that are certain, of effects in the library."""
    return [found for found in cross_check(log_set) if found.significant and found.effect not in without]


@dataclass(frozen=True)
class ScaleError:
    """Torque sensors with one wrong gain: the ratio of what is logged to what the pressures say."""

    joints: tuple[str, ...]
    ratio: Estimate

    def content(self, machine: Sequence[str]) -> dict[str, Any]:
        """A cause as in diagnosis.json; it is no part of the gap, for the coefficients take it up. machine: all joints."""
        ratio = {
            "value": significant(self.ratio.value),
            "unit": "1",
            "ci95": [significant(self.ratio.low), significant(self.ratio.high)],
        }
        return {
            "effect": SCALE,
            "layer": EFFECTS[SCALE].layer,
            "joints": list(self.joints),
            "scope": scope_of(self.joints, machine),
            "probability": CERTAIN,
            "parameters": {"ratio": ratio},
            "shrink": 0.0,
            "shrink_ci95": [0.0, 0.0],
            "confused_with": [],
        }


def scale_errors(findings: Sequence[CrossCheck]) -> list[ScaleError]:
    """Torque sensors with a gain of their own; one entry per value."""
    rest = [found for found in findings if found.effect == SCALE]
    errors = []
    while rest:
        batch = [f for f in rest if abs(f.value - rest[0].value) <= SAME * abs(rest[0].value - 1.0) + 0.005]
        rest = [f for f in rest if f not in batch]
        parts = [Estimate(f.value, f.low, f.high, max(f.high - f.low, 1e-12) / (2.0 * NORMAL)) for f in batch]
        one = pooled(parts) if len(parts) > 1 else parts[0]
        errors.append(ScaleError(tuple(f.joint for f in batch), _with_class(one)))
    return errors


def _with_class(ratio: Estimate) -> Estimate:
    """The ratio with the accuracy of the pressure sensors in its interval."""
    half = NORMAL * ACCURACY_CLASS * ratio.value
    low, high = float(np.hypot(ratio.value - ratio.low, half)), float(np.hypot(ratio.high - ratio.value, half))
    deviation = float(np.hypot(ratio.deviation, ACCURACY_CLASS * ratio.value))
    return Estimate(ratio.value, ratio.value - low, ratio.value + high, deviation)


def settle_offsets(causes: Sequence[LayerCause], findings: Sequence[CrossCheck], compared: bool) -> list[LayerCause]:
    """Tell an offset of the torque sensor from one of the command, where the pressures were compared.

    Args:
        causes: of the model. findings: certain ones. compared: whether the log holds what the comparison needs.
    """
    biased = {found.joint for found in findings if found.effect == BIAS}
    settled = []
    for cause in causes:
        if compared and cause.effect in (BIAS, NULL_SHIFT) and {BIAS, NULL_SHIFT} & set(cause.rivals):
            sensor = biased.issuperset(cause.joints)
            if not sensor and biased & set(cause.joints):
                settled.append(cause)
                continue
            right, wrong = (BIAS, NULL_SHIFT) if sensor else (NULL_SHIFT, BIAS)
            if cause.effect == right:
                cause = replace(cause, rivals=tuple(name for name in cause.rivals if name != wrong))
        settled.append(cause)
    return settled
