"""What every diagnosis.json holds, and the one that says that the logs cannot carry an answer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hqpipe.gap.answer.schema import FORMAT, validate_diagnosis
from hqpipe.gap.change.since import EarlierLogs, EarlierModel
from hqpipe.gap.checks.left_out import LeftOut
from hqpipe.logs.trajectory import LogSet, recording_of


def not_identifiable(
    log_set: LogSet,
    warnings: list[str],
    advice: str | None,
    earlier: EarlierModel | EarlierLogs | None = None,
    left_out: Sequence[LeftOut] = (),
) -> dict[str, Any]:
    """The answer when the logs cannot carry one."""
    content = head(log_set, "not_identifiable", earlier, left_out) | {
        "gap": None,
        "where": [],
        "causes": [],
        "effects_considered": [],
        "unexplained": {"share_of_gap": None, "above_noise": False, "where": [], "depends_on": []},
        "next_experiment": advice,
        "warnings": warnings,
    }
    validate_diagnosis(content)
    return content


def head(
    log_set: LogSet, verdict: str, earlier: EarlierModel | EarlierLogs | None, left_out: Sequence[LeftOut]
) -> dict[str, Any]:
    """Format, verdict, logs, what was left out of them, and what they are compared with."""
    logs = {
        "path": str(log_set.path),
        "sha256": log_set.sha256,
        "trials": len({(recording_of(trial), trial.split) for trial in log_set.trials}),
        "joints": list(log_set.joints),
        "control_mode": log_set.control_mode,
    }
    reference = {} if earlier is None else {"reference": earlier.header()}
    without = {"left_out": [item.content() for item in left_out]}
    return {"format": FORMAT, "verdict": verdict, "logs": logs} | without | reference


def significant(value: float) -> float:
    """Six significant digits, which is more than any log knows."""
    return float(f"{value:.6g}")
