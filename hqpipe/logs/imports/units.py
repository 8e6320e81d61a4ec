"""Units that foreign logs come in, and their values in SI."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Unit:
    """A unit.

    Attributes:
        kind: the quantity, one of `KINDS`. factor: its size in the SI unit of that kind. zero: SI value of its 0.
    """

    kind: str
    factor: float
    zero: float = 0.0


# kind → SI unit, as `hqpipe.logs.columns` writes them (temperature in °C, as the log format has it)
KINDS = {
    "angle": "rad",
    "length": "m",
    "angular velocity": "rad/s",
    "velocity": "m/s",
    "acceleration": "m/s²",
    "torque": "N·m",
    "force": "N",
    "pressure": "Pa",
    "time": "s",
    "current": "A",
    "voltage": "V",
    "temperature": "°C",
    "ratio": "1",
}
_DEGREE = np.pi / 180.0
_TURN = 2.0 * np.pi
_G = 9.80665  # m/s², standard gravity (CGPM 1901)
_INCH = 0.0254  # m, exact (international yard and pound agreement, 1959)
_POUND = 0.45359237  # kg, exact (the same)
_LBF = _POUND * _G
_PSI = _LBF / _INCH**2

COUNTS = "counts"
"""Encoder counts: an angle once `counts_per_turn` is known."""

SAMPLES = "samples"
"""Clocks that count samples: a time once their rate is known."""

_TABLE: dict[str, list[tuple[str, float]]] = {
    "angle": [("rad", 1.0), ("mrad", 1e-3), ("deg", _DEGREE), ("°", _DEGREE), ("degrees", _DEGREE), ("degree", _DEGREE)]
    + [("radians", 1.0), ("turn", _TURN), ("turns", _TURN), ("rev", _TURN)],
    "length": [("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("um", 1e-6), ("µm", 1e-6), ("km", 1e3)]
    + [("inch", _INCH), ("in", _INCH), ("ft", 12 * _INCH)],
    "angular velocity": [("rad/s", 1.0), ("mrad/s", 1e-3), ("deg/s", _DEGREE), ("°/s", _DEGREE), ("rpm", _TURN / 60.0)]
    + [("turn/s", _TURN), ("turns/s", _TURN), ("rev/s", _TURN), ("rps", _TURN)],
    "velocity": [("m/s", 1.0), ("cm/s", 1e-2), ("mm/s", 1e-3), ("in/s", _INCH), ("inch/s", _INCH), ("ft/s", 12 * _INCH)]
    + [("km/h", 1 / 3.6), ("m/min", 1 / 60.0), ("mm/min", 1e-3 / 60.0)],
    "acceleration": [("m/s²", 1.0), ("m/s^2", 1.0), ("m/s2", 1.0), ("g", _G), ("mg", 1e-3 * _G)],
    "torque": [("N·m", 1.0), ("Nm", 1.0), ("N.m", 1.0), ("N*m", 1.0), ("kN·m", 1e3), ("kNm", 1e3), ("mN·m", 1e-3)]
    + [
        ("mNm", 1e-3),
        ("N·mm", 1e-3),
        ("Nmm", 1e-3),
        ("N·cm", 1e-2),
        ("Ncm", 1e-2),
        ("kgf·m", _G),
        ("kgf·cm", 1e-2 * _G),
    ]
    + [("kgfcm", 1e-2 * _G), ("lbf·ft", 12 * _INCH * _LBF), ("ft·lbf", 12 * _INCH * _LBF), ("lbf·in", _INCH * _LBF)]
    + [("in·lbf", _INCH * _LBF), ("ozf·in", _INCH * _LBF / 16.0)],
    "force": [("N", 1.0), ("kN", 1e3), ("mN", 1e-3), ("daN", 10.0), ("kgf", _G), ("gf", 1e-3 * _G), ("lbf", _LBF)]
    + [("tf", 1e3 * _G)],
    "pressure": [("Pa", 1.0), ("hPa", 1e2), ("kPa", 1e3), ("MPa", 1e6), ("bar", 1e5), ("mbar", 1e2), ("psi", _PSI)]
    + [("atm", 101325.0), ("kgf/cm²", 1e4 * _G), ("kgf/cm2", 1e4 * _G)],
    "time": [("s", 1.0), ("sec", 1.0), ("seconds", 1.0), ("ms", 1e-3), ("us", 1e-6), ("µs", 1e-6), ("ns", 1e-9)]
    + [("min", 60.0), ("h", 3600.0)],
    "current": [("A", 1.0), ("mA", 1e-3), ("uA", 1e-6), ("µA", 1e-6)],
    "voltage": [("V", 1.0), ("mV", 1e-3), ("kV", 1e3)],
    "ratio": [("1", 1.0), ("%", 1e-2), ("percent", 1e-2), ("duty-%", 1e-2), ("permille", 1e-3), ("‰", 1e-3)],
}
_MICRO = "\N{GREEK SMALL LETTER MU}"  # as some keyboards type it; the table has the micro sign

UNITS: dict[str, Unit] = {
    **{name: Unit(kind, factor) for kind, entries in _TABLE.items() for name, factor in entries},
    **{name.replace("µ", _MICRO): Unit("time" if name == "µs" else "length", 1e-6) for name in ("µs", "µm")},
    _MICRO + "A": Unit("current", 1e-6),
    "°C": Unit("temperature", 1.0),
    "degC": Unit("temperature", 1.0),
    "K": Unit("temperature", 1.0, -273.15),
    "°F": Unit("temperature", 5.0 / 9.0, -160.0 / 9.0),
    "degF": Unit("temperature", 5.0 / 9.0, -160.0 / 9.0),
    COUNTS: Unit("angle", np.nan),
    SAMPLES: Unit("time", np.nan),
}
"""Name → unit; capital letters count, as in mN and MN."""

_ROTARY = {"length": "angle", "velocity": "angular velocity", "force": "torque"}
_CHANNEL_KINDS = {
    "position": ("angle", "length"),
    "velocity": ("angular velocity", "velocity"),
    "effort": ("torque", "force"),
    "position_command": ("angle", "length"),
    "effort_command": ("torque", "force"),
    "valve_command": ("ratio",),
    "duty": ("ratio",),
    "current": ("current",),
    "voltage": ("voltage",),
    "pressure_a": ("pressure",),
    "pressure_b": ("pressure",),
    "temperature": ("temperature",),
}
_SHARED_KINDS = {
    "supply/pressure": ("pressure",),
    "supply/oil_temperature": ("temperature",),
    "supply/voltage": ("voltage",),
    "supply/current": ("current",),
    "base/position": ("length",),
    "base/orientation": ("ratio",),
    "base/linear_velocity": ("velocity",),
    "base/angular_velocity": ("angular velocity",),
    "imu/linear_acceleration": ("acceleration",),
    "command/vx": ("velocity",),
    "command/vy": ("velocity",),
    "command/wz": ("angular velocity",),
}


def to_si(values: np.ndarray, unit: Unit) -> np.ndarray:
    """Values (T,) of a unit in the SI unit of its kind."""
    return values * unit.factor + unit.zero


def kinds_of(column: str) -> tuple[str, ...]:
    """Kinds that a column of a log set may have; () for any, where the format does not know it.

    Args:
        column: its full name, `joint/<name>/<channel>` or a shared one.
    """
    parts = column.split("/")
    if parts[0] == "joint":
        return _CHANNEL_KINDS.get(parts[-1], ())
    if parts[0] == "foot":
        return ("force",) if "force" in parts else ("ratio",)
    return _SHARED_KINDS.get(column) or _SHARED_KINDS.get(column.rpartition("/")[0], ())


def slides(kind: str) -> bool | None:
    """Whether a kind belongs to a joint that slides; None where it says nothing of that."""
    return True if kind in _ROTARY else False if kind in _ROTARY.values() else None
