"""What is in a log set, at a glance."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqpipe.logs.clocks import jitter
from hqpipe.logs.columns import CHANNELS
from hqpipe.logs.trajectory import LogSet, Trial


def audit(log_set: LogSet) -> dict[str, Any]:
    """Summary of a log set, JSON-able: header, one entry per trial, ranges per joint and channel."""
    return log_set.header() | {
        "trials": [_trial(trial) for trial in log_set.trials],
        "duration_s": {
            split: round(sum(t.trajectory.duration for t in log_set.trials if t.split == split), 3)
            for split in ("fit", "heldout")
        },
        "ranges": {joint: _ranges(log_set, j) for j, joint in enumerate(log_set.joints)},
        "velocity_source": log_set.trials[0].trajectory.velocity_source,
        "other_columns": sorted({name for t in log_set.trials for name in t.trajectory.extra}),
    }


def _trial(trial: Trial) -> dict[str, Any]:
    rms, largest = jitter(trial.trajectory.time)
    return {
        "file": trial.file,
        "split": trial.split,
        "command": trial.command,
        "samples": trial.trajectory.samples,
        "duration_s": trial.trajectory.duration,
        "rate_hz": 1.0 / trial.trajectory.dt,
        "jitter_rms": rms,
        "jitter_max": largest,
    }


def _ranges(log_set: LogSet, j: int) -> dict[str, dict[str, Any]]:
    """Smallest, largest and RMS value of every recorded channel of one joint, over all trials."""
    ranges = {}
    for channel in log_set.trials[0].trajectory.channels():
        parts = [getattr(trial.trajectory, channel)[:, j] for trial in log_set.trials]
        square = sum(float(p @ p) for p in parts) / sum(len(p) for p in parts)
        ranges[channel] = {
            "unit": CHANNELS[channel],
            "min": float(min(p.min() for p in parts)),
            "max": float(max(p.max() for p in parts)),
            "rms": float(np.sqrt(square)),
        }
    return ranges
