"""The sound machine of the withheld-effect cases: one on which the paper's four coefficients are nearly right.

On robot.yaml's machine the orifice, the spool, the seals and the supply are gaps of their own, so that a planted effect
would be one among several. Here each of them is made small by another choice of the same physics, not by switching it
off. What one of them put back alone costs, as held-out free-run error (100 ms windows, all joints, no sensor noise,
N·m; torque 40 N·m RMS on the gantry, 256 in a trot):

| property of robot.yaml's machine | gantry | trot |
|---|---|---|
| none: this machine | 0.1 | 1.1 |
| pistons of 8 cm² on 70 MPa (square root of the orifice) | 0.5 | 8.7 |
| the same on 21 MPa | 1.6 | 33.3 |
| spool of 80 Hz with 250/s slew | 5.5 | 16.7 |
| valve delay of 0.5 ms | 1.2 | 3.2 |
| velocity through the 100 Hz filter, looking back | 4.1 | 14.5 |
| the same through a 400 Hz filter | 2.3 | 8.2 |
| pistons of 2 kg, torque from load cells | 0.6 | 2.2 |
| seals with 60 N dry, 30 N Stribeck, 150 N·s/m, torque from pressures | 0.4 | 1.2 |
| robot.yaml's chain | 0.2 | 1.1 |
| dead volumes like the stroke volume (chambers that change by ±28 % over the range) | 0.2 | 1.1 |
| a pump of 16 l/s instead of 120 l/s | 0.2 | 1.2 |
| encoder of 48 µrad | 0.4 | 1.1 |

Its torque noise of 4 N·m RMS makes the first line 4.1 and 4.2 N·m. The logged velocity is that of the millisecond that
begins at the sample (`interval_velocity`), not the plant's own estimate, which looks back through a filter.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import numpy as np

AREA_RATIO = 8.0  # pistons of 64 cm²: the torque limit R A (pS − pT) is 27 kN·m, the root nearly straight
PRESSURE = 7.0e7  # Pa, the highest that the plant allows
_RETURN = 0.5e6  # Pa, robot.yaml
_FLOW = 3.167e-4 * ((2.1e7 - _RETURN) / (PRESSURE - _RETURN)) ** 0.5  # m³/s: the speed per opening of robot.yaml
TORQUE_NOISE = 4.0  # N·m RMS; assumption: a good pressure or load sensor, 0.4 % of the joint's 950 N·m
_RADIUS, _FIRMWARE_AREA = 0.06, 8.0e-4  # m, m², robot.yaml

BASE: dict[str, Any] = {
    # A pump far above any demand over a stiff relief valve: the supply stays within 0.1 %.
    "supply": {"pressure": PRESSURE, "pump_flow": 0.12},
    # Oil with the stiffness per radian of joint travel, and so the torque per flow, of a stiff machine.
    "fluid": {"bulk_modulus": 5.0e8},
    "cylinder": {
        "area_a": AREA_RATIO * _FIRMWARE_AREA,
        "area_b": AREA_RATIO * _FIRMWARE_AREA,
        "dead_volume_a": 4.8e-3,  # 10 × the mean stroke volume: stiffness within 1 % over the range
        "dead_volume_b": 4.8e-3,
        "leakage": 6.4e-10,  # the torque decays with 10 ms, as with robot.yaml's
        "piston_mass": 0.5,  # light: a load cell does not feel what accelerates the pistons
        "coulomb_friction": 2.0,  # 0.24 N·m at the joint
        "stribeck_friction": 0.0,
        "viscous_friction": 10.0,
    },
    "chain": {"stiffness": 5.0e7, "tooth_stiffness": 1.0e8},  # the stiffest that the plant allows
    "valve": {
        "rated_flow": AREA_RATIO * _FLOW,
        "bandwidth_hz": 1000.0,  # with ζ = 0.2 the spool lags by 0.06 ms
        "damping_ratio": 0.2,
        "slew_rate": 1.0e5,
        "delay": 0.0,
        "null_opening": 0.002,
    },
    "sensors": {
        "encoder_resolution": 1.0e-5,
        "velocity_filter_hz": 400.0,
        "effort_scale": AREA_RATIO,  # the firmware reckons with robot.yaml's piston
        "pressure_noise": TORQUE_NOISE / (2.0**0.5 * _RADIUS * _FIRMWARE_AREA * AREA_RATIO),
        "pressure_resolution": 500.0,
    },
}
"""Overrides for `hqpipe.plant.PlantConfig`; torque from pressures."""

LOAD_CELL: dict[str, Any] = {
    "effort_source": "load_cell",
    "sensors": {"effort_scale": 1.0, "load_cell_noise": TORQUE_NOISE / (2.0**0.5 * _RADIUS)},
}
"""To be merged into BASE: torque from the strands of the chain."""


def sound_machine(effort_source: str = "pressure") -> dict[str, Any]:
    """Overrides of a machine with no effect to find.

    Args:
        effort_source: "pressure" or "load_cell".
    """
    machine = deepcopy(BASE)
    if effort_source == "load_cell":
        machine["effort_source"] = "load_cell"
        machine["sensors"] |= LOAD_CELL["sensors"]
    return machine


def interval_velocity(position: np.ndarray, rate_hz: float) -> np.ndarray:
    """Mean speed over the interval that begins at each sample, rad/s; the last one holds.

    Args:
        position: (T,) rad. rate_hz: of the samples.
    """
    speed = np.diff(position) * rate_hz
    return np.append(speed, speed[-1:])


def logged(
    columns: Mapping[str, np.ndarray], joints: tuple[str, ...], pressures: bool, rate_hz: float
) -> dict[str, Any]:
    """The columns that a case keeps: what most users record, and nothing that gives an effect away.

    Valve commands, supply pressure and oil temperature are left out.

    Args:
        columns: of a `PlantTrial`. joints: their names. pressures: keep the chamber pressures. rate_hz: of the samples.
    """
    kept = ("position", "effort", "position_command", *(("pressure_a", "pressure_b") if pressures else ()))
    chosen = {"time": columns["time"]}
    for joint in joints:
        chosen |= {f"joint/{joint}/{name}": columns[f"joint/{joint}/{name}"] for name in kept}
        chosen[f"joint/{joint}/velocity"] = interval_velocity(columns[f"joint/{joint}/position"], rate_hz)
    chosen |= {
        name: values for name, values in columns.items() if name.startswith(("base/", "foot/", "imu/", "command/"))
    }
    return chosen
