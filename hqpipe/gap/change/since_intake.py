"""Joints that an earlier record does not know, because they were left out there: they cannot be compared."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from hqpipe.gap.checks.left_out import LeftOut, of_joints
from hqpipe.gap.intake import Intake

KIND = "not_in_reference"
FIX = "correct the logs of the reference, or give another one"


def only_known(intake: Intake, known: Collection[str], path: str) -> Intake:
    """The logs that were taken in, without the joints that a record says nothing about.

    Args:
        known: joints of the record. path: of the record, as it is shown.
    """
    lacking = [joint for joint in intake.log_set.joints if joint not in known]
    if not lacking or intake.reasons:
        return intake
    reason = f"{', '.join(lacking)}: left out of the reference {path}, so there is nothing to compare with"
    left = (*intake.left_out, LeftOut((), tuple(lacking), None, KIND, reason, FIX))
    kept = [joint for joint in intake.log_set.joints if joint in known]
    if not kept:
        return replace(intake, left_out=left, reasons=(reason,), warnings=(reason, *intake.warnings), advice=FIX)
    logs, raw = of_joints(intake.log_set, kept), of_joints(intake.signed.raw, kept)
    alike = tuple(joint for joint in intake.signed.alike if joint in kept)
    findings = tuple(entry for entry in intake.signed.findings if entry.joint in kept)
    signed = replace(intake.signed, log_set=logs, raw=raw, alike=alike, findings=findings)
    spare = intake.spare | {joint: of_joints(intake.log_set, [joint]) for joint in lacking}
    return replace(intake, log_set=logs, signed=signed, left_out=left, spare=spare)
