"""The law of the paper, eq. (7), in joint space: a valve that feeds a chamber, its leakage, the joint's motion and impacts."""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import Base, Constants, Law


@njit(cache=True, nogil=True, inline="always")
def impact(torque: float, error: float) -> float:
    """Δq · max(−τ sgn Δq, 0) of eq. (7), branch-free: nonzero only while torque and error are opposed."""
    return 0.5 * (error * abs(torque) - torque * abs(error))


@njit(cache=True, nogil=True, inline="always")
def clip(value: float, limit: float) -> float:
    """The value within ± limit."""
    return min(max(value, -limit), limit)


@njit(cache=True, nogil=True, inline="always")
def plain(
    effort: float, opening: float, velocity: float, k1: float, k2: float, k3: float, k4: float, limit: float
) -> float:
    """Torque after one sample, N·m; gains in joint space, per sample."""
    return clip((1.0 - k2) * effort + k1 * opening - k3 * velocity + k4 * impact(effort, opening), limit)


@njit(cache=True, nogil=True, inline="always")
def bent(
    wound: float,
    effort: float,
    opening: float,
    passed: float,
    leak: float,
    even: float,
    speed: float,
    stiff: float,
    k1: float,
    k3: float,
    k4: float,
    limit: float,
) -> float:
    """The same with all that effects may bend, see hqpipe.machine.signals."""
    change = k1 * opening * passed - leak * (effort - even) - k3 * speed + k4 * impact(effort, opening)
    return clip(wound + stiff * change, limit)


@njit(cache=True, nogil=True, inline="always")
def needed(effort: float, leak: float, even: float, speed: float, k3: float) -> float:
    """k1 times the opening that holds a torque, N·m."""
    return leak * (effort - even) + k3 * speed


@njit(cache=True, nogil=True, inline="always")
def oil(k3: float, dt: float) -> float:
    """Stiffness of the oil, N·m/rad."""
    return k3 / dt


HYDRAULIC = Base(
    name="hydraulic",
    parameters={"k1": "N·m/rad", "k2": "1", "k3": "N·m·s/rad", "k4": "1/rad"},
    law=Law(
        bent,
        ("wound", "effort", "opening", "passed", "leak", "even", "speed", "stiff", "k1", "k3", "k4", "effort_limit"),
    ),
    plain=Law(plain, ("effort", "opening", "velocity", "k1", "k2", "k3", "k4", "effort_limit")),
    gain="k1",
    needed=Law(needed, ("effort", "leak", "even", "speed", "k3")),
    signals={"leak": "k2"},
    constants=(Constants(("oil",), oil, ("k3", "dt")),),
)
