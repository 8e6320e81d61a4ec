"""The square root of the orifice equation, which k2 linearises: a loaded valve passes less, √(1 − sgn(u) τ/τ_max)."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import EFFORT, Block, Constants, Effect, Parameter, Search

LEAST = 0.1  # largest torque over τ_max: below, the root bends the flow by 5 % at most, left to k2; assumption


@njit(cache=True, nogil=True, inline="always")
def balance(areas: float, inverse_limit: float) -> float:
    """Torque, N·m, at which the pressures of both sides are equal, so that nothing leaks from one to the other; arguments as
    of `orifice`. Mean pressure: half of the supply."""
    return areas / inverse_limit if inverse_limit > 0.0 else 0.0


@njit(cache=True, nogil=True, inline="always")
def orifice(
    opening: float, effort: float, inverse_limit: float, loss: float, mean: float, lean: float, areas: float
) -> float:
    """Flow per opening, 1 for an unloaded valve at full supply.

    Args:
        opening: its sign decides which way the load acts.
        effort: load torque.
        inverse_limit: 1/τ_max.
        loss: relative loss of supply pressure.
        mean: what the chambers' mean pressure is off by from half the supply, relative to that; only read beside `lean`.
        lean: share by which the chamber is stiffer that an opening above 0 feeds; 0 for equal chambers, whose mean pressure
            is taken to be half of the supply at any time.
        areas: (A₊ − A₋)/(A₊ + A₋) of the sides whose pressures raise and lower the torque: the supply moves a larger load with
            the larger side; 0 for equal ones.
    """
    load = effort * inverse_limit
    signed = load / (1.0 + areas) if opening > 0.0 else -load / (1.0 - areas)
    if lean == 0.0:
        return np.sqrt(max(1.0 - loss - signed, 0.0))
    fed = 0.5 + (0.5 * lean if opening > 0.0 else -0.5 * lean)
    drained = np.sqrt(max(1.0 + mean - signed, 0.0))
    return fed * np.sqrt(max(1.0 - 2.0 * loss - mean - signed, 0.0)) + (1.0 - fed) * drained


@njit(cache=True, nogil=True, inline="always")
def narrowed(
    passed: float,
    opening: float,
    effort: float,
    inverse_limit: float,
    loss: float,
    mean: float,
    strayed: float,
    lean: float,
    areas: float,
) -> float:
    """Flow per opening beside what else bends it; arguments as of `orifice`. strayed: of the mean pressure, for good."""
    return passed * orifice(opening, effort, inverse_limit, loss, mean + strayed, lean, areas)


EFFECT = Effect(
    name="orifice_flow",
    layer="actuator",
    parameters=(Parameter("effort_max_nm", "N·m", Search(EFFORT, 0.0, 1.0, (0.05, 0.3), least=LEAST), inverse=True),),
    meaning="flow falls with the square root of the pressure that the load leaves over",
    source="eq. (1) of the paper; Merritt, Hydraulic Control Systems, 1967",
    experiment="motion with and against a large load: squats, or weights on the gantry",
    advice="Use the square-root law in the simulator; with measured pressures the valve driver can divide the "
    "command by the same root.",
    blocks=(
        Block(
            narrowed,
            (
                *("passed", "opening", "effort", "effort_max_nm", "loss", "mean"),
                *("position_dependent_stiffness.strayed", "lean", "direction_asymmetry.areas"),
            ),
            ("passed",),
            ("effort_max_nm", "loss", "lean"),
        ),
    ),
    constants=(Constants(("even",), balance, ("direction_asymmetry.areas", "effort_max_nm"), when=("effort_max_nm",)),),
)
