"""What chamber pressures logged beside the torque settle: a scale that no model shows, an offset that two could be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hqpipe.effects import EFFECTS
from hqpipe.gap.causes import Cause
from hqpipe.gap.cross_check import CrossCheck, cross_check
from hqpipe.gap.estimate import Estimate, pooled, stated
from hqpipe.gap.groups import scope_of
from hqpipe.logs.trajectory import LogSet

SCALE, BIAS, NULL_SHIFT = "torque_scale", "torque_bias", "position_bias"
CERTAIN = 0.98  # probability of a name that a second sensor confirms; assumption
SAME = 0.1  # relative difference within which joints share one value


def measured(log_set: LogSet, without: Sequence[str] = ()) -> list[CrossCheck]:
    """Findings of the comparison that are certain, of effects in the library."""
    return [found for found in cross_check(log_set) if found.significant and found.effect not in without]


def scale_causes(findings: Sequence[CrossCheck], joints: Sequence[str]) -> list[Cause]:
    """Torque sensors with a gain of their own; one cause per value."""
    rest = [found for found in findings if found.effect == SCALE]
    causes = []
    while rest:
        batch = [f for f in rest if abs(f.value - rest[0].value) <= SAME * abs(rest[0].value - 1.0) + 0.005]
        rest = [f for f in rest if f not in batch]
        parts = [Estimate(f.value, f.low, f.high, max(f.high - f.low, 1e-12) / 3.92) for f in batch]
        one = pooled(parts) if len(parts) > 1 else parts[0]
        ratio = stated(one, EFFECTS[SCALE].parameters[0], dt=0.0)
        names = tuple(f.joint for f in batch)
        causes.append(Cause(SCALE, names, scope_of(names, joints), CERTAIN, {"ratio": ratio}, ()))
    return causes


def settle_offsets(causes: Sequence[Cause], findings: Sequence[CrossCheck], compared: bool) -> list[Cause]:
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
