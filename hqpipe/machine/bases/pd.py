"""A drive with a proportional and a derivative gain and a limit of its torque."""

from __future__ import annotations

from numba import njit

from hqpipe.machine.bases.hydraulic import clip
from hqpipe.machine.effect import Base, Law


@njit(cache=True, nogil=True, inline="always")
def law(opening: float, passed: float, velocity: float, kp: float, kd: float, limit: float) -> float:
    """Torque, N·m, for a position error `opening` (rad) of which the share `passed` counts, and a speed (rad/s).

    kp: N·m/rad. kd: N·m·s/rad. limit: N·m.
    """
    return clip(kp * opening * passed - kd * velocity, limit)


@njit(cache=True, nogil=True, inline="always")
def plain(opening: float, velocity: float, kp: float, kd: float, limit: float) -> float:
    """The same where the whole error counts."""
    return clip(kp * opening - kd * velocity, limit)


@njit(cache=True, nogil=True, inline="always")
def needed(effort: float, velocity: float, kd: float) -> float:
    """kp times the error that holds a torque, N·m."""
    return effort + kd * velocity


PD = Base(
    name="pd",
    parameters={"kp": "N·m/rad", "kd": "N·m·s/rad"},
    law=Law(law, ("opening", "passed", "velocity", "kp", "kd", "effort_limit")),
    plain=Law(plain, ("opening", "velocity", "kp", "kd", "effort_limit")),
    gain="kp",
    needed=Law(needed, ("effort", "velocity", "kd")),
    lacks=("mean", "lean"),
)
