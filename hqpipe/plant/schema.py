"""Every number of the reference plant: path, unit, default, range and meaning.

A field without a default is a property of the machine and must stand in robot.yaml; one with a default is an
effect that a sound machine does not show. `hqpipe.plant.config` reads both against this table, and the
compiled code reads them by name as `path` with "_" for ".".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

INF = float("inf")


@dataclass(frozen=True)
class Field:
    """One number of the plant; `scope` is "joint" (one value per joint) or "machine"."""

    path: str
    unit: str
    scope: str
    meaning: str
    default: float | None = None
    lower: float = 0.0
    upper: float = INF  # every field sets one

    @property
    def column(self) -> str:
        return self.path.replace(".", "_")


def _joint(path: str, unit: str, meaning: str, **limits: float) -> Field:
    return Field(path, unit, "joint", meaning, **limits)


def _machine(path: str, unit: str, meaning: str, **limits: float) -> Field:
    return Field(path, unit, "machine", meaning, **limits)


# Bounds lie well beyond any machine of legs, from a toy to one of many tonnes: outside of them a value is a slip of the
# hand or a wrong unit, and the simulation would end in NaN.
FIELDS: tuple[Field, ...] = (
    # fluid
    _joint("fluid.bulk_modulus", "Pa", "effective, oil with hoses and dissolved air", lower=1e7, upper=1e11),
    _machine(
        "fluid.temperature",
        "°C",
        "oil at the start; all other numbers hold at this temperature",
        lower=-40.0,
        upper=200.0,
    ),
    _machine("fluid.bulk_modulus_per_kelvin", "1/K", "relative loss of stiffness", upper=0.02),
    _machine("fluid.viscosity_per_kelvin", "1/K", "exponent: leakage grows, viscous friction falls", upper=0.1),
    _machine("fluid.heating_rate", "K/s", "oil warms through the trial", default=0.0, lower=-5.0, upper=5.0),
    # supply
    _machine("supply.pressure", "Pa", "with the pump idling over the relief valve", lower=1e6, upper=7e7),
    _machine("supply.return_pressure", "Pa", "tank line", upper=5e6),
    _machine("supply.pump_flow", "m³/s", "of the one pump", lower=1e-6, upper=1.0),
    _machine("supply.relief_override", "Pa", "pressure from cracking to full pump flow", lower=1e4, upper=1e8),
    _machine("supply.accumulator_volume", "m³", "gas volume at precharge", lower=1e-6, upper=10.0),
    _machine("supply.accumulator_precharge", "Pa", "gas", lower=1e5, upper=7e7),
    _machine("supply.gas_exponent", "1", "adiabatic", lower=1.0, upper=2.0),
    _machine("supply.line_volume", "m³", "oil in the supply lines", lower=1e-6, upper=10.0),
    _machine(
        "supply.ripple_pressure",
        "Pa",
        "amplitude of the pump's pulsation at the valves",
        default=0.0,
        upper=1e7,
    ),
    _machine("supply.ripple_hz", "Hz", "of that pulsation", default=9.0, upper=500.0),
    # the pair of pulling cylinders of a joint
    _joint("cylinder.area_a", "m²", "piston that pulls the joint to positive angles", lower=1e-7, upper=1.0),
    _joint("cylinder.area_b", "m²", "piston that pulls it back", lower=1e-7, upper=1.0),
    _joint("cylinder.stroke", "m", "between the end stops", lower=1e-3, upper=10.0),
    _joint("cylinder.stop_stiffness", "N/m", "end stop", lower=1e5, upper=1e8),
    _joint("cylinder.dead_volume_a", "m³", "chamber A at zero stroke, hose included", lower=1e-6, upper=1.0),
    _joint("cylinder.dead_volume_b", "m³", "chamber B, likewise", lower=1e-6, upper=1.0),
    _joint("cylinder.hose_compliance", "m³/Pa", "extra swelling of each hose", default=0.0, upper=1e-10),
    _joint("cylinder.piston_mass", "kg", "each, with its rod", lower=0.2, upper=1e4),
    _joint("cylinder.leakage", "m³/s/Pa", "laminar, from one chamber to the other", upper=1e-6),
    _joint("cylinder.coulomb_friction", "N", "each piston", upper=1e6),
    _joint(
        "cylinder.coulomb_asymmetry", "N", "more when q rises, less when it falls", default=0.0, lower=-1e4, upper=1e4
    ),
    _joint("cylinder.stribeck_friction", "N", "extra at rest, each piston", upper=1e6),
    _joint("cylinder.stribeck_velocity", "m/s", "where half of the extra is left", lower=1e-4, upper=100.0),
    _joint("cylinder.viscous_friction", "N·s/m", "each piston", upper=1e7),
    _joint("cylinder.load_friction", "1", "friction per pressure force on the piston", default=0.0, upper=0.5),
    # chain and sprocket
    _joint("chain.stiffness", "N/m", "each strand", lower=1e4, upper=5e7),
    _joint("chain.damping", "N·s/m", "each strand", upper=1e7),
    _joint("chain.mass", "kg", "the part round the sprocket", lower=0.2, upper=1e4),
    _joint("chain.tooth_stiffness", "N/m", "chain on sprocket and shaft", lower=1e4, upper=1e8),
    _joint("chain.tooth_damping", "N·s/m", "likewise", upper=1e7),
    _joint(
        "chain.slack",
        "m",
        "clearance between chain and sprocket, at the pitch radius",
        default=0.0,
        upper=0.05,
    ),
    # 4-way servo valve; an opening of 1 is the rated stroke
    _joint("valve.rated_flow", "m³/s", "at full opening and rated_drop; 1e-20 seals it", lower=1e-20, upper=1.0),
    _joint("valve.rated_drop", "Pa", "over both lands", lower=1e5, upper=1e8),
    _joint("valve.bandwidth_hz", "Hz", "natural frequency of the spool", lower=0.5, upper=1000.0),
    _joint("valve.damping_ratio", "1", "of the spool", lower=0.05, upper=5.0),
    _joint("valve.slew_rate", "1/s", "greatest spool speed", lower=0.1, upper=1e5),
    _joint(
        "valve.null_opening",
        "opening",
        "rounding of the lands: what passes with the spool centred",
        lower=1e-4,
        upper=1.0,
    ),
    _joint(
        "valve.overlap",
        "opening",
        "spool lap on each side: small openings pass nothing",
        default=0.0,
        upper=0.9,
    ),
    _joint("valve.neutral_offset", "opening", "null shift", default=0.0, lower=-0.5, upper=0.5),
    _joint("valve.opening_limit", "opening", "greatest opening", default=1.0, lower=0.01, upper=1.0),
    _joint(
        "valve.asymmetry",
        "1",
        "flow × (1 + a) for positive openings, × (1 − a) else",
        default=0.0,
        lower=-0.9,
        upper=0.9,
    ),
    _joint(
        "valve.gain_drift",
        "1/s",
        "relative change of the flow gain as the driver warms",
        default=0.0,
        lower=-0.2,
        upper=0.2,
    ),
    _joint("valve.delay", "s", "from firmware to spool drive", upper=0.2),
    _joint("valve.stiction", "opening", "static friction of the spool as spring travel", default=0.0, upper=0.5),
    _joint("valve.hysteresis", "opening", "half width, magnetic", default=0.0, upper=0.5),
    _joint(
        "valve.crosstalk",
        "1",
        "share of the previous joint's command in the same leg",
        default=0.0,
        lower=-1.0,
        upper=1.0,
    ),
    # firmware, 1 kHz; the valve command lies in −1…1
    _joint("firmware.position_pid.kp", "1/rad", "valve command per position error", upper=1e6),
    _joint("firmware.position_pid.ki", "1/(rad·s)", "integrator", upper=1e6),
    _joint("firmware.position_pid.kd", "s/rad", "on the measured velocity", upper=1e6),
    _joint("firmware.torque_pid.kp", "1/(N·m)", "valve command per torque error", upper=1e3),
    _joint("firmware.torque_pid.ki", "1/(N·m·s)", "integrator", upper=1e3),
    _joint("firmware.torque_pid.kd", "s/(N·m)", "on the measured torque", upper=1e3),
    _joint("firmware.integral_limit", "opening", "bound of the integrator", upper=1.0),
    _joint(
        "firmware.command_delay",
        "s",
        "transport of the joint command to the firmware",
        default=0.0,
        upper=0.2,
    ),
    _machine("bus.drop_rate", "1/s", "bursts in which command frames are lost", default=0.0, upper=100.0),
    _machine("bus.drop_duration", "s", "of a burst; the last command is held", default=0.03, upper=1.0),
    # sensors of a joint
    _joint("sensors.encoder_resolution", "rad", "one count", upper=1.0),
    _joint("sensors.position_bias", "rad", "encoder zero", default=0.0, lower=-1.0, upper=1.0),
    _joint("sensors.velocity_filter_hz", "Hz", "low-pass on the differentiated position", lower=1.0, upper=1e6),
    _joint("sensors.pressure_noise", "Pa", "standard deviation", upper=1e8),
    _joint("sensors.pressure_resolution", "Pa", "one count", upper=1e8),
    _joint("sensors.load_cell_noise", "N", "standard deviation, each strand", upper=1e6),
    _joint("sensors.load_cell_resolution", "N", "one count", upper=1e6),
    _joint("sensors.effort_bias", "N·m", "offset", default=0.0, lower=-1e3, upper=1e3),
    _joint("sensors.effort_scale", "1", "gain error", default=1.0, lower=-10.0, upper=10.0),
    _joint("sensors.effort_delay", "s", "the logged effort is this much late", default=0.0, upper=0.1),
    _joint("sensors.effort_unsigned", "0 or 1", "1: the logged effort lost its sign", default=0.0, upper=1.0),
    # inertial measurement unit
    _machine("imu.gyro_noise", "rad/s", "standard deviation", upper=100.0),
    _machine("imu.gyro_bias", "rad/s", "on every axis", default=0.0, lower=-1.0, upper=1.0),
    _machine("imu.accelerometer_noise", "m/s²", "standard deviation", upper=1e3),
    _machine("imu.orientation_noise", "rad", "standard deviation of the attitude filter, every axis", upper=3.2),
)

BY_PATH = {field.path: field for field in FIELDS}

# Columns that no user sets: joint geometry from the robot, and the piston area that the firmware believes in.
DERIVED = ("radius", "position_middle", "position_lower", "position_upper", "firmware_area")


def joint_dtype() -> np.dtype:
    """One float64 per joint field, plus the derived columns."""
    names = [field.column for field in FIELDS if field.scope == "joint"]
    return np.dtype([(name, np.float64) for name in (*names, *DERIVED)], align=True)


def machine_dtype() -> np.dtype:
    """One float64 per field of the whole machine."""
    return np.dtype([(field.column, np.float64) for field in FIELDS if field.scope == "machine"], align=True)
