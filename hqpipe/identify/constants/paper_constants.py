"""What the paper's four coefficients mean as physics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.identify.constants.quantity import Quantity, half_width
from hqpipe.identify.paper_model.results import JointFit


@dataclass(frozen=True)
class PaperConstants:
    """Physical quantities behind eq. (7) of one joint.

    Attributes:
        stiffness: K, of the oil at the joint with closed valve, N·m/rad.
        flow_gain: G, speed without load per position error, 1/s.
        droop: speed lost per torque, rad/s per N·m: leakage, and the valve's flow–pressure slope.
        relaxation: 1/s at which torque fades with the valve closed.
        loop_stiffness: torque per position error at rest, N·m/rad.
        bulk_over_volume: β/V of the oil in one chamber, Pa/m³; None without the area.
        full_force: F at which eq. (7)'s correction for impacts is normalised, N; None if k4 is 0.
    """

    stiffness: float
    flow_gain: float
    droop: float
    relaxation: float
    loop_stiffness: float
    bulk_over_volume: float | None
    full_force: float | None


def paper_constants(k: np.ndarray, radius: float, dt: float, area: float | None = None) -> PaperConstants:
    """Translate k1 … k4 back.

    Continuity of two equal chambers behind a valve with a linear characteristic is, at the joint,

        τ̇ = K (G Δq − c τ − q̇),   K = 2 β A² R² / V                                     (Merritt 1967, ch. 6)

    Held inputs over a sample solve it exactly: with λ = K c,

        τ_next = e^(−λ dt) τ + (1 − e^(−λ dt)) / λ · K (G Δq − q̇)

    so that, beside eq. (7),

        λ = −ln(1 − k2) / dt,   K = k3 R² λ / k2  (→ k3 R² / dt),   G = k1 / k3,   c = λ / K,
        τ/Δq at rest = G / c = k1 R² / k2,   β/V = K / (2 A² R²),   F = k3 / (k4 dt)

    The last sets the paper's B A² / (V F) = k4 beside its B A² / V = k3 / dt, with the volume V of one chamber.

    Args:
        k: (4,) k1 N/m, k2, k3 N·s/m, k4 1/m. radius: R, m (1 if the joint has none, k1 then in N·m/rad).
        dt: s. area: A of the piston, m², for β/V.
    """
    k1, k2, k3, k4 = (float(value) for value in k)
    relaxation = -np.log1p(-k2) / dt if k2 < 1.0 else np.inf
    rate = relaxation / k2 if 0.0 < k2 < 1.0 else 1.0 / dt
    stiffness = k3 * radius**2 * rate
    return PaperConstants(
        stiffness=stiffness,
        flow_gain=k1 / k3 if k3 > 0 else np.inf,
        droop=relaxation / stiffness if stiffness > 0 else np.inf,
        relaxation=float(relaxation),
        loop_stiffness=k1 * radius**2 / k2 if k2 > 0 else np.inf,
        bulk_over_volume=stiffness / (2.0 * (area * radius) ** 2) if area else None,
        full_force=k3 / (k4 * dt) if k4 > 0 else None,
    )


def paper_quantities(fit: JointFit, radius: float, dt: float) -> tuple[Quantity, ...]:
    """The constants of one joint in the names of `hqpipe.identify.constants.chamber_constants`, with 95 % intervals.

    Intervals follow from the covariance of the coefficients by the delta method. Each quantity is a product of powers of k1,
    k3, k4 and of functions of k2, so that its relative derivatives are exact:

        K: λ'/λ − 1/k2 and 1/k3        G: 1/k1 and −1/k3        c: 1/k2 and −1/k3        1/λ: −λ'/λ
        k1 R² / k2: 1/k1 and −1/k2     F: 1/k3 and −1/k4        with λ'/λ = 1 / ((1 − k2) λ dt)

    What needs a coefficient that the logs do not determine, or would divide by 0, is left out, and nothing is said where k2
    is not between 0 and 1; one that rests on a physical bound leaves the quantity without an interval.

    Args:
        fit: of the joint, or of all that share their coefficients. radius: R, m. dt: s.
    """
    k = np.array([c.value if c.identifiable else np.nan for c in fit.coefficients])
    if not 0.0 < k[1] < 1.0:
        return ()
    found, rate = paper_constants(np.nan_to_num(k), radius, dt), -1.0 / ((1.0 - k[1]) * np.log1p(-k[1]))
    one, two, three, four = np.diag(1.0 / np.where(k > 0.0, k, np.nan))
    fade = rate * np.eye(4)[1]
    rows = (
        ("hydraulic stiffness", "N·m/rad", found.stiffness, fade - two + three, "K, valve closed"),
        ("flow gain", "1/s", found.flow_gain, one - three, "G, speed without load per position error"),
        ("leakage", "rad/s per N·m", found.droop, two - three, "c, speed lost per torque, in the valve as well"),
        ("leak time constant", "s", 1.0 / found.relaxation, -fade, "1/λ, fading of the torque with the valve closed"),
        ("loop stiffness", "N·m/rad", found.loop_stiffness, one - two, "G / c, torque per position error at rest"),
        ("impact force", "N", found.full_force, three - four, "F, at which the correction for impacts is normalised"),
    )
    return tuple(_quantity(fit, *row) for row in rows if row[2] is not None and np.isfinite(row[3]).all())


def _quantity(fit: JointFit, name: str, unit: str, value: float, relative: np.ndarray, meaning: str) -> Quantity:
    used = relative != 0.0
    pressed = any(c.at_bound for c, needed in zip(fit.coefficients, used, strict=True) if needed)
    half = None
    if fit.covariance is not None and not pressed:
        half = half_width(value * relative, fit.covariance, fit.freedom)
    return Quantity(name, unit, float(value), half, meaning)
