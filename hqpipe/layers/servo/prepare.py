"""One joint before its windows are cut: its signals, what fixes its scale, how fast it responds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.layers.servo.rows import rows_of_step, thinned
from hqpipe.layers.servo.scale import Scale, duty_of, scale_of
from hqpipe.layers.servo.tracks import Tracks, response_time, smoothing, tracks_of
from hqpipe.logs.columns import joint_column
from hqpipe.logs.survey.end_stop import EndStop
from hqpipe.logs.survey.signal import difference_noise
from hqpipe.logs.trajectory import LogSet, Trial

_MOVES = 20.0  # steps of the sensor, or standard deviations of its noise, that the travel must have; assumption
_TOO_SHORT = "no fit trial is long enough"


@dataclass(frozen=True, eq=False)
class Prepared:
    """One joint before its windows are cut.

    Attributes:
        tracks: of the fit and the held-out trials. rows: (R,) of each, indices of these trials into the numbers of `scale`.
        response_s: by which the joint follows its input. row_s: from row to row of the log. travel: unit of the position, as
            `sensor_noise`. trials: of which the tracks are.
    """

    joint: str
    scale: Scale
    tracks: tuple[Tracks, Tracks]
    rows: tuple[np.ndarray, np.ndarray]
    response_s: float
    row_s: float
    travel: float
    sensor_noise: float
    trials: tuple[tuple[Trial, ...], tuple[Trial, ...]]
    joints: tuple[str, ...]
    kinds: dict[str, str]


def prepare(log_set: LogSet, joint: str, stops: list[EndStop], window_s: float | None = None) -> Prepared | str:
    """Signals and scale of one joint, or why it cannot be judged.

    Args:
        stops: of all joints. window_s: s, length of a free run that was asked for, or None.
    """
    trials = list(log_set.trials)
    duty = all(duty_of(trial.trajectory, joint) is not None for trial in trials)
    if not duty and any(trial.trajectory.position_command is None for trial in trials):
        return f"neither {joint_column(joint, 'position_command')} nor {joint_column(joint, 'duty')} in every trial"
    fit = [trial.trajectory for trial in trials if trial.split == "fit"]
    q = np.concatenate([t.position[:, t.joint(joint)] for t in fit])
    travel = float(np.ptp(q))
    sensor = difference_noise([t.trajectory.position[:, t.trajectory.joint(joint)] for t in trials])
    if travel <= _MOVES * max(sensor, 1e-12 * float(np.abs(q).max())):
        return f"it moves by {travel:.2g} only"
    scale = scale_of(trials, joint, log_set.kinds.get(joint))
    here = [stop for stop in stops if stop.joint == joint]
    long, tracks = _tracks(trials, joint, scale, here, travel)
    if not len(tracks[0].position):
        return _TOO_SHORT
    if np.ptp(tracks[0].inputs) == 0.0:
        return f"its {'duty' if scale.duty else 'command'} never changes in the fit trials"
    follows = None if np.isnan(tracks[0].command).any() else tracks[0].command
    response = response_time(tracks[0], follows)
    row_s = float(np.median(tracks[0].dt))
    every = rows_of_step(row_s, response, window_s)
    if every > 1:
        trials = [thinned(trial, joint, every) for trial in trials]
        long, tracks = _tracks(trials, joint, scale, here, travel)
        if not len(tracks[0].position):
            return _TOO_SHORT
    return Prepared(
        joint,
        scale,
        tracks,
        (np.array(long[0], dtype=np.int64), np.array(long[1], dtype=np.int64)),
        response,
        row_s,
        travel,
        sensor,
        (tuple(trials[i] for i in long[0]), tuple(trials[i] for i in long[1])),
        tuple(log_set.joints),
        dict(log_set.kinds),
    )


def _tracks(
    trials: list[Trial], joint: str, scale: Scale, stops: list[EndStop], travel: float
) -> tuple[tuple[list[int], list[int]], tuple[Tracks, Tracks]]:
    """Which of the fit and of the held-out trials are long enough, and their signals."""
    long: dict[str, list[int]] = {"fit": [], "heldout": []}
    for i, trial in enumerate(trials):
        t = trial.trajectory
        if t.samples > 1 and t.samples > smoothing(t.dt):
            long[trial.split].append(i)
    fit, held = (tracks_of([trials[i] for i in part], part, joint, scale, stops, travel) for part in long.values())
    return (long["fit"], long["heldout"]), (fit, held)
