"""What a hydraulic joint should show by its design, in the quantities that are read off a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.identify.constants.quantity import Quantity

UNKNOWN = float("nan")  # spreads to all that needs it


@dataclass(frozen=True)
class Design:
    """One joint driven by two equal pulling cylinders through a chain round a sprocket; what is not known is NaN.

    Attributes:
        radius: R of the sprocket, m. area: A of either piston, m².
        bulk_modulus: β, Pa. volume_a, volume_b: of the chambers with their hoses at the posture in question, m³.
        strand_stiffness, tooth_stiffness: of each chain strand, and of the chain on its sprocket, N/m.
        leakage: between the chambers, m³/s/Pa. pressure: supply less return, Pa.
        valve_gain: of one land, m³/s/√Pa at full opening. null_opening: ε of the land opening ½ (x + √(x² + ε²)).
        opening: mean of √(x² + ε²) in the logs. valve_delay: of amplifier and spool, s. gain: valve opening per rad.
    """

    radius: float
    area: float = UNKNOWN
    bulk_modulus: float = UNKNOWN
    volume_a: float = UNKNOWN
    volume_b: float = UNKNOWN
    strand_stiffness: float = UNKNOWN
    tooth_stiffness: float = UNKNOWN
    leakage: float = UNKNOWN
    pressure: float = UNKNOWN
    valve_gain: float = UNKNOWN
    null_opening: float = UNKNOWN
    opening: float = UNKNOWN
    valve_delay: float = UNKNOWN
    gain: float = UNKNOWN

    @property
    def swept(self) -> float:
        """A R, m³/rad."""
        return self.area * self.radius

    @property
    def volume(self) -> float:
        """V of either chamber: the harmonic mean, which is what two chambers in parallel are as stiff as, m³."""
        return 2.0 / (1.0 / self.volume_a + 1.0 / self.volume_b)

    @property
    def oil_compliance(self) -> float:
        """V / (2 β A² R²): both chambers in parallel, rad per N·m (Merritt 1967, ch. 6)."""
        return self.volume / (2.0 * self.bulk_modulus * self.swept**2)

    @property
    def chain_compliance(self) -> float:
        """Two taut strands in parallel, and the sprocket in series, rad per N·m."""
        return (0.5 / self.strand_stiffness + 1.0 / self.tooth_stiffness) / self.radius**2

    @property
    def slope(self) -> float:
        """Speed lost per torque as the valve's flow falls with the load, at the mean opening, rad/s per N·m.

        A land of gain g at opening o passes g o √Δp, so that both together lose g (o(x) + o(−x)) / (4 √(P/2)) per pressure
        difference of the chambers, with o(x) + o(−x) = √(x² + ε²) (Merritt 1967, ch. 5).
        """
        return self.valve_gain * self.opening / (4.0 * np.sqrt(0.5 * self.pressure)) / self.swept**2


def paper_expected(design: Design) -> dict[str, float]:
    """Quantity → value for `paper_quantities`, whose one leakage holds the mean slope of the valve as well."""
    return _linear(design, design.leakage / design.swept**2 + design.slope)


def chamber_expected(design: Design) -> dict[str, float]:
    """Quantity → value for `chamber_constants`, whose valve has a slope of its own."""
    stiffness = 1.0 / (design.oil_compliance + design.chain_compliance)
    full = design.swept * design.pressure
    return _linear(design, design.leakage / design.swept**2) | {
        "full torque": full,
        "give": full / stiffness,
        "valve time constant": design.valve_delay,
        "null opening": 0.5 * design.null_opening / design.gain,
        "volume slope": design.swept / design.volume * design.oil_compliance * stiffness,
    }


def _linear(design: Design, droop: float) -> dict[str, float]:
    """K, G, c and what follows from them; the bulk modulus and the leakage that went into them."""
    stiffness = 1.0 / (design.oil_compliance + design.chain_compliance)
    gain = design.gain * design.valve_gain * np.sqrt(0.5 * design.pressure) / design.swept
    return {
        "hydraulic stiffness": stiffness,
        "flow gain": gain,
        "leakage": droop,
        "leak time constant": 1.0 / (stiffness * droop),
        "loop stiffness": gain / droop,
        "bulk modulus": design.bulk_modulus,
        "leak coefficient": droop * design.swept**2,
    }


def oil_quantities(found: Sequence[Quantity], design: Design) -> tuple[Quantity, ...]:
    """Bulk modulus of the oil and flow through the leak, by what the design says of area, arm, volumes and chain.

    The chain is taken out of the stiffness: β = V / (2 A² R² (1/K − 1/K_chain)), so that dβ/dK = β / (K (1 − K/K_chain)).
    Empty where the design does not say enough, or the joint is stiffer than its chain.
    """
    rows = []
    for q in found:
        if q.name == "hydraulic stiffness":
            share = 1.0 - q.value * design.chain_compliance  # of the give that is the oil's
            beta = design.volume * q.value / (2.0 * design.swept**2 * share)
            if share > 0.0 and np.isfinite(beta):
                meaning = "β of oil and hoses, the chain taken out of the stiffness"
                rows.append(_scaled(q, "bulk modulus", "Pa", beta, beta / (q.value * share), meaning))
        elif q.name == "leakage" and np.isfinite(design.swept):
            scale = design.swept**2
            meaning = "leakage as a flow: that times (A R)²"
            rows.append(_scaled(q, "leak coefficient", "m³/s/Pa", scale * q.value, scale, meaning))
    return tuple(rows)


def _scaled(quantity: Quantity, name: str, unit: str, value: float, slope: float, meaning: str) -> Quantity:
    half = None if quantity.half_width is None else abs(slope) * quantity.half_width
    return replace(quantity, name=name, unit=unit, value=float(value), half_width=half, meaning=meaning)
