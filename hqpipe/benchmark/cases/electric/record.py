"""Running an electric machine and recording it: commands, physics, sensors, clock."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hqpipe.benchmark.cases.electric.drives import run_joints
from hqpipe.benchmark.cases.electric.machine import OUTPUT_SHARE, STEP, ElectricMachine
from hqpipe.benchmark.cases.motions import BLEND_S, Range, course, smooth
from hqpipe.benchmark.cases.planted import Motion
from hqpipe.sim.joint_chain import JointChain

KEPT_S = 1.0e-3  # s between the rows that the loop keeps, as fast as the fastest log
KEEP = round(KEPT_S / STEP)
ROUNDING_S = 0.08  # s, each of an arm's moving averages; assumption: usual settings are 50 to 200 ms
SETTLE_S = 0.5  # s before the log begins, in which the joints come to rest under their load


def commanded(machine: ElectricMachine, trial: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Time (T,) s and commands (T, J) of a trial at the engine's steps.

    A servo's host sends frames, between which the last one is held; an arm's drives interpolate them.
    """
    time = np.arange(round(trial.seconds / STEP)) * STEP
    columns = []
    for j, room in enumerate(machine.rooms):
        rng = np.random.default_rng([trial.seed, j])
        columns.append(_in_turn(trial, j, time, room, rng) if trial.turns else course(trial.names[j], time, room, rng))
    if machine.family == "arm":
        return time, np.column_stack([_jerk_limited(column) for column in columns])
    frame = np.minimum(
        (np.floor(time * machine.logger.host_hz + 1e-9) / machine.logger.host_hz / STEP).round(), len(time)
    )
    return time, np.column_stack(columns)[frame.astype(np.int64)]


def _in_turn(trial: Motion, j: int, time: np.ndarray, room: Range, rng: np.random.Generator) -> np.ndarray:
    """(T,) of joint `j`, which moves in its share of the time, from the middle, and comes back to it."""
    count = len(trial.names)
    start, stop = (round(len(time) * k / count) for k in (j, j + 1))
    result = np.full(len(time), room.middle)
    moving = course(trial.names[j], time[: stop - start], room, rng)
    fade = smooth(np.clip((time[stop - start] - time[: stop - start]) / BLEND_S, 0.0, 1.0)) if stop < len(time) else 1.0
    result[start:stop] = room.middle + fade * (moving - room.middle)
    return result


def _jerk_limited(column: np.ndarray) -> np.ndarray:
    """(T,) through two moving averages, as motion controllers round off what they plan."""
    from scipy.ndimage import uniform_filter1d

    width = round(ROUNDING_S / STEP)
    return uniform_filter1d(uniform_filter1d(column, width, mode="nearest"), width, mode="nearest")


def record(machine: ElectricMachine, trial: Motion) -> dict[str, np.ndarray]:
    """The columns of a trial as the machine's logger writes them."""
    time, command = commanded(machine, trial)
    lead = round(SETTLE_S / STEP)
    received = np.vstack([np.repeat(command[:1], lead, axis=0), _received(machine, command, trial)])
    kept = np.empty((len(received) // KEEP, len(machine.names), 6))
    joints = machine.joints.copy()
    joints["kp"] *= trial.gain
    for name in ("push_from", "push_until", "warm_from"):
        joints[name] = joints[name] * trial.seconds + SETTLE_S  # given as shares of the trial
    chain = JointChain(machine.xml(trial.load))
    soft = joints["flexible"] > 0.0
    chain.armature[soft] *= OUTPUT_SHARE  # the rotor turns by itself
    for j in range(len(joints)):
        chain.armature[j] += machine.sensing.get(f"armature/{j}", 0.0)
    chain.place(command[0])
    run_joints(
        (chain.step, chain.model, chain.data),
        chain.position,
        chain.velocity,
        chain.applied,
        chain.friction,
        chain.damping,
        joints,
        np.ascontiguousarray(received),
        np.array(machine.supply),
        STEP,
        machine.every,
        KEEP,
        kept,
    )
    return _logged(machine, trial, command, kept[lead // KEEP :])


def _received(machine: ElectricMachine, command: np.ndarray, trial: Motion) -> np.ndarray:
    """Commands (T, J) as they reach the firmware: late, beside its own zero, or not at all."""
    result = command.copy()
    for j in range(command.shape[1]):
        lost = machine.sensing.get(f"lost_frames/{j}", 0.0)
        if lost > 0.0:
            result[:, j] = _with_lost_frames(result[:, j], lost, np.random.default_rng([trial.seed, j, 7]))
        late = round(machine.sensing.get(f"delay_s/{j}", 0.0) / STEP)
        if late:
            result[late:, j] = result[:-late, j].copy()
            result[:late, j] = command[0, j]
        result[:, j] += machine.sensing.get(f"bias/{j}", 0.0)
    return result


def _with_lost_frames(column: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """With stretches of 40 to 160 ms in which what came before is held; `share` of the time in all."""
    result, at = column.copy(), 0
    while at < len(column):
        length = round(rng.uniform(0.04, 0.16) / STEP)
        at += round(rng.exponential(0.1 * (1.0 - share) / share) / STEP) + 1
        if at < len(column):
            result[at : at + length] = column[at - 1]
        at += length
    return result


def _lagged(signal: np.ndarray, lag: float) -> np.ndarray:
    """(T,) through a first-order filter of time constant `lag`, s."""
    from scipy.signal import lfilter

    share = 1.0 - np.exp(-KEPT_S / lag)
    return lfilter([share], [1.0, share - 1.0], signal, zi=[(1.0 - share) * signal[0]])[0]


def sample_times(seconds: float, rate_hz: float, jitter: float, rng: np.random.Generator) -> np.ndarray:
    """(T,) s from 0; each row is off by itself, so that the clock does not wander."""
    dt = 1.0 / rate_hz
    time = np.arange(int((seconds - 2 * KEPT_S) * rate_hz) - 1) * dt
    if jitter > 0.0:
        off = np.clip(rng.normal(0.0, jitter / 2.0**0.5, len(time)), -0.35, 0.35)
        off[0] = 0.0
        time = time + np.maximum(off, -0.0 if len(time) < 2 else -0.35) * dt
    return time


def _logged(machine: ElectricMachine, trial: Motion, command: np.ndarray, kept: np.ndarray) -> dict[str, np.ndarray]:
    log, rng = machine.logger, np.random.default_rng([trial.seed, 99])
    time = sample_times(trial.seconds, log.rate_hz, log.jitter, rng)
    fine = np.arange(len(kept)) * KEPT_S
    # Commands bear the time at which the drive acts on them, so that a sound drive has no delay.
    frames = np.clip(np.floor((time - machine.latency()) / STEP + 0.5).astype(np.int64), 0, len(command) - 1)
    found: dict[str, np.ndarray] = {"time": time}
    for j, name in enumerate(machine.names):
        columns = {
            "position": np.interp(time, fine, kept[:, j, 0]) + _zero(machine, j),
            "velocity": np.interp(time, fine, _lagged(kept[:, j, 1], log.speed_lag)),
            "effort": _effort(machine, j, time, fine, kept[:, j, 2], rng),
            "position_command": command[frames, j],
            "duty": np.interp(time, fine, kept[:, j, 3]),
        }
        columns["position"] = np.round(columns["position"] / log.resolution[j]) * log.resolution[j]
        step = log.resolution[j] * 10.0
        columns["velocity"] = np.round(columns["velocity"] / step) * step
        stale = machine.sensing.get(f"stale_rows/{j}", 0.0)
        for channel in log.channels:
            column = columns[channel]
            if stale > 0.0 and channel != "position_command":
                column = column[_stale_rows(time, stale, np.random.default_rng([trial.seed, j, 8]))]
            found[f"joint/{name}/{channel}"] = column
    if log.supply:
        found["supply/voltage"] = np.round(np.interp(time, fine, kept[:, 0, 4]) + rng.normal(0, 0.02, len(time)), 1)
    return found


def _zero(machine: ElectricMachine, j: int) -> float:
    return machine.sensing.get(f"zero/{j}", 0.0)


def _effort(
    machine: ElectricMachine, j: int, time: np.ndarray, fine: np.ndarray, torque: np.ndarray, rng: Any
) -> np.ndarray:
    log = machine.logger
    late = machine.sensing.get(f"skew_s/{j}", 0.0)
    clean = np.interp(time - late, fine, _lagged(torque, 0.03 / log.rate_hz))
    effort = (clean + rng.normal(0.0, 1.0, len(time)) * log.effort_noise[j]) * log.effort_scale[j]
    return np.abs(effort) if machine.sensing.get(f"unsigned/{j}", 0.0) > 0.0 else effort


def _stale_rows(time: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """(T,) row from which each row's values are: some are repeated for 20 to 100 ms; `share` of the time in all."""
    rows, dt = len(time), float(np.median(np.diff(time)))
    source, at = np.arange(rows), 0
    while at < rows:
        length = max(round(rng.uniform(0.02, 0.1) / dt), 1)
        at += round(rng.exponential(0.06 * (1.0 - share) / share) / dt) + 1
        if at < rows:
            source[at : at + length] = at - 1
        at += length
    return source


def stated(machine: ElectricMachine, trial: Motion) -> Mapping[str, Any]:
    """`drive` and `load` of a trial for logset.yaml, as far as the machine states them."""
    found: dict[str, Any] = {}
    if "drive" in machine.states and machine.family == "servo":
        kp = machine.joints["kp"] * trial.gain
        # The loop's own latency takes a little of the damping, as it would in a test of the drive.
        damped = machine.joints["kd"] + machine.joints["back_emf"] - kp * machine.latency()
        found["drive"] = {
            name: {"kp": float(f"{kp[j]:.6g}"), "kd": float(f"{damped[j]:.6g}")} for j, name in enumerate(machine.names)
        }
    if "load" in machine.states and machine.family == "servo":
        found["load"] = {
            name: {
                "mass_kg": float(f"{link.load_mass * trial.load:.6g}"),
                "lever_m": float(f"{link.length:.6g}"),
                "arm_mass_kg": float(f"{link.bar_mass:.6g}"),
            }
            for name, link in zip(machine.names, machine.links, strict=True)
        }
    return found
