"""Machines in torque and valve mode: exactly the base model plus one effect, by plain numpy loops of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

DT = 1e-3
JOINTS = ("hip", "knee")
SETTLING = 500  # rows that are not logged: the loops start from rest
LOOP_GAIN, DRAG = 0.08, 4.0  # 1, N·m·s/rad, per sample
INERTIA, DAMPING, GRAVITY = 6.0, 20.0, 60.0  # kg·m², N·m·s/rad, N·m
FLOW_GAIN, NEUTRAL = 4.0, 0.05  # rad/s per command, command
NOISE = {"torque": 1.0, "valve": 0.01}  # N·m, rad/s


def multisine(rng, samples, highest_hz, tilt):
    """(samples, J) ten sines from 0.3 Hz, of unit variance."""
    time = np.arange(samples) * DT
    columns = []
    for _ in JOINTS:
        rates = np.geomspace(0.3, highest_hz, 10) * rng.uniform(0.95, 1.05, 10)
        wave = (rates**-tilt * np.sin(2 * np.pi * np.outer(time, rates) + rng.uniform(0, 2 * np.pi, 10))).sum(axis=1)
        columns.append(wave / wave.std())
    return np.stack(columns, axis=1)


def torque_trial(seconds, seed, delay=0.0, deadband=0.0, integral_gain=0.0, leak=0.0):
    """Channels of a force loop round a gravity load; delay s, deadband N·m, integral gain 1/s, leak per sample."""
    rng, samples = np.random.default_rng(seed), SETTLING + round(seconds / DT)
    wave = multisine(rng, samples, 15.0, 0.3)
    log = np.empty((4, samples, len(JOINTS)))
    q, qd, tau, summed = np.zeros(2), np.zeros(2), np.full(2, GRAVITY), np.zeros(2)
    late = round(delay / DT)
    for k in range(samples):
        log[:, k] = q, qd, tau, GRAVITY * np.cos(q) - 120.0 * q - 15.0 * qd + 56.0 * wave[k]
        error = log[3, max(k - late, 0)] - tau
        drive = error + summed
        summed = summed + integral_gain * DT * error
        drive = np.sign(drive) * np.maximum(np.abs(drive) - deadband, 0.0)
        following = tau + LOOP_GAIN * drive - leak * tau - DRAG * qd
        qd = qd + DT * (tau - GRAVITY * np.cos(q) - DAMPING * qd) / INERTIA
        q = q + DT * qd
        tau = following
    names = ("position", "velocity", "effort", "effort_command")
    return logged(dict(zip(names, log, strict=True)), rng, {"effort": NOISE["torque"], "velocity": 2e-3})


def valve_trial(
    seconds, seed, delay=0.0, lag=0.0, deadband=0.0, limit=np.inf, answers_to=0, inclusive=False, load=False
):
    """Channels of a rate-controlled axis.

    Args:
        delay, lag: s. deadband, limit: of the command.
        answers_to: 0 if the speed of a row answers to the command of that row, 1 if to that of the row before.
        inclusive: whether the position of a row contains the speed of that row.
        load: log a torque that has nothing to do with the speed.
    """
    rng, samples = np.random.default_rng(seed), SETTLING + round(seconds / DT)
    wave = multisine(rng, samples, 8.0, 0.5)
    log = np.empty((3, samples, len(JOINTS)))
    q, spool, late = np.zeros(2), np.zeros(2), round(delay / DT) + answers_to
    for k in range(samples):
        log[2, k] = NEUTRAL + 0.3 * wave[k] - 0.25 * q
        opening = log[2, max(k - late, 0)] - NEUTRAL
        spool = spool + (1.0 - np.exp(-DT / lag)) * (opening - spool) if lag else opening
        flow = np.clip(np.sign(spool) * np.maximum(np.abs(spool) - deadband, 0.0), -limit, limit)
        speed = FLOW_GAIN * flow
        log[:2, k] = q + inclusive * DT * speed, speed
        q = q + DT * speed
    channels = dict(zip(("position", "velocity", "valve_command"), log, strict=True))
    if load:
        channels["effort"] = 80.0 * np.cos(log[0]) + 60.0 * multisine(rng, samples, 3.0, 0.5)
    return logged(channels, rng, {"velocity": NOISE["valve"], "position": 1e-5, "effort": 1.0})


def logged(channels, rng, noise):
    """The channels with their sensors' noise, without the start."""
    noisy = {
        name: values + noise.get(name, 0.0) * rng.standard_normal(values.shape) for name, values in channels.items()
    }
    kept = {name: values[SETTLING:] for name, values in noisy.items()}
    return Trajectory(time=np.arange(len(kept["position"])) * DT, joints=JOINTS, **kept)


def log_set(mode, seconds=(8.0, 6.0), seed=1, **effect):
    """A fit and a held-out trial in memory."""
    make = torque_trial if mode == "torque" else valve_trial
    trials = [make(length, 10 * seed + i, **effect) for i, length in enumerate(seconds)]
    return LogSet(
        path=Path("synthetic"),
        sha256="0" * 64,
        format="hqpipe-log/1",
        robot=None,
        base="fixed",
        control_mode=mode,
        effort_source="pressure" if trials[0].effort is not None else None,
        rate_hz=1.0 / DT,
        joints=JOINTS,
        trials=tuple(
            Trial(f"trial_{i}.parquet", split, None, trial)
            for i, (split, trial) in enumerate(zip(("fit", "heldout"), trials, strict=True))
        ),
    )
