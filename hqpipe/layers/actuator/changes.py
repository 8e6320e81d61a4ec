"""What the coefficients of the law may have changed by since an earlier record, as ratios of now to then.

With C the flow gain of the valve, A the lever area, L the leakage and β/V the stiffness of the oil, the rates are
a1 = C β/V Δt, x = L β/V Δt and a3 = A β/V Δt (eqs. (1) to (7) of the paper), and a4 goes with β/V too. In a sample the torque
decays by exp(−x), and so does what comes in during it: k2 = 1 − exp(−x), k_i = a_i k2/x.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from hqpipe.identify.model import Ratio
from hqpipe.machine import EFFECTS
from hqpipe.machine.layout import BASE

MOST_LEAKED = 1.0 - 1e-9  # of the torque in a sample

_OF_THE_MACHINE: dict[str, tuple[str, ...]] = {
    "gain_change": ("k1",),
    "leakage_change": ("k2",),
    "velocity_coupling_change": ("k3",),
    "impact_change": ("k4",),
    "stiffness_change": ("k1", "k2", "k3", "k4"),
}
MULTIPLIES = _OF_THE_MACHINE | {
    name: effect.multiplies
    for name, effect in EFFECTS.items()
    if effect.multiplies and effect.multiplies not in _OF_THE_MACHINE.values()
}
"""Change → the coefficients whose rates it multiplies; also of effects of which no change of the machine says the same."""


def multiply_rates(names: tuple[str, ...], values: np.ndarray, ratio: float) -> None:
    """Multiply the rates of some coefficients by a ratio, in place.

    More leakage within a sample lowers k1, k3 and k4 too.

    Args:
        names: of `BASE`. values: (P,) of which the first are k1 … k4.
    """
    before = float(values[1])
    decay = -np.log1p(-min(before, MOST_LEAKED))
    within = before / decay if decay > 0.0 else 1.0
    for k, name in enumerate(BASE):
        if name in names and name != "k2":
            values[k] *= ratio
    if "k2" in names:
        decay *= ratio
    values[1] = -np.expm1(-decay)
    values[[0, 2, 3]] *= (values[1] / decay if decay > 0.0 else 1.0) / within


def _alike(change: str) -> tuple[str, ...]:
    """Effects that a ratio below 1 stands for as well, as a spring behind the oil softens the two together."""
    return tuple(name for name, e in EFFECTS.items() if name != change and e.multiplies == MULTIPLIES[change])


RATIOS: dict[str, Ratio] = {
    name: Ratio(names, partial(multiply_rates, names), _alike(name)) for name, names in MULTIPLIES.items()
}
