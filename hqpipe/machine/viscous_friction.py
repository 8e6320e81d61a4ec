"""Friction in proportion to the speed, between the hydraulics and the load cell.

It rubs on the piston, which the oil on one side and rod and chain on the other hold like two springs, so that the piston
lags behind its joint. With the joint's position q, that of the piston p and the joint's torque x,

    ẋ = K_t (ṗ − q̇),   x = τ_oil − d ṗ,   τ̇_oil = flow − K_o ṗ

give x + T ẋ = τ − b q̇, T = d/(K_o + K_t), where τ is the torque without friction on both springs in series (as k1 and k3
have it), and b = d K_t/(K_o + K_t). So the joint feels everything through a lag of T. With K = k3/Δt, both springs in
series, and the share r = K_o/(K_o + K_t) of their compliance that lies behind the piston, T = r b/K.

A spool that lags by T does the same as friction with b = K T and r = 1 − T l, where 1/l is the time in which the torque leaks
away, and a stiffness of r K: no log of one joint tells the two apart. Only what is known of r does.
"""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import DAMPING, NONE, Block, Constants, Effect, Parameter, Search, State
from hqpipe.machine.valve_lag import follow, lag_share, mean_share

MOST_BEHIND = 0.2
"""Of the compliance, that may lie between piston and joint: a rod or chain at least four times as stiff as the oil, so that the
oil is the spring of the drive. Assumption; the cost: with a softer one a part of strong friction is taken for a lag."""


@njit(cache=True, nogil=True, inline="always")
def viscous(speed: float, damping: float) -> float:
    """Friction torque at a joint speed."""
    return damping * speed


@njit(cache=True, nogil=True, inline="always")
def relaxation(damping: float, behind: float, stiffness: float) -> float:
    """Time constant of the piston between its springs, s.

    Args:
        damping: N·m·s/rad. behind: share of the compliance that lies between piston and joint. stiffness: N·m/rad.
    """
    if behind == 0.0 or stiffness <= 0.0:
        return 0.0
    return behind * damping / stiffness


@njit(cache=True, nogil=True, inline="always")
def braked(lost: float, speed: float, damping: float) -> float:
    """Torque lost beside other friction, N·m."""
    return lost + viscous(speed, damping)


@njit(cache=True, nogil=True, inline="always")
def relaxed(damping: float, behind: float, stiffness: float, dt: float) -> tuple[float, float]:
    """Share of the way to its joint that the piston goes in one sample, and on average over it; see `relaxation`."""
    lag = relaxation(damping, behind, stiffness)
    return lag_share(lag, dt), mean_share(lag, dt)


@njit(cache=True, nogil=True, inline="always")
def fed_late(opening: float, fed: float, share: float, mean: float) -> tuple[float, float]:
    """The opening as it reaches the joint, and its state."""
    return follow(fed, opening, mean), follow(fed, opening, share)


@njit(cache=True, nogil=True, inline="always")
def moved_late(
    velocity: float, sliding: float, piston: float, seal: float, share: float, mean: float
) -> tuple[float, float, float, float]:
    """The speeds of the piston, and their states."""
    return (
        follow(piston, velocity, mean),
        follow(seal, sliding, mean),
        follow(piston, velocity, share),
        follow(seal, sliding, share),
    )


EFFECT = Effect(
    name="viscous_friction",
    layer="actuator",
    parameters=(
        Parameter("nm_s_per_rad", "N·m·s/rad", Search(DAMPING, 0.0, 20.0, (0.05, 0.5, 1.5))),
        Parameter("behind_piston", "1", Search(NONE, 0.0, MOST_BEHIND, (0.1,), counts=False)),
    ),
    meaning="friction grows with speed",
    source="Jelali & Kroll, Hydraulic Servo-systems, 2003",
    experiment="constant-speed motion at several speeds",
    advice="Set the joint's damping in the simulator to this value, and vary it with the oil temperature that you "
    "expect.",
    shows_as=("friction",),
    effort_sources=("load_cell",),
    blocks=(
        Block(
            fed_late,
            ("opening", "fed", "relaxed_share", "relaxed_mean"),
            ("opening", "fed"),
            ("behind_piston",),
            only_delays=True,
        ),
        Block(
            moved_late,
            ("velocity", "sliding", "piston", "seal", "relaxed_share", "relaxed_mean"),
            ("velocity", "sliding", "piston", "seal"),
            ("behind_piston",),
        ),
        Block(braked, ("lost", "sliding", "nm_s_per_rad"), ("lost",), ("nm_s_per_rad",)),
    ),
    states=(State("fed", "opening"), State("piston", "velocity"), State("seal", "sliding")),
    constants=(
        Constants(
            ("relaxed_share", "relaxed_mean"), relaxed, ("nm_s_per_rad", "behind_piston", "oil", "dt"), neutral=1.0
        ),
    ),
    common=True,
)
