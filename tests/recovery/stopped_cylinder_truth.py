"""A servo cylinder under force control that travels from end stop to end stop and rests there, by equations of its own.

The oil is a spring that the valve winds up and the motion unwinds; the rod moves a mass with viscous friction. Where the piston
comes to rest on the cylinder's own end, the load cell in the rod no longer feels the oil. N, m, s.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numba import njit

from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

DT, INNER = 1e-3, 20  # s between samples; steps of the integration in each
STIFFNESS, MASS, DAMPING = 4e6, 150.0, 1.5e4  # of the oil N/m; kg; N·s/m
LOOP = 60.0  # 1/s: how fast an error of the force winds up the oil
RELIEF = 3e4  # N, at which the relief valves open
STROKE = 0.2  # m to either side of the middle
STOP_STIFFNESS, STOP_DAMPING = 5e7, 1e5  # N/m, N·s/m
NOISE = {"position": 2e-6, "velocity": 1e-3, "effort": 20.0}
PASSES = 1.0 / 6.0  # share by which the valve passes more while extending: 1.4 times as fast as while retracting


@njit
def run(wanted: np.ndarray, ratio: float, reach: float, inside: bool, q: float) -> np.ndarray:
    """(samples, 4) position, velocity, measured force and command.

    Args:
        wanted: (samples,) force. ratio: by which the valve passes more in the positive direction.
        reach: position of the stops, to either side. inside: whether they are in the cylinder, behind the load cell.
    """
    log, v, oil, h = np.empty((wanted.shape[0], 4)), 0.0, 0.0, DT / INNER
    for k in range(wanted.shape[0]):
        stop = 0.0
        for i in range(INNER + 1):
            beyond = q - reach if q > reach else (q + reach if q < -reach else 0.0)
            stop = -STOP_STIFFNESS * beyond - STOP_DAMPING * v if beyond != 0.0 else 0.0
            if stop * beyond > 0.0:  # a stop only pushes
                stop = 0.0
            if i == INNER:
                break
            error = wanted[max(k - 1, 0)] - log[max(k - 1, 0), 2] if k else 0.0
            flow = LOOP / STIFFNESS * (error + ratio * abs(error))
            v += h * (oil + stop - DAMPING * v) / MASS
            oil = min(max(oil + h * STIFFNESS * (flow - v), -RELIEF), RELIEF)
            q += h * v
        log[k] = q, v, oil + stop if inside else oil, wanted[k]
    return log


def strokes(rng: np.random.Generator, samples: int, rests: float) -> np.ndarray:
    """(samples,) force: out and in again for a few seconds each, a little livelier than a square wave.

    Args:
        rests: s that it goes on pushing after the stroke.
    """
    time = np.arange(samples) * DT
    rates = rng.uniform(0.5, 6.0, 8)
    lively = np.sin(2.0 * np.pi * np.outer(time, rates) + rng.uniform(0.0, 2.0 * np.pi, 8)).sum(axis=1)
    wanted, at, side = np.empty(samples), 0, 1.0
    while at < samples:
        length = round(rng.uniform(1.8 + 0.5 * rests, 1.8 + 1.5 * rests) / DT)
        wanted[at : at + length] = side * rng.uniform(1.0e4, 1.5e4)
        at, side = at + length, -side
    return wanted + 1.2e3 * lively


def log_set(ratio=PASSES, reach=STROKE, inside=True, rests=1.0, seconds=(16.0, 16.0, 12.0), seed=0) -> LogSet:
    """Fit trials and a held-out one, the last, in memory."""
    trials = []
    for i, length in enumerate(seconds):
        rng = np.random.default_rng(100 * seed + i)
        q, v, force, wanted = run(strokes(rng, round(length / DT), rests), ratio, reach, inside, -0.8 * STROKE).T
        logged = {"position": q, "velocity": v, "effort": force}
        noisy = {name: x + NOISE[name] * rng.standard_normal(len(x)) for name, x in logged.items()}
        columns = {name: x[:, None] for name, x in noisy.items()} | {"effort_command": wanted[:, None]}
        t = Trajectory(time=np.arange(len(q)) * DT, joints=("ram",), **columns)
        trials.append(Trial(f"trial_{i}.parquet", "heldout" if i == len(seconds) - 1 else "fit", None, t))
    return LogSet(
        path=Path("synthetic"),
        sha256="0" * 64,
        format="hqpipe-log/1",
        robot=None,
        base="fixed",
        control_mode="torque",
        effort_source="load_cell",
        rate_hz=1.0 / DT,
        joints=("ram",),
        trials=tuple(trials),
        kinds={"ram": "prismatic"},
    )
