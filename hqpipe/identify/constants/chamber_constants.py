"""What the fitted numbers of the two-chamber model stand for, with uncertainties."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.identify.constants.quantity import Quantity, half_width
from hqpipe.identify.rivals.fit_chambers import ChamberJointFit


@dataclass(frozen=True)
class _Product:
    """factor · Π above / Π below, of fitted parameters."""

    name: str
    unit: str
    meaning: str
    above: tuple[str, ...] = ()
    below: tuple[str, ...] = ()
    factor: float = 1.0


_QUANTITIES = (
    _Product("full torque", "N·m", "T = A R (P_S − P_T)", ("full_torque",)),
    _Product("hydraulic stiffness", "N·m/rad", "K = 2 β A² R² / V, valve closed", ("stiffness",)),
    _Product("give", "rad", "T / K, what the oil yields under full torque", ("full_torque",), ("stiffness",)),
    _Product("flow gain", "1/s", "G, speed without load per position error", ("flow_gain",)),
    _Product("valve time constant", "s", "both lags together", ("valve_lag",), factor=2.0),
    _Product("leakage", "rad/s per N·m", "C / T, speed lost per torque", ("leakage",), ("full_torque",)),
    _Product(
        "leak time constant",
        "s",
        "T / (K C), fading of the torque with the valve closed",
        ("full_torque",),
        ("stiffness", "leakage"),
    ),
    _Product("null opening", "rad", "n, underlap as a position error", ("null_opening",)),
    _Product(
        "loop stiffness",
        "N·m/rad",
        "T G / C, torque per position error at rest, beyond the null opening",
        ("full_torque", "flow_gain"),
        ("leakage",),
    ),
    _Product("volume slope", "1/rad", "ε = A R / V, share of a chamber that a radian sweeps", ("volume_slope",)),
)


def chamber_constants(fit: ChamberJointFit) -> tuple[Quantity, ...]:
    """Physical quantities of one joint; each interval follows from the covariance by first-order propagation.

    Pressure, area and arm, or bulk modulus and volume, stand only in the products named in `Quantity.meaning`; a known
    area and arm take them apart: P = T / (A R), β / V = K / (2 A² R²). What needs a parameter that the logs do not
    determine, or would divide by 0, is left out.
    """
    return tuple(_quantity(q, fit) for q in _QUANTITIES if _told(q, fit))


def _told(product: _Product, fit: ChamberJointFit) -> bool:
    known = all(fit[name].identifiable for name in (*product.above, *product.below))
    return known and all(fit[name].value > 0.0 for name in product.below)


def _quantity(product: _Product, fit: ChamberJointFit) -> Quantity:
    powers = {name: 1 for name in product.above} | {name: -1 for name in product.below}
    value = product.factor * float(np.prod([fit[name].value ** power for name, power in powers.items()]))
    half = None
    if all(fit[name].ci95 for name in powers):  # then none of them is 0
        order = [parameter.name for parameter in fit.parameters]
        slope = np.zeros(len(order))
        for name, power in powers.items():
            slope[order.index(name)] = value * power / fit[name].value
        half = half_width(slope, fit.covariance, fit.freedom)
    return Quantity(product.name, product.unit, value, half, product.meaning)
