"""Fit trials cut into windows, joint by joint, in the layout of the compiled normal equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.errors import IdentificationError
from hqpipe.identify.free_run import require_channels, window_samples
from hqpipe.logs.clocks import SAME_RATE
from hqpipe.logs.trajectory import Trial

_SHORTEST = 0.5  # share of a window that the last one of a trial must fill


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of all trials; the arrays of a joint run through the trials end to end.

    Attributes:
        bounds: (W, 2) first and last sample of each window; the last is predicted, and starts the next.
        trial: (W,) index of the trial, so that neighbours in time can be told from neighbours in the array.
        samples: length of a full window.
        dt: s.
    """

    bounds: np.ndarray
    trial: np.ndarray
    samples: int
    dt: float


@dataclass(frozen=True, eq=False)
class JointData:
    """What the model of one joint sees, (T,) each.

    Attributes:
        joint: name. effort: torque, N·m. error: of the position, rad. velocity: rad/s. command: rad.
        weight: of the torque's sample in a fit; 0 where it was not recorded.
    """

    joint: str
    effort: np.ndarray
    error: np.ndarray
    velocity: np.ndarray
    command: np.ndarray
    weight: np.ndarray


def common_dt(trials: list[Trial]) -> float:
    """Median sample time of the trials, s.

    Raises:
        IdentificationError: the trials run at different rates.
    """
    steps = [trial.trajectory.dt for trial in trials]
    dt = float(np.median(steps))
    for trial, step in zip(trials, steps, strict=True):
        if abs(step / dt - 1.0) > SAME_RATE:
            raise IdentificationError(
                f"{trial.file} runs at {1 / step:.6g} Hz, the other trials at {1 / dt:.6g} Hz; the "
                "coefficients are per sample, so fit trials of one rate only"
            )
    return dt


def cut_windows(trials: list[Trial], window_s: float) -> Windows:
    """Cut trials into windows of `window_s`, restarted where the last one ended.

    Raises:
        IdentificationError: a channel is missing, the rates differ, or no trial holds a window.
    """
    if not trials:
        raise IdentificationError("no trial to fit: expected at least one with split: fit")
    for trial in trials:
        require_channels(trial.trajectory, ("position_command", "effort"), "the paper's actuator model")
    dt = common_dt(trials)
    samples = window_samples(dt, window_s, trials[0].file)
    bounds, owner, offset = [], [], 0
    for index, trial in enumerate(trials):
        length = trial.trajectory.samples
        first = np.arange(0, length - 1, samples)
        last = np.minimum(first + samples, length - 1)
        keep = last - first >= _SHORTEST * samples
        bounds.append(np.stack([first[keep], last[keep]], axis=1) + offset)
        owner.append(np.full(keep.sum(), index))
        offset += length
    stacked = np.concatenate(bounds).astype(np.int64)
    if not len(stacked):
        raise IdentificationError(f"no fit trial lasts as long as a window of {window_s:g} s")
    return Windows(stacked, np.concatenate(owner), samples, dt)


def joint_data(trials: list[Trial], joint: str) -> JointData:
    """Concatenate one joint over the trials."""
    parts = []
    for trial in trials:
        t = trial.trajectory
        j = t.joint(joint)
        command = t.position_command[:, j]
        parts.append((t.effort[:, j], command - t.position[:, j], t.velocity[:, j], command, t.recorded[:, j]))
    effort, error, velocity, command, recorded = (np.concatenate(column) for column in zip(*parts, strict=True))
    return JointData(joint, effort, error, velocity, command, recorded.astype(np.float64))
