"""The oracle: an actuator model whose numbers are computed from the reference plant's parameters instead of fitted to its logs.

It is what a perfect identification could find within the class of models: every effect of `hqpipe.machine` that has a
counterpart in the plant, with the plant's own number. Equations: docs/how-to/compare-controllers.md and, for K, G and λ,
docs/theory/actuator-model.md. What the plant does beyond that class is left out, see `LEFT_OUT`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hqpipe.errors import UsageError

EXPONENT = 1.0  # of the Stribeck curve, whose tail is the nearest to the plant's 1/(1 + (v/v_s)²); assumption
LEFT_OUT = (
    "piston and chain mass; slew limit, hysteresis and stiction of the spool; crosstalk; ripple; lost frames; the derivative "
    "gain; how the stiffness of equal chambers changes with the position; flow past the centred spool; sensors; what acts "
    "within a span only"
)
"""What the plant has, or may have, and no effect of the library."""
FRICTION = ("coulomb_friction", "stribeck_friction", "viscous_friction")
"""Effects that act between hydraulics and joint: a torque that is computed from pressures does not show them."""
Columns = dict[str, np.ndarray]


def oracle_actuator(robot: Any, plant: Mapping[str, Any], dt: float, *, friction: bool = True) -> Any:
    """The `hqpipe.actuators.augmented.Augmented` of the plant at the middle of each joint's range.

    Args:
        robot: `RobotSpec`. plant: overrides of `hqpipe.plant.PlantConfig`; those of spans are left out. dt: s, of a sample.
        friction: of the seals; False for the torque that pressure sensors show.

    Raises:
        UsageError: the position loop of the plant has no gain.
    """
    from hqpipe.actuators.augmented import Augmented
    from hqpipe.machine.layout import FIELDS, neutral_row
    from hqpipe.plant.config import PlantConfig
    from hqpipe.plant.parameters import build_schedule

    first = build_schedule(robot, PlantConfig(plant))[0]
    p, m = first.joint, first.machine[0]
    if np.any(p["firmware_position_pid_kp"] <= 0.0):
        raise UsageError("the plant's position loop has no gain", field="plant.firmware.position_pid.kp")
    columns: Columns = {
        **_chambers(p, m, dt),
        **_valve(p),
        **_loop(p),
        **_supply(p, m),
        **(_friction(p, m) if friction else {}),
        "setting_sample_time": np.full(len(p), dt),
        "setting_middle": p["position_middle"],
        "setting_effort_limit": np.asarray(robot.effort_limit),
    }
    table = np.tile(neutral_row(), (len(p), 1))
    names = [f"{owner}_{name}" for owner, name in FIELDS]
    for name, values in columns.items():
        table[:, names.index(name)] = values
    return Augmented(robot.joints, table, dt)


def _modulus(p: Any, position: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """dp/dV of chambers A and B with their hoses, Pa/m³, at an offset from the middle, rad."""
    travel = 0.5 * p["cylinder_stroke"] + p["radius"] * position * np.array([[1.0], [-1.0]])
    area = np.array([p["cylinder_area_a"], p["cylinder_area_b"]])
    volume = np.array([p["cylinder_dead_volume_a"], p["cylinder_dead_volume_b"]]) + area * travel
    a, b = 1.0 / (volume / p["fluid_bulk_modulus"] + p["cylinder_hose_compliance"])
    return a, b


def _chain_stiffness(p: Any) -> np.ndarray:
    """Two taut strands in parallel, the teeth in series, N·m/rad."""
    return p["radius"] ** 2 / (0.5 / p["chain_stiffness"] + 1.0 / p["chain_tooth_stiffness"])


def _oil_stiffness(p: Any, position: np.ndarray | float = 0.0) -> np.ndarray:
    """Both chambers in parallel, valve closed, N·m/rad."""
    a, b = _modulus(p, position)
    return p["radius"] ** 2 * (p["cylinder_area_a"] ** 2 * a + p["cylinder_area_b"] ** 2 * b)


def _stiffness(p: Any, position: np.ndarray | float = 0.0) -> np.ndarray:
    """K: oil and chain in series, N·m/rad."""
    return 1.0 / (1.0 / _oil_stiffness(p, position) + 1.0 / _chain_stiffness(p))


def _limits(p: Any, m: Any) -> tuple[np.ndarray, np.ndarray]:
    """Torque at which an opening above 0, and one below 0, passes nothing, N·m; both positive."""
    a, b = p["cylinder_area_a"], p["cylinder_area_b"]
    high, low = m["supply_pressure"], m["supply_return_pressure"]
    return p["radius"] * (a * high - b * low), p["radius"] * (b * high - a * low)


def _chambers(p: Any, m: Any, dt: float) -> Columns:
    """k1 … k3 of τ̇ = K (G φ Δq − D q̇) − λ τ with inputs held over a sample, and how load, direction and position bend it.

    k4 corrects a root that was made linear where torque and error are opposed; the law of the orifice has the root itself, so
    that it is 0.
    """
    from hqpipe.machine.position_dependent_stiffness import LENGTH

    area_a, area_b, radius = p["cylinder_area_a"], p["cylinder_area_b"], p["radius"]
    stiffness, (a, b) = _stiffness(p), _modulus(p, 0.0)
    mean_pressure = 0.5 * (m["supply_pressure"] + m["supply_return_pressure"])
    density = 1.0 + mean_pressure / p["fluid_bulk_modulus"]  # D: of the oil that motion displaces
    soft = stiffness / _oil_stiffness(p)  # share of the oil in K: the chain gives way, too
    fade = soft * p["cylinder_leakage"] * (area_a * a + area_b * b) / (0.5 * (area_a + area_b))  # λ, 1/s
    held = -np.expm1(-fade * dt) / np.where(fade > 0.0, fade, 1.0)
    held = np.where(fade > 0.0, held, dt)
    up, down = _limits(p, m)
    gain = p["firmware_position_pid_kp"] * p["valve_rated_flow"] / np.sqrt(0.5 * p["valve_rated_drop"])
    gain /= radius**1.5 * np.sqrt(area_a**3 + area_b**3)
    faster = gain * (1.0 + p["valve_asymmetry"]) * np.sqrt(up)  # speed without load per position error, 1/s
    slower = gain * (1.0 - p["valve_asymmetry"]) * np.sqrt(down)
    step = 1e-4  # rad, of the difference quotient
    slope = _unless_equal((_stiffness(p, step) - _stiffness(p, -step)) / (2.0 * step * stiffness))
    lean = (area_a**2 * a - area_b**2 * b) / (area_a**2 * a + area_b**2 * b)
    length = np.divide(-lean, slope, out=np.full(len(p), LENGTH), where=slope != 0.0)
    return {
        "base_k1": stiffness * 0.5 * (faster + slower) * held,
        "base_k2": fade * held,
        "base_k3": stiffness * density * held,
        "orifice_flow_effort_max_nm": 2.0 / (up + down),
        "direction_asymmetry_ratio": _unless_equal((faster - slower) / (faster + slower)),
        "direction_asymmetry_areas": _unless_equal((up - down) / (up + down)),
        "position_dependent_stiffness_slope_per_rad": slope,
        "position_dependent_stiffness_length_rad": length,
        "backlash_gap": p["chain_slack"] / radius,
        "leakage_drift_rate_per_s": np.full(len(p), m["fluid_viscosity_per_kelvin"] * m["fluid_heating_rate"]),
    }


def _unless_equal(difference: np.ndarray) -> np.ndarray:
    """0 for what differs by rounding alone."""
    return np.where(np.abs(difference) < 1e-9, 0.0, difference)


def _valve(p: Any) -> Columns:
    """From the command of the firmware to the opening; openings as position errors, rad."""
    gain, lap = p["firmware_position_pid_kp"], p["valve_overlap"]
    # A land opens by ½ (z + √(z² + ε²)), by ε/2 at its edge; the parabola of half width c opens by c/4 there.
    rounding = np.divide(2.0 * p["valve_null_opening"], lap, out=np.zeros(len(p)), where=lap > 0.0)
    return {
        "valve_delay_delay_s": p["valve_delay"],
        "flow_saturation_limit": gain / np.minimum(1.0, p["valve_opening_limit"]),
        "valve_lag_time_constant_s": 2.0 * p["valve_damping_ratio"] / (2.0 * np.pi * p["valve_bandwidth_hz"]),
        "valve_lag_damping_ratio": 1.0 / p["valve_damping_ratio"] ** 2,
        "valve_deadband_half_width": lap / gain,
        "valve_deadband_rounding": rounding**2,
        "position_bias_rad": p["valve_neutral_offset"] / gain,
        "gain_drift_rate_per_s": p["valve_gain_drift"],
    }


def _loop(p: Any) -> Columns:
    """The firmware beside its proportional gain."""
    gain, integral = p["firmware_position_pid_kp"], p["firmware_position_pid_ki"]
    found = {"command_delay_delay_s": p["firmware_command_delay"]}
    if np.any(integral > 0.0):
        limit = np.maximum(p["firmware_integral_limit"], 1e-9)
        found |= {"integral_action_ki": integral / gain, "integral_action_limit": gain / limit}
    return found


def _supply(p: Any, m: Any) -> Columns:
    """The relief valve, which gives way with the flow that is left over; beyond the flow of the pump the plant sags more."""
    from hqpipe.plant.hydraulics import supply_capacity

    swept = 0.5 * (p["cylinder_area_a"] + p["cylinder_area_b"]) * p["radius"]  # m³/rad
    slope = m["supply_relief_override"] / m["supply_pump_flow"]  # Pa per m³/s
    pressure = m["supply_pressure"] - m["supply_return_pressure"]
    count = len(p)
    return {
        "supply_droop_droop": np.full(count, slope * swept.mean() / pressure),
        "supply_droop_recovery_s": np.full(count, slope * supply_capacity(m, m["supply_pressure"])),
        "setting_flow_per_speed": swept / swept.mean(),
    }


def _friction(p: Any, m: Any) -> Columns:
    """Seals of both pistons, at the joint; what pressure adds to it is that of the mean pressure."""
    radius = p["radius"]
    area = p["cylinder_area_a"] + p["cylinder_area_b"]
    pressed = p["cylinder_load_friction"] * area * 0.5 * (m["supply_pressure"] + m["supply_return_pressure"])
    dry = radius * (2.0 * p["cylinder_coulomb_friction"] + pressed)
    static = 2.0 * radius * p["cylinder_stribeck_friction"]
    behind = _stiffness(p) / _chain_stiffness(p)  # share of the compliance between piston and joint
    return {
        "coulomb_friction_friction_nm": dry,
        "coulomb_friction_asymmetry_nm": 2.0 * radius * p["cylinder_coulomb_asymmetry"],
        "coulomb_friction_presliding_rad": np.maximum(dry + static, 1e-6) / _chain_stiffness(p),
        "stribeck_friction_static_nm": static,
        # Where half of it is left, as in the plant.
        "stribeck_friction_velocity_rad_s": p["cylinder_stribeck_velocity"] / radius / np.log(2.0) ** (1.0 / EXPONENT),
        "stribeck_friction_exponent": np.full(len(p), EXPONENT),
        "viscous_friction_nm_s_per_rad": 2.0 * radius**2 * p["cylinder_viscous_friction"] * (1.0 - behind),
        "viscous_friction_behind_piston": behind,
    }
