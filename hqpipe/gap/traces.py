"""Measured and predicted output round the worst held-out window of each joint, for people to look at."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hqpipe.gap.gap_entry import output_unit
from hqpipe.gap.replay import Replay
from hqpipe.logs.trajectory import LogSet

SPAN_S = 0.5  # round the worst window


def worst_windows(before: Sequence[Replay], after: Sequence[Replay], log_set: LogSet) -> dict[str, Any]:
    """JSON-able traces per joint; the worst window is the one with the largest error before."""
    joints = {}
    for j, joint in enumerate(log_set.joints):
        errors = [np.mean(item.targets(item.residual[:, j]) ** 2, axis=1) for item in before]
        worst = int(np.argmax([e.max() for e in errors]))
        item, later = before[worst], after[worst]
        t = item.trajectory
        middle = item.starts[int(np.argmax(errors[worst]))] + 0.5 * item.steps
        half = round(0.5 * SPAN_S / t.dt)
        first = int(np.clip(middle - half, 0, max(t.samples - 2 * half, 0)))
        rows = slice(first, min(first + 2 * half, t.samples))
        restarts = [k for k in range(first, rows.stop) if k % item.steps == 0]
        joints[joint] = {
            "trial": item.file,
            "unit": output_unit(log_set, joint),
            "time": _short(t.time[rows]),
            "command": _short(t.position_command[rows, j]),
            "position": _short(t.position[rows, j]),
            "measured": _short(t.effort[rows, j]),
            "before": _short(item.predicted[rows, j]),
            "after": _short(later.predicted[rows, j]),
            "restarts": _short(t.time[restarts]),
        }
    return {"joints": joints}


def _short(values: np.ndarray) -> list[float]:
    return [float(f"{v:.5g}") for v in values]
