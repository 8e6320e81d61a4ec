"""Measured and predicted output of a layer round the worst stretch of each joint, for people to look at."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqpipe.gap.residuals.layer_errors import JudgedJoint, LayerErrors
from hqpipe.identify.model import LayerJoints
from hqpipe.logs.columns import COMMAND_CHANNEL
from hqpipe.logs.trajectory import LogSet, Trajectory

SPAN_S = 0.5  # shown at least
_WINDOWS = 3.0  # shown at least
_FREE_RUN = "free_run_rmse"  # metric of layers whose models run from the log at the start of each window
_GAP = 1.5  # samples between two that are shown, from which on the line is broken


def layer_traces(errors: LayerErrors, log_set: LogSet, joints: LayerJoints) -> dict[str, Any]:
    """JSON-able traces per joint; the worst stretch is the block with the largest error before."""
    trials = {trial.file: trial.trajectory for trial in log_set.trials}
    span = max(SPAN_S, _WINDOWS * joints.window_s)
    traces = {joint.name: _trace(joint, errors, j, trials, span) for j, joint in enumerate(errors.joints)}
    if joints.metric != _FREE_RUN:  # nothing is restarted
        traces = {name: trace | {"restarts": []} for name, trace in traces.items()}
    return {"joints": traces}


def _trace(
    joint: JudgedJoint, errors: LayerErrors, j: int, trials: dict[str, Trajectory], span: float
) -> dict[str, Any]:
    s, found, blocks = joint.samples, joint.found, errors.blocks[j]
    before, after = joint.error(found.base), joint.error(found.named)
    count = np.maximum(np.bincount(blocks), 1)
    worst = int(np.argmax(np.bincount(blocks, before**2) / count))
    inside = np.flatnonzero(blocks == worst)
    trial = s.trial[inside[0]]
    of_trial = s.time[s.trial == trial]
    last = max(float(of_trial[-1]) - span, float(of_trial[0]))
    start = float(np.clip(s.time[inside].mean() - 0.5 * span, of_trial[0], last))
    rows = np.flatnonzero((s.trial == trial) & (s.time >= start) & (s.time <= start + span))
    breaks = np.flatnonzero(np.diff(s.time[rows]) > _GAP * found.model.dt) + 1
    restarts = rows[1:][s.held[rows][1:] != s.held[rows][:-1]]
    series = {
        "position": s.position[rows],
        "measured": s.output[rows],
        "before": s.output[rows] + before[rows],
        "after": s.output[rows] + after[rows],
    }
    command = _command(trials.get(s.files[trial]), joint.name, s.time[rows])
    if command is not None:
        series["command"] = command
    return {
        "trial": s.files[trial],
        "unit": found.model.unit,
        "time": _broken(s.time[rows], breaks, between=True),
        **{name: _broken(values, breaks) for name, values in series.items()},
        "restarts": _short(s.time[restarts]),
    }


def _command(trajectory: Trajectory | None, joint: str, time: np.ndarray) -> np.ndarray | None:
    """(N,) what the joint was told at these times; None where that was not logged."""
    if trajectory is None:
        return None
    logged = [values for name in COMMAND_CHANNEL.values() if (values := getattr(trajectory, name)) is not None]
    if not logged:
        return None
    return np.interp(time, trajectory.time, logged[0][:, trajectory.joint(joint)])


def _broken(values: np.ndarray, breaks: np.ndarray, between: bool = False) -> list[float | None]:
    """Values with a gap before each of `breaks`; between: with the mean of its neighbours there, as of a time."""
    parts = [_short(part) for part in np.split(values, breaks)]
    out: list[float | None] = list(parts[0])
    for part in parts[1:]:
        out += [0.5 * (out[-1] + part[0]) if between else None, *part]
    return out


def _short(values: np.ndarray) -> list[float]:
    return [float(f"{v:.6g}") for v in values]
