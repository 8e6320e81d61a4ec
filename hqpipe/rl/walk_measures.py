"""Measures of a walk, each a function of arrays: where it went, how its feet were lifted, what it cost, what was believed.

Rows are samples at equal distances of time; callers leave out the first `SETTLING_S` of a walk where a mean is meant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

SETTLING_S = 2.0  # from standing to a steady gait, left out of means; as in the evaluation of a training
SWING_S = 0.05  # a foot without contact for less than this bounces and does not swing; assumption, a sixth of a swing
AT_LIMIT = 0.999  # share of a limit from which a value counts as at it, as in the evaluation of a training


def settled(time: np.ndarray) -> int:
    """First row after the settling time, or in the middle of a walk that is too short to settle."""
    return int(np.searchsorted(time, min(SETTLING_S, 0.5 * time[-1])))


def heading(orientation: np.ndarray) -> np.ndarray:
    """(T,) rad to the left of world x, without jumps, of (T, 4) unit quaternions xyzw."""
    x, y, z, w = np.asarray(orientation).T
    return np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def course(time: np.ndarray, position: np.ndarray, order: tuple[float, float]) -> dict[str, float]:
    """How a walk kept the straight line that was ordered from where it stood, with its heading held along world x.

    Args:
        time: (T,) s. position: (T, 2) m, world. order: vx, vy in m/s, not both zero.

    Returns:
        distance (m) along the line; speed along it, mean after settling, and speed_error (m/s); drift, the largest distance
        from the line (m). NaN where the walk ended at once.
    """
    wanted = float(np.hypot(*order))
    along = np.asarray(order) / wanted
    track = np.asarray(position) - position[0]
    ahead, beside = track @ along, track @ np.array([-along[1], along[0]])
    first = settled(time)
    speed = _rate(ahead[first:], time[first:])
    return {
        "distance": float(ahead[-1]),
        "speed": speed,
        "speed_error": abs(speed - wanted),
        "drift": float(np.abs(beside).max()),
    }


def wander(position: np.ndarray) -> float:
    """m, the largest distance over ground from the start of (T, 2) m: the drift of a robot that is to stay where it is."""
    return float(np.linalg.norm(np.asarray(position) - position[0], axis=1).max())


def order_error(
    time: np.ndarray, body_velocity: np.ndarray, heading_: np.ndarray, order: tuple[float, float, float]
) -> dict[str, float]:
    """How far the mean motion, seen from the trunk, is from the order.

    Args:
        time: (T,) s. body_velocity: (T, 2) m/s forwards and to the left in the base frame. heading_: (T,) rad, see `heading`.
        order: vx, vy (m/s), wz (rad/s).

    Returns:
        velocity_error (m/s), distance of the mean velocity from (vx, vy); yaw_rate (rad/s), mean, and yaw_error.
    """
    miss = np.asarray(body_velocity).mean(axis=0) - order[:2]
    rate = _rate(heading_, time)
    return {"velocity_error": float(np.hypot(*miss)), "yaw_rate": rate, "yaw_error": abs(rate - order[2])}


def swing_lifts(height: np.ndarray, contact: np.ndarray, rate_hz: float) -> list[np.ndarray]:
    """Per foot the lift of each whole swing, m: the highest point of the sole above the higher of its two footholds.

    Args:
        height: (T, F) m of the soles over any level. contact: (T, F) bool. rate_hz: of the rows.
    """
    least = round(SWING_S * rate_hz)
    feet = []
    for z, on in zip(np.asarray(height).T, np.asarray(contact, dtype=bool).T, strict=True):
        change = np.flatnonzero(np.diff(on.astype(int)))
        spans = [(a, b + 1) for a, b in zip(change[:-1], change[1:], strict=True) if on[a] and b - a >= least]
        feet.append(np.array([z[a : b + 1].max() - max(z[a], z[b]) for a, b in spans]))
    return feet


def clearance(height: np.ndarray, contact: np.ndarray, rate_hz: float) -> float:
    """m, the lift of a typical swing (median) of the foot that is lifted least; NaN if a foot never swings."""
    return min(float(np.median(lifts)) if lifts.size else np.nan for lifts in swing_lifts(height, contact, rate_hz))


@dataclass(frozen=True)
class Schedule:
    """When the feet of a steady gait touch the ground.

    Attributes:
        frequency: strides per second, mean over the feet. duty: (F,) share of the time on the ground.
        phase: (F,) of the touch-downs, in strides of the first foot, within [0, 1); a trot of LF, RF, LH, RH has 0, ½, ½, 0.
        regularity: (F,) 1 where each stride has the same phase, 0 where it is random.
    """

    frequency: float
    duty: np.ndarray
    phase: np.ndarray
    regularity: np.ndarray


def contact_schedule(contact: np.ndarray, rate_hz: float) -> Schedule:
    """Schedule of (T, F) bool; what lasts less than `SWING_S` is a bounce. Phases are NaN where a foot makes no stride."""
    steady = np.stack(
        [_without_bounces(on, round(SWING_S * rate_hz)) for on in np.asarray(contact, dtype=bool).T], axis=1
    )
    touches = [np.flatnonzero(~on[:-1] & on[1:]) for on in steady.T]
    strides = touches[0]
    mean = np.full(len(touches), np.nan, dtype=complex)
    for foot, touch in enumerate(touches):
        within = touch[(touch >= strides[0]) & (touch < strides[-1])] if len(strides) > 1 else touch[:0]
        if within.size:
            number = np.searchsorted(strides, within, side="right") - 1
            share = (within - strides[number]) / (strides[number + 1] - strides[number])
            mean[foot] = np.exp(2j * np.pi * share).mean()
    return Schedule(
        frequency=float(np.mean([len(touch) for touch in touches])) * rate_hz / len(steady),
        duty=steady.mean(axis=0),
        phase=np.angle(mean) / (2.0 * np.pi) % 1.0,
        regularity=np.abs(mean),
    )


def _without_bounces(on: np.ndarray, least: int) -> np.ndarray:
    """(T,) bool without changes that are taken back in fewer than `least` samples."""
    steady = on.copy()
    change = np.flatnonzero(np.diff(on)) + 1
    for start, stop in zip(change[:-1], change[1:], strict=True):
        if stop - start < least:
            steady[start:stop] = steady[start - 1]
    return steady


def impact(force: np.ndarray, weight: float) -> dict[str, float]:
    """How hard the ground strikes one foot, in weights of the robot.

    Args:
        force: (T, F, 3) N, ground on feet. weight: N.

    Returns:
        peak_force, and force_p99, which 99 % of the samples of the most loaded foot lie below.
    """
    most = np.linalg.norm(force, axis=2).max(axis=1) / weight
    return {"peak_force": float(most.max()), "force_p99": float(np.quantile(most, 0.99))}


def rms(error: np.ndarray) -> float:
    """Root mean square of everything in `error`, in its unit."""
    return float(np.sqrt(np.mean(np.square(error))))


def share_at_limit(value: np.ndarray, limit: np.ndarray | float) -> float:
    """Share of the samples (T, J) whose magnitude is at `limit` (J,) or beyond."""
    return float((np.abs(value) >= AT_LIMIT * np.asarray(limit)).mean())


def lean(gravity: np.ndarray) -> float:
    """rad, the largest tilt of the trunk against gravity: (T, 3) unit vectors in the base frame, (0, 0, −1) upright."""
    return float(np.arccos(np.clip(-np.asarray(gravity)[:, 2], -1.0, 1.0)).max())


def estimator_error(
    names: tuple[str, ...], believed: np.ndarray, truth: Mapping[str, np.ndarray]
) -> dict[str, float | None]:
    """Error of x̃_t against what holds at the same moments.

    Args:
        names: of the columns as term/element. believed: (N, m) in physical units. truth: name → (N,).

    Returns:
        estimate_velocity (m/s), RMS length of the error, and estimate_velocity_bias (m/s), length of the mean error;
        estimate_tilt (rad), RMS angle between the directions of gravity;
        estimate_height, estimate_foot_height (m), RMS; estimate_contact, share of wrong foot contacts. None for what the
        policy does not tell.
    """
    result: dict[str, float | None] = dict.fromkeys((*_ESTIMATED.values(), _BIAS))
    for term, measure in _ESTIMATED.items():
        columns = [i for i, name in enumerate(names) if name.split("/")[0] == term]
        if not columns:
            continue
        told = np.asarray(believed)[:, columns]
        true = np.stack([truth[names[i]] for i in columns], axis=1)
        if term == "base_linear_velocity":
            result[measure] = rms(np.linalg.norm(told - true, axis=1))
            result[_BIAS] = float(np.linalg.norm((told - true).mean(axis=0)))
        elif term == "gravity":
            result[measure] = rms(_angle(told, true))
        elif term == "foot_contact":
            result[measure] = float(((told > 0.5) != (true > 0.5)).mean())
        else:
            result[measure] = rms(told - true)
    return result


_ESTIMATED = {
    "base_linear_velocity": "estimate_velocity",
    "gravity": "estimate_tilt",
    "base_height": "estimate_height",
    "foot_contact": "estimate_contact",
    "foot_height": "estimate_foot_height",
}  # term of the state's layout → measure
_BIAS = "estimate_velocity_bias"


def _angle(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(N,) rad between vectors (N, 3) of any length."""
    return np.arctan2(np.linalg.norm(np.cross(first, second), axis=1), (first * second).sum(axis=1))


def _rate(value: np.ndarray, time: np.ndarray) -> float:
    """Mean rate of change from the first row to the last; NaN over no time."""
    span = time[-1] - time[0]
    return float((value[-1] - value[0]) / span) if span > 0.0 else float("nan")
