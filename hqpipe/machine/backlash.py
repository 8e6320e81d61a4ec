"""Lost motion at reversal: while the chain crosses its slack, of the whole width `gap`, no torque is passed."""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import ANGLE, Block, Constants, Effect, Law, Parameter, Search


@njit(cache=True, nogil=True, inline="always")
def transmitted(wound: float, half: float) -> float:
    """Torque passed on, from the torque that the wound-up position would give without slack; N·m each.

    Args:
        wound: stiffness times the relative displacement.
        half: stiffness times half of the gap.
    """
    return wound - min(max(wound, -half), half)


@njit(cache=True, nogil=True, inline="always")
def wound_up(predicted: float, effort: float, half: float, clear: float) -> float:
    """Inverse of `transmitted`: while the chain is slack, where the last position and the motion put it.

    Args:
        predicted: wound-up torque that the model expects.
        effort: logged torque; N·m.
        half: stiffness times half of the gap, N·m.
        clear: a torque beyond ± this must come through a tight chain; less may be noise of its sensor within the gap,
            and counts only on the side where the model expects the chain to be tight, N·m.
    """
    if effort > clear or (effort > 0.0 and predicted > half):
        return effort + half
    if effort < -clear or (effort < 0.0 and predicted < -half):
        return effort - half
    return min(max(predicted, -half), half)


@njit(cache=True, nogil=True, inline="always")
def half_torque(gap: float, oil: float) -> float:
    """Torque at which half of the slack is taken up, N·m."""
    return 0.5 * gap * oil


@njit(cache=True, nogil=True, inline="always")
def felt(effort: float, lost: float, half: float) -> float:
    """Torque that the hydraulics feel where friction takes `lost` in front of a slack chain, N·m."""
    return transmitted(effort - lost, half) + lost


@njit(cache=True, nogil=True, inline="always")
def rewound(expected: float, behind: float, lost: float, half: float, clear: float) -> float:
    """`wound_up` where friction takes `lost` in front of the slack chain, N·m."""
    if half <= 0.0:
        return behind + lost
    return wound_up(expected - lost, behind, half, clear) + lost


EFFECT = Effect(
    name="backlash",
    layer="actuator",
    parameters=(Parameter("gap", "rad", Search(ANGLE, 0.0, 1.0, (0.01, 0.05, 0.2))),),
    meaning="motion is lost at each reversal",
    source="Nordin & Gutman, Automatica 38, 2002: dead-zone model of backlash",
    experiment="slow motion through zero torque in both directions",
    advice="Take up the slack, by chain tension or preload; simulate what stays as a dead zone between drive and "
    "joint.",
    shows_as=("play",),
    slack=True,
    blocks=(
        Block(transmitted, ("inner", "half"), ("inner",), ("gap",)),
        Block(
            felt,
            ("effort", "lost", "half"),
            ("effort",),
            ("gap",),
            undo=Law(rewound, ("expected", "behind", "lost", "half", "clear")),
        ),
    ),
    constants=(Constants(("half",), half_torque, ("gap", "oil")),),
)
