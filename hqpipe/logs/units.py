"""Suspicions about units: ranges and ratios that only another unit explains. Warnings, never corrections."""

from __future__ import annotations

import numpy as np

from hqpipe.logs.differentiate import differentiate
from hqpipe.logs.findings import Finding
from hqpipe.logs.trajectory import Trajectory
from hqpipe.logs.turns import encoder_range, in_words, jumps

DEGREE = np.pi / 180.0
_POSITION_RAD = 7.0  # just above a full turn: joints of legs and arms stay below it
_TWO_TURNS_DEG = 720.0  # assumption: beyond two turns in degrees a joint spins, and its range says nothing of the unit
_FASTEST_RAD_S = 60.0  # assumption: a joint that stays within two turns is slower; in degrees per second that is slow
_ALIKE = (0.75, 1.33)  # assumption: slopes between two channels of one quantity and one unit
_BAR_TOP = 1.0e3  # hydraulic supplies are below 700 bar
_PSI_TOP = 1.0e4
_BASE_METRES = 1.0e3
_FACTORS = {  # ratio of two channels that should agree → what it means
    1 / DEGREE: "the first is in degrees, the second in radians (×0.0174533)",
    DEGREE: "the second is in degrees, the first in radians (×0.0174533)",
    1000.0: "the first is in mm, the second in m (×0.001)",
    0.001: "the second is in mm, the first in m (×0.001)",
}
_TOO_LARGE = (DEGREE, 0.001)  # of a velocity in SI beside a position in degrees or mm
_CLOCK = {1e3: "ms (×0.001)", 1e6: "µs (×1e-6)", 1e9: "ns (×1e-9)"}
_CORRELATED = 0.8  # assumption: below this a slope between two channels says nothing about units


def unit_findings(file: str, trial: Trajectory, rate_hz: float | None) -> list[Finding]:
    """What looks like another unit in one trial.

    Args:
        file: its name.
        trial: as read.
        rate_hz: the stated rate, or None.
    """
    found = _clock(file, trial, rate_hz) + _ranges(file, trial) + _shared(file, trial)
    for j, joint in enumerate(trial.joints):
        found += _ratios(file, trial, j, joint)
    return found


def _clock(file: str, trial: Trajectory, rate_hz: float | None) -> list[Finding]:
    dt = trial.dt
    if rate_hz is None:
        # no rate is stated: samples a second or more apart are not a joint controller's
        rate = next((f for f in _CLOCK if 10.0 <= f / dt <= 2.0e4), None) if dt >= 0.5 else None
        return [Finding("clock_unit", file, f"time steps by {{}}: looks like {_CLOCK[rate]}", size=dt)] if rate else []
    for factor, text in _CLOCK.items():
        if 0.5 < dt * rate_hz / factor < 2.0:
            text = f"time steps by {{}} where rate_hz says {1 / rate_hz:.6g}: looks like {text}"
            return [Finding("clock_unit", file, text, size=dt)]
    if abs(dt * rate_hz - 1.0) > 0.05:
        text = f"rate_hz is {rate_hz:g} but time runs at {{}} Hz; the time column is used"
        return [Finding("rate", file, text, size=1.0 / dt)]
    return []


def _ranges(file: str, trial: Trajectory) -> list[Finding]:
    found = []
    for j, joint in enumerate(trial.joints):
        speed = trial.velocity[:, j] if trial.velocity_source == "measured" else None
        if size := encoder_range(trial.time, trial.position[:, j], speed):
            times = np.count_nonzero(np.diff(jumps(trial.position[:, j], size)))
            text = f"starts again after {in_words(size)} ({{}} times): unwrap it, as hqpipe logs import does"
            found.append(Finding("wrap", file, text, joint, "position", float(times)))
        for channel in ("position", "position_command"):
            values = getattr(trial, channel)
            top = 0.0 if values is None else _top(values[:, j])
            if _POSITION_RAD < top and not _spins(trial, j, top):
                text = "reaches {}: looks like degrees (×0.0174533), or mm (×0.001) if it slides, unless it spins"
                found.append(Finding("unit", file, text, joint, channel, float(top)))
        for channel in ("pressure_a", "pressure_b"):
            values = getattr(trial, channel)
            if values is not None and (unit := _pressure_unit(values[:, j])):
                text = f"reaches {{}}: looks like {unit}, expected Pa"
                found.append(Finding("unit", file, text, joint, channel, _top(values[:, j])))
    return found


def _spins(trial: Trajectory, j: int, top: float) -> bool:
    """Whether a joint that goes beyond a turn is one that spins, by its own velocity or by how far it goes."""
    if top > _TWO_TURNS_DEG:
        return True
    if trial.velocity_source != "measured" or _top(trial.velocity[:, j]) > _FASTEST_RAD_S:
        return False
    slope = _slope_on(trial.velocity[:, j], differentiate(trial.position[:, [j]], trial.dt)[:, 0])
    return slope is not None and not any(_ALIKE[0] < abs(slope) / factor < _ALIKE[1] for factor in _TOO_LARGE)


def _top(values: np.ndarray) -> float:
    return float(np.quantile(np.abs(values), 0.99))


def _pressure_unit(values: np.ndarray) -> str | None:
    top = _top(values)
    if top == 0 or top >= _PSI_TOP:
        return None
    return "bar (×1e5)" if top < _BAR_TOP else "psi (×6894.76)"


def _shared(file: str, trial: Trajectory) -> list[Finding]:
    """Columns that belong to no joint."""
    told: list[tuple[str, float]] = []
    if "supply/pressure" in trial.extra:
        supply = trial.extra["supply/pressure"]
        if unit := _pressure_unit(supply):
            told.append((f"supply/pressure reaches {{}}: looks like {unit}, expected Pa", _top(supply)))
    for axis in "xyz":
        name = f"base/position/{axis}"
        if name in trial.extra and (top := np.abs(trial.extra[name]).max()) > _BASE_METRES:
            told.append((f"{name} reaches {{}}: looks like mm (×0.001)", float(top)))
    parts = [trial.extra.get(f"base/orientation/{axis}") for axis in "xyzw"]
    if all(p is not None for p in parts):
        norm = np.sqrt(sum(p**2 for p in parts))
        far = float(norm[np.argmax(np.abs(norm - 1.0))])
        if abs(far - 1.0) > 0.01:
            told.append(("base/orientation has a norm of {}, expected 1", far))
    parts = [trial.extra.get(f"imu/linear_acceleration/{axis}") for axis in "xyz"]
    if all(p is not None for p in parts):
        mean = float(np.sqrt(sum(p**2 for p in parts)).mean())
        if 0.8 < mean < 1.3:
            told.append(("imu/linear_acceleration averages {}: looks like g (×9.80665)", mean))
        elif mean < 0.8:
            told.append(("imu/linear_acceleration averages {} m/s², expected gravity to be included", mean))
    return [Finding("unit", file, text, size=size) for text, size in told]


def _ratios(file: str, trial: Trajectory, j: int, joint: str) -> list[Finding]:
    position = trial.position[:, j]
    found = []
    if trial.velocity_source == "measured":
        derived = differentiate(position[:, None], trial.dt)[:, 0]
        told = _slope(trial.velocity[:, j], derived, "the derivative of its position")
        found += [Finding("ratio", file, text, joint, "velocity", slope) for text, slope in told]
    if trial.position_command is not None:
        told = _slope(trial.position_command[:, j], position, "its position")
        found += [Finding("ratio", file, text, joint, "position_command", slope) for text, slope in told]
    return found


def _slope(first: np.ndarray, second: np.ndarray, second_name: str) -> list[tuple[str, float]]:
    """What the slope of one signal on another means, and the slope."""
    slope = _slope_on(first, second)
    if slope is None:
        return []
    for factor, meaning in _FACTORS.items():
        if _ALIKE[0] < slope / factor < _ALIKE[1]:
            return [(f"is {{}} times {second_name}: {meaning}", slope)]
    if slope < 0:
        return [(f"runs against {second_name} (slope {{}}): one of them has its sign flipped", slope)]
    return []


def _slope_on(first: np.ndarray, second: np.ndarray) -> float | None:
    """The slope of one signal on another; None where they go so little together that it says nothing."""
    x, y = second - second.mean(), first - first.mean()
    scale = np.sqrt((x @ x) * (y @ y))
    if scale == 0 or abs(x @ y) < _CORRELATED * scale:
        return None
    return float((x @ y) / (x @ x))
