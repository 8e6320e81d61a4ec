"""One joint of a log for the compiled loops, and their scratch; windows lie side by side in memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from hqpipe.machine.valve_lag import follow, lag_share, mean_share


class Signals(NamedTuple):
    """One joint over several trials, end to end; SI units, (T,) each unless stated.

    Attributes:
        mode: POSITION or TORQUE.
        command: rad or N·m, by mode.
        position, velocity, effort: rad, rad/s, N·m.
        time: s since the trial's start.
        demand: flow that all joints draw from the supply, counted in rad/s.
        bounds: (trials + 1,) first sample of each trial, and the end.
        first: (W,) first sample of each window.
        steps: samples that a window predicts.
        target: (steps + 1, W) logged effort; NaN where it was not recorded, never in row 0.
    """

    mode: int
    command: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    time: np.ndarray
    demand: np.ndarray
    bounds: np.ndarray
    first: np.ndarray
    steps: int
    target: np.ndarray


class Work(NamedTuple):
    """Scratch of one simulation.

    Attributes:
        opening, velocity, offset, loss, mean: (steps + 1, W) inputs of the core.
        kept, sticking, sliding: (steps + 1, W) what travel leaves of the direction of friction, share of static friction, and
            speed at the sample.
        turned, state: (W,) direction of friction and inner torque at the start of each window.
        command, sequence, other, stiff: (T,) opening; scratch.
        spool, integral: (W,), driven, summed: (T,) spool and integrator of torque mode as the logged effort drives them.
        sagged, middling, slid, slow, moving, speed: (T,) of loss, mean, kept, sticking, sliding and velocity.
        held: (trials,) what the integrator was last found to hold at the start of each trial; the next search begins there.
    """

    opening: np.ndarray
    velocity: np.ndarray
    offset: np.ndarray
    turned: np.ndarray
    kept: np.ndarray
    sticking: np.ndarray
    sliding: np.ndarray
    loss: np.ndarray
    mean: np.ndarray
    command: np.ndarray
    sequence: np.ndarray
    other: np.ndarray
    spool: np.ndarray
    integral: np.ndarray
    state: np.ndarray
    driven: np.ndarray
    summed: np.ndarray
    sagged: np.ndarray
    middling: np.ndarray
    stiff: np.ndarray
    slid: np.ndarray
    slow: np.ndarray
    speed: np.ndarray
    moving: np.ndarray
    held: np.ndarray


@njit(cache=True, nogil=True)
def make_work(signals: Signals) -> Work:
    """Scratch for `signals`."""
    rows, windows, samples = signals.steps + 1, signals.first.shape[0], signals.command.shape[0]
    return Work(
        np.empty((rows, windows)),
        np.empty((rows, windows)),
        np.empty((rows, windows)),
        np.zeros(windows),
        np.zeros((rows, windows)),
        np.zeros((rows, windows)),
        np.zeros((rows, windows)),
        np.zeros((rows, windows)),
        np.zeros((rows, windows)),
        np.empty(samples),
        np.empty(samples),
        np.empty(samples),
        np.empty(windows),
        np.empty(windows),
        np.empty(windows),
        np.empty(samples),
        np.empty(samples),
        np.zeros(samples),
        np.zeros(samples),
        np.empty(samples),
        np.zeros(samples),
        np.zeros(samples),
        np.empty(samples),
        np.zeros(samples),
        np.zeros(signals.bounds.shape[0] - 1),
    )


@njit(cache=True, nogil=True)
def lay_out(sequence: np.ndarray, first: np.ndarray, out: np.ndarray) -> None:
    """Windows side by side: out[k, w] = sequence[first[w] + k]."""
    for k in range(out.shape[0]):
        for w in range(first.shape[0]):
            out[k, w] = sequence[first[w] + k]


@njit(cache=True, nogil=True)
def lag_behind(sequence: np.ndarray, bounds: np.ndarray, time_constant: float, dt: float) -> None:
    """A sequence of several trials behind a first-order lag, in place; each value is the mean over its sample."""
    if time_constant == 0.0:
        return
    share, mean = lag_share(time_constant, dt), mean_share(time_constant, dt)
    for trial in range(bounds.shape[0] - 1):
        behind = sequence[bounds[trial]]
        for k in range(bounds[trial], bounds[trial + 1]):
            ahead = sequence[k]
            sequence[k] = follow(behind, ahead, mean)
            behind = (1.0 - share) * behind + share * ahead  # as `follow`, with a shorter wait for the sample before
