"""Simple functions of the logged signals, grouped by signal: what a missing effect could depend on.

Nothing here names a cause. The functions are generic shapes (linear, square, sign, dead zones, products) of
what the model is driven by, so that a remainder that hangs on any of the signals can be seen.
"""

from __future__ import annotations

import numpy as np

from hqpipe.gap.replay import Replay

Groups = dict[str, list[np.ndarray]]

DEAD_ZONES = (0.25, 0.75, 1.5, 3.0)  # in standard deviations of the position error
LAGS_S = (0.001, 0.002, 0.004, 0.008, 0.016, 0.032)  # past commands: transport delays and valve lags
MEMORY_S = (0.1, 1.0)  # fading sums of the position error: integrators and slow creep
SIGN_SHARE = 0.05  # of the velocity's standard deviation: width of the step from −1 to 1


def spread(replays: list[Replay]) -> dict[str, np.ndarray]:
    """Standard deviations (J,) that make the shapes of `joint_signals` dimensionless."""
    error = np.concatenate([r.trajectory.position_command - r.trajectory.position for r in replays])
    velocity = np.concatenate([r.trajectory.velocity for r in replays])
    return {"error": error.std(axis=0) + 1e-12, "velocity": velocity.std(axis=0) + 1e-12}


def joint_signals(item: Replay, j: int, scale: dict[str, np.ndarray]) -> Groups:
    """Signals of one joint, each (T,), by group; the torque is the model's own, never the measured one."""
    t = item.trajectory
    error = (t.position_command[:, j] - t.position[:, j]) / scale["error"][j]
    velocity = t.velocity[:, j] / scale["velocity"][j]
    torque = _running_torque(item, j)
    position = t.position[:, j] - t.position[:, j].mean()
    elapsed = t.time - t.time[0]
    sign = np.tanh(velocity / SIGN_SHARE)
    size, fast = np.abs(error), np.abs(velocity)
    groups = {
        "position_error": [error, size, *[np.sign(error) * np.maximum(size - z, 0.0) for z in DEAD_ZONES]],
        "past_command": _past_commands(t.position_command[:, j] / scale["error"][j], t.dt),
        "past_position_error": [_fading_sum(error, t.dt, span) for span in MEMORY_S],
        "velocity": [velocity, velocity * fast],
        "speed": [fast, error * fast, error * np.maximum(fast - 1.0, 0.0)],
        "velocity_sign": [sign, sign * error, np.abs(sign) * error, np.abs(sign)],
        "torque": [
            torque,
            torque * np.abs(torque),
            error * torque,
            size * torque,
            sign * torque,
            sign * np.abs(torque),
            error * np.maximum(-torque * np.sign(error), 0.0),
        ],
        "torque_at_restart": [_held_torque(item, j)],
        "position": [position, position**2, error * position, velocity * position],
        "time": [elapsed, error * elapsed, torque * elapsed],
    }
    if len(t.joints) > 1:
        demand = (np.abs(t.velocity) / scale["velocity"]).sum(axis=1) - fast
        groups["flow_of_other_joints"] = [demand, error * demand, error * demand**2, torque * demand]
        others = [i for i in range(len(t.joints)) if i != j]
        groups["torque_of_other_joints"] = [t.effort[:, i] for i in others]
    return groups


def _running_torque(item: Replay, j: int) -> np.ndarray:
    """The torque that each step starts from: logged at a window's start, predicted within it."""
    torque = item.predicted[:, j].copy()
    torque[:: item.steps] = item.trajectory.effort[:: item.steps, j]
    return torque


def _held_torque(item: Replay, j: int) -> np.ndarray:
    """The logged torque at the start of the window that predicts a sample."""
    start = np.maximum(np.arange(len(item.predicted)) - 1, 0) // item.steps * item.steps
    return item.trajectory.effort[start, j]


def _past_commands(command: np.ndarray, dt: float) -> list[np.ndarray]:
    lags = dict.fromkeys(max(1, round(span / dt)) for span in LAGS_S)
    return [command[np.maximum(np.arange(len(command)) - lag, 0)] - command for lag in lags]


def _fading_sum(values: np.ndarray, dt: float, span: float) -> np.ndarray:
    """First-order low pass of time constant `span`, s, started at rest."""
    from scipy.signal import lfilter

    keep = np.exp(-dt / span)
    return lfilter([1.0 - keep], [1.0, -keep], values)
