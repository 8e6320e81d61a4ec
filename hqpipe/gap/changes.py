"""Names for what a machine's own coefficients have changed by since an earlier record of it.

Where nothing is known of the machine, k1 … k4 are whatever fits best. Where an earlier record holds them, each change of them
is a candidate like an effect, and its number is the ratio of now to then. A change may move several coefficients by one
ratio. With C the flow gain of the valve, A the lever area, L the leakage and β/V the stiffness of the oil, the rates are
a1 = C β/V Δt, x = L β/V Δt, a3 = A β/V Δt (eqs. (1) to (7) of the paper), and a4 goes with β/V too; of a sample in which the
torque leaks, k2 = 1 − exp(−x) and ki = ai k2/x (`multiply_physics`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from hqpipe.effects import EFFECTS
from hqpipe.effects.effect import NONE, POSITION, Effect, Parameter
from hqpipe.effects.layout import slot, slots
from hqpipe.kernels.augmented_fit import MOST_LEAKED, multiply_physics
from hqpipe.logs.joint_kinds import depends_on_kind

RATIO = "ratio"
MOST_RATIO = 20.0  # and one over it: a coefficient that changed by more is another machine's; assumption
SCALE, STIFFNESS, COMPLIANCE = "torque_scale", "stiffness_change", "transmission_compliance"
ABSENT = 1e-9  # of the natural size of a coefficient: none to speak of, so that a ratio has no meaning


def _change(name: str, meaning: str, source: str, experiment: str) -> Effect:
    ratio = Parameter(RATIO, "1", NONE, 1.0 / MOST_RATIO, MOST_RATIO, (0.5, 2.0), neutral=1.0)
    return Effect(name, "actuator", "core", (ratio,), meaning, source, experiment, (POSITION,))


_PAPER = "eqs. (1) to (7) of the paper"
CHANGES: dict[str, Effect] = {
    change.name: change
    for change in (
        _change(
            "gain_change",
            "k1: the valve passes more or less oil for the same command",
            f"{_PAPER}; the flow of an orifice goes with the root of the supply pressure, Merritt 1967",
            "the same fast motion as then, with the supply pressure logged",
        ),
        _change(
            "leakage_change",
            "k2: more or less oil leaks past seals and lands",
            f"{_PAPER}; Jelali & Kroll, Hydraulic Servo-systems, 2003",
            "hold a constant load for some seconds, and step it",
        ),
        _change(
            "velocity_coupling_change",
            "k3: motion takes more or less torque away than it did",
            _PAPER,
            "push the joint to and fro with its command held",
        ),
        _change(
            "impact_change",
            "k4: impacts that drive the torque against the error are braked differently",
            _PAPER,
            "drops and knocks, as in the earlier record",
        ),
        _change(
            STIFFNESS,
            "k1 to k4 by one ratio: the oil, with what it is enclosed by, is stiffer or softer (air, temperature, hoses)",
            f"{_PAPER}; bulk modulus of oil with air, Merritt 1967",
            "steps of the load while the command is held, so that leakage shows beside gain and motion",
        ),
    )
}
CANDIDATES: dict[str, Effect] = CHANGES | EFFECTS
"""Everything that a diagnosis may name: with an earlier record the changes too."""

FACTORS: dict[str, tuple[str, ...]] = {
    "gain_change": ("k1",),
    "leakage_change": ("k2",),
    "velocity_coupling_change": ("k3",),
    "impact_change": ("k4",),
    SCALE: ("k3", "k1"),
    STIFFNESS: ("k3", "k1", "k2", "k4"),
}
"""Candidate → the coefficients that it multiplies. A torque sensor whose gain changed scales what is in torque units; without
an earlier record nobody could tell."""
ALIKE: dict[str, tuple[str, ...]] = {STIFFNESS: (COMPLIANCE,)}
"""Candidate → what is the same equation by another name: a spring in series makes the oil softer."""


def compared_by_kind(effect: str) -> bool:
    """Whether a number of a candidate is in another unit in a joint that slides than in one that turns."""
    parameters = () if CANDIDATES[effect].machine else CANDIDATES[effect].parameters
    return any(depends_on_kind(p.unit) or p.unit == "command" for p in parameters)


def in_order(effects: Iterable[str]) -> tuple[str, ...]:
    """Changes, then effects in the order of the chain, each once."""
    wanted = set(effects)
    return tuple(name for name in CANDIDATES if name in wanted)


def columns(name: str) -> list[int]:
    """Columns that belong to a candidate; of a change the coefficient that leads."""
    return [slot("base", FACTORS[name][0])] if name in FACTORS else slots(name)


def base_slots(name: str) -> list[int]:
    """Columns of the coefficients that a change multiplies."""
    return [slot("base", coefficient) for coefficient in FACTORS[name]]


def leaders(names: Sequence[str], row: np.ndarray) -> dict[str, int]:
    """Change → the column whose factor is its own in a set; one that the others leave no column has no number of its own.

    Args:
        names: a set. row: (WIDTH,) of the earlier record; what is 0 there leads nothing.
    """
    found: dict[str, int] = {}
    for name in sorted((n for n in names if n in FACTORS), key=lambda n: len(FACTORS[n])):
        free = [column for column in base_slots(name) if column not in found.values() and row[column] != 0.0]
        if free:
            found[name] = free[0]
    return found


def ratios(row: np.ndarray, then: np.ndarray, names: Sequence[str]) -> dict[str, float]:
    """Change → now over then, from a row that the changes of a set were multiplied into.

    Args:
        row, then: (WIDTH,) now and in the earlier record.
    """
    known = list(leaders(names, then))
    if not known:
        return {}
    base = sorted({column for name in known for column in base_slots(name) if then[column] != 0.0})
    share = np.array([[float(column in base_slots(name)) for name in known] for column in base])
    logs = np.log(np.maximum(_rates(row)[base], 1e-300) / _rates(then)[base])
    return dict(zip(known, np.exp(np.linalg.lstsq(share, logs, rcond=None)[0]).tolist(), strict=True))


def multiplied(row: np.ndarray, name: str, factor: float) -> np.ndarray:
    """A copy of a row with one change more."""
    row = row.copy()
    multiply_physics(row, np.array(base_slots(name)), factor)
    return row


def _rates(row: np.ndarray) -> np.ndarray:
    """A copy of a row with the rates in the places of k1 … k4."""
    k1, k2, k3, k4 = (slot("base", name) for name in ("k1", "k2", "k3", "k4"))
    row = row.copy()
    decay = -np.log1p(-min(row[k2], MOST_LEAKED))
    row[[k1, k3, k4]] *= decay / row[k2] if row[k2] > 0.0 else 1.0
    row[k2] = decay
    return row
