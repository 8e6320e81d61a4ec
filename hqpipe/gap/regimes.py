"""Operating regimes: labels per sample that say what the joint was doing.

A family is a way of cutting every sample into exactly one of its regimes. Thresholds come from the record
itself (percentiles over the trials that are compared), so they need no knowledge of the machine; the
percentiles and times below are assumptions, chosen so that each regime keeps enough samples to be judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.logs.trajectory import Trajectory

STILL_SHARE = 0.02  # of the 99th percentile of |q̇|
FAST_PERCENTILE = 80.0
SATURATION_SHARE = 0.98  # of the largest torque
PLATEAU_SHARE = 0.01  # of all samples must lie on the plateau before it counts as a limit
WIDE_OPEN_PERCENTILE = 95.0
IMPACT_SIGMA = 8.0  # robust standard deviations of dτ/dt; Gaussian noise reaches it once in 1e15 samples
IMPACT_PERCENTILE = 99.0  # of |dτ/dt|: an impact is rare by definition, also where the torque mostly rests
REVERSAL_S = 0.02
IMPACT_S = 0.01
TOUCHDOWN_S = 0.05

Labels = dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Thresholds:
    """What counts as slow, fast, saturated or sudden; every array is (J,).

    Attributes:
        still, fast: rad/s.
        flow: rad/s, Σ|q̇| over the joints, each by its `weight`.
        effort: N·m at which the torque is at its limit, infinite where it shows no plateau.
        error: rad, position error above which the valve is taken for wide open.
        torque_rate: N·m/s.
    """

    still: np.ndarray
    fast: np.ndarray
    flow: float
    effort: np.ndarray
    error: np.ndarray
    torque_rate: np.ndarray
    weight: np.ndarray | float = 1.0


def thresholds(trajectories: Sequence[Trajectory], weight: np.ndarray | float = 1.0) -> Thresholds:
    """Percentiles over all samples of `trajectories`, which need effort and position_command.

    Args:
        weight: (J,) what the joints' speeds count in the flow that they draw.
    """
    speed = np.abs(np.concatenate([t.velocity for t in trajectories]))
    effort = np.abs(np.concatenate([t.effort for t in trajectories]))
    error = np.abs(np.concatenate([t.position_command - t.position for t in trajectories]))
    rate = np.abs(np.concatenate([np.gradient(t.effort, t.time, axis=0) for t in trajectories]))
    top = SATURATION_SHARE * effort.max(axis=0)
    plateau = np.mean(effort >= top, axis=0) >= PLATEAU_SHARE
    return Thresholds(
        still=STILL_SHARE * np.percentile(speed, 99.0, axis=0),
        fast=np.percentile(speed, FAST_PERCENTILE, axis=0),
        flow=float(np.percentile((weight * speed).sum(axis=1), FAST_PERCENTILE)),
        effort=np.where(plateau & (top > 0), top, np.inf),
        error=np.percentile(error, WIDE_OPEN_PERCENTILE, axis=0),
        torque_rate=np.maximum(
            IMPACT_SIGMA * 1.4826 * np.median(rate, axis=0), np.percentile(rate, IMPACT_PERCENTILE, axis=0)
        ),
        weight=weight,
    )


def direction(t: Trajectory, limits: Thresholds) -> Labels:
    """Extending (q̇ > 0), retracting (q̇ < 0) or still (|q̇| below 2 % of the joint's fast speed)."""
    still = np.abs(t.velocity) <= limits.still
    return {
        "extending": ~still & (t.velocity > 0),
        "retracting": ~still & (t.velocity < 0),
        "standstill": still,
    }


def reversal(t: Trajectory, limits: Thresholds) -> Labels:
    """Within 20 ms of a change of the sign of q̇; a passage through standstill counts once, noise never."""
    moving = np.abs(t.velocity) > limits.still
    events = np.zeros(t.velocity.shape, dtype=bool)
    for j in range(t.velocity.shape[1]):
        at = np.flatnonzero(moving[:, j])
        sign = np.sign(t.velocity[at, j])
        turn = np.flatnonzero(sign[1:] != sign[:-1])
        events[(at[turn] + at[turn + 1]) // 2, j] = True
    near = _around(events, t.time, REVERSAL_S, REVERSAL_S)
    return {"reversal": near, "between_reversals": ~near}


def speed(t: Trajectory, limits: Thresholds) -> Labels:
    """|q̇| above or below its 80th percentile."""
    fast = np.abs(t.velocity) > limits.fast
    return {"high_speed": fast, "low_speed": ~fast}


def flow(t: Trajectory, limits: Thresholds) -> Labels:
    """Σ|q̇| over all joints above or below its 80th percentile: equal cylinders share one pump."""
    demand = (limits.weight * np.abs(t.velocity)).sum(axis=1, keepdims=True) > limits.flow
    high = np.broadcast_to(demand, t.velocity.shape)
    return {"high_flow_demand": high, "low_flow_demand": ~high}


def saturation(t: Trajectory, limits: Thresholds) -> Labels:
    """Torque on the plateau of its largest value, or a position error beyond its 95th percentile."""
    wide = np.abs(t.position_command - t.position) > limits.error
    hit = (np.abs(t.effort) >= limits.effort) | wide
    return {"saturation": hit, "no_saturation": ~hit}


def impact(t: Trajectory, limits: Thresholds) -> Labels:
    """Within 10 ms of a torque rate of 8 robust standard deviations, or 50 ms after the leg touches down."""
    jump = np.abs(np.gradient(t.effort, t.time, axis=0)) > limits.torque_rate
    hit = _around(jump, t.time, IMPACT_S, IMPACT_S)
    if contact := _contacts(t):
        down = np.zeros(t.velocity.shape, dtype=bool)
        for j, on in contact.items():
            down[1:, j] = on[1:] & ~on[:-1]
        hit |= _around(down, t.time, 0.0, TOUCHDOWN_S)
    return {"impact": hit, "no_impact": ~hit}


def contact(t: Trajectory, limits: Thresholds) -> Labels:
    """Stance or swing of the leg that the joint belongs to; empty unless every joint's foot is logged."""
    legs = _contacts(t)
    if len(legs) < len(t.joints):
        return {}
    stance = np.stack([legs[j] for j in range(len(t.joints))], axis=1)
    return {"stance": stance, "swing": ~stance}


def time_span(t: Trajectory, limits: Thresholds) -> Labels:
    """Quarter of the recorded trial, by time."""
    phase = (t.start + (t.time - t.time[0])) / t.whole
    quarter = np.minimum((4 * phase).astype(int), 3)
    shape = t.velocity.shape
    return {f"quarter_{i + 1}": np.broadcast_to((quarter == i)[:, None], shape) for i in range(4)}


FAMILIES = {
    "direction": direction,
    "reversal": reversal,
    "speed": speed,
    "flow": flow,
    "saturation": saturation,
    "impact": impact,
    "contact": contact,
    "time_span": time_span,
}


def label(t: Trajectory, limits: Thresholds) -> dict[str, Labels]:
    """Every family that this trial has the channels for; flow only where joints share a supply.

    Returns:
        family → regime → (T, J) bool; within a family each sample has exactly one True.
    """
    names = [name for name in FAMILIES if name != "flow" or len(t.joints) > 1]
    found = {name: FAMILIES[name](t, limits) for name in names}
    return {name: labels for name, labels in found.items() if labels}


def frequency_bands(rate_hz: float) -> dict[str, tuple[float, float]]:
    """Bands of the residual, Hz, up to the Nyquist frequency: motion, structure, valve, sensor noise."""
    nyquist = 0.5 * rate_hz
    edges = [0.0, *[f for f in (5.0, 20.0, 100.0) if f < nyquist], nyquist]
    pairs = zip(edges[:-1], edges[1:], strict=True)
    return {f"{low:.0f}-{high:.0f}_hz": (low, high) for low, high in pairs}


def _contacts(t: Trajectory) -> dict[int, np.ndarray]:
    """Joint index → (T,) contact of its foot: the foot whose name begins the joint's name."""
    feet = {name.split("/")[1]: x > 0.5 for name, x in t.extra.items() if _is_contact(name)}
    found = {}
    for j, joint in enumerate(t.joints):
        for foot in sorted(feet, key=len, reverse=True):
            if joint.startswith(foot):
                found[j] = feet[foot]
                break
    return found


def _is_contact(column: str) -> bool:
    parts = column.split("/")
    return len(parts) == 3 and parts[0] == "foot" and parts[2] == "contact"


def _around(events: np.ndarray, time: np.ndarray, before: float, after: float) -> np.ndarray:
    """True from `before` seconds ahead of each event to `after` seconds behind it; (T, J) bool."""
    dt = float(np.median(np.diff(time)))
    lead, lag = round(before / dt), round(after / dt)
    count = np.cumsum(np.vstack([np.zeros((1, events.shape[1]), dtype=np.int64), events]), axis=0)
    index = np.arange(len(events))
    last = np.minimum(index + lead + 1, len(events))
    first = np.maximum(index - lag, 0)
    return count[last] > count[first]
