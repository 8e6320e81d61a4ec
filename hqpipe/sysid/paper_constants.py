"""What the paper's four coefficients mean as physics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


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
