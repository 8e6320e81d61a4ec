"""Suspicions about units: ranges and ratios that only another unit explains. Warnings, never corrections."""

from __future__ import annotations

import numpy as np

from hqpipe.logs.columns import joint_column
from hqpipe.logs.differentiate import differentiate
from hqpipe.logs.trajectory import Trajectory

DEGREE = np.pi / 180.0
_POSITION_RAD = 7.0  # just above a full turn: joints of legs and arms stay below it
_BAR_TOP = 1.0e3  # hydraulic supplies are below 700 bar
_PSI_TOP = 1.0e4
_BASE_METRES = 1.0e3
_FACTORS = {  # ratio of two channels that should agree → what it means
    1 / DEGREE: "the first is in degrees, the second in radians (×0.0174533)",
    DEGREE: "the second is in degrees, the first in radians (×0.0174533)",
    1000.0: "the first is in mm, the second in m (×0.001)",
    0.001: "the second is in mm, the first in m (×0.001)",
}
_CLOCK = {1e3: "ms (×0.001)", 1e6: "µs (×1e-6)", 1e9: "ns (×1e-9)"}
_CORRELATED = 0.8  # assumption: below this a slope between two channels says nothing about units


def unit_warnings(file: str, trial: Trajectory, rate_hz: float | None) -> list[str]:
    """What looks like another unit in one trial.

    Args:
        file: for the messages.
        trial: as read.
        rate_hz: the stated rate, or None.
    """
    found = _clock(trial, rate_hz) + _ranges(trial) + _shared(trial)
    for j, joint in enumerate(trial.joints):
        found += _ratios(trial, j, joint)
    return [f"{file}: {text}" for text in found]


def _clock(trial: Trajectory, rate_hz: float | None) -> list[str]:
    dt = trial.dt
    if rate_hz is None:
        # no rate is stated: samples a second or more apart are not a joint controller's
        rate = next((f for f in _CLOCK if 10.0 <= f / dt <= 2.0e4), None) if dt >= 0.5 else None
        return [f"time steps by {dt:.6g}: looks like {_CLOCK[rate]}"] if rate else []
    for factor, text in _CLOCK.items():
        if 0.5 < dt * rate_hz / factor < 2.0:
            return [f"time steps by {dt:.6g} where rate_hz says {1 / rate_hz:.6g}: looks like {text}"]
    if abs(dt * rate_hz - 1.0) > 0.05:
        return [f"rate_hz is {rate_hz:g} but time runs at {1 / dt:.6g} Hz; the time column is used"]
    return []


def _ranges(trial: Trajectory) -> list[str]:
    found = []
    for j, joint in enumerate(trial.joints):
        for channel in ("position", "position_command"):
            values = getattr(trial, channel)
            if values is not None and (top := np.quantile(np.abs(values[:, j]), 0.99)) > _POSITION_RAD:
                found.append(
                    f"{joint_column(joint, channel)} reaches {top:.4g}: looks like degrees (×0.0174533), "
                    "or mm (×0.001) if the joint slides"
                )
        for channel in ("pressure_a", "pressure_b"):
            values = getattr(trial, channel)
            if values is not None:
                found += _pressure(joint_column(joint, channel), values[:, j])
    return found


def _pressure(column: str, values: np.ndarray) -> list[str]:
    top = np.quantile(np.abs(values), 0.99)
    if top == 0 or top >= _PSI_TOP:
        return []
    unit = "bar (×1e5)" if top < _BAR_TOP else "psi (×6894.76)"
    return [f"{column} reaches {top:.4g}: looks like {unit}, expected Pa"]


def _shared(trial: Trajectory) -> list[str]:
    found = []
    if "supply/pressure" in trial.extra:
        found += _pressure("supply/pressure", trial.extra["supply/pressure"])
    for axis in "xyz":
        name = f"base/position/{axis}"
        if name in trial.extra and np.abs(trial.extra[name]).max() > _BASE_METRES:
            found.append(f"{name} reaches {np.abs(trial.extra[name]).max():.4g}: looks like mm (×0.001)")
    parts = [trial.extra.get(f"base/orientation/{axis}") for axis in "xyzw"]
    if all(p is not None for p in parts):
        norm = np.sqrt(sum(p**2 for p in parts))
        if np.abs(norm - 1.0).max() > 0.01:
            found.append(f"base/orientation has norms {norm.min():.3g} … {norm.max():.3g}, expected 1")
    parts = [trial.extra.get(f"imu/linear_acceleration/{axis}") for axis in "xyz"]
    if all(p is not None for p in parts):
        mean = float(np.sqrt(sum(p**2 for p in parts)).mean())
        if 0.8 < mean < 1.3:
            found.append(f"imu/linear_acceleration averages {mean:.3g}: looks like g (×9.80665)")
        elif mean < 0.8:
            found.append(f"imu/linear_acceleration averages {mean:.3g} m/s², expected gravity to be included")
    return found


def _ratios(trial: Trajectory, j: int, joint: str) -> list[str]:
    position = trial.position[:, j]
    found = []
    if trial.velocity_source == "measured":
        derived = differentiate(position[:, None], trial.dt)[:, 0]
        velocity = joint_column(joint, "velocity")
        found += _slope(trial.velocity[:, j], derived, velocity, "the derivative of its position")
    if trial.position_command is not None:
        command = joint_column(joint, "position_command")
        found += _slope(trial.position_command[:, j], position, command, "its position")
    return found


def _slope(first: np.ndarray, second: np.ndarray, first_name: str, second_name: str) -> list[str]:
    x, y = second - second.mean(), first - first.mean()
    scale = np.sqrt((x @ x) * (y @ y))
    if scale == 0 or abs(x @ y) < _CORRELATED * scale:
        return []
    slope = (x @ y) / (x @ x)
    for factor, meaning in _FACTORS.items():
        if 0.75 < slope / factor < 1.33:
            return [f"{first_name} is {slope:.4g} times {second_name}: {meaning}"]
    if slope < 0:
        return [f"{first_name} runs against {second_name} (slope {slope:.3g}): one of them has its sign flipped"]
    return []
