"""Columns of a row of an augmented actuator under short names, and the constants of its loops."""

from __future__ import annotations

from typing import Final

from hqpipe.machine.layout import BASE, SETTING, slot, slots

POSITION: Final = 0
TORQUE: Final = 1
CORE: Final = 0  # what is computed anew; beside the core, any of
FOLLOW: Final = 1  # where the friction points before each window
COMMAND: Final = 2  # the command side
SLIDE: Final = 4  # what travel leaves of the direction of the friction
SUPPLY: Final = 8  # loss of supply pressure
MOTION: Final = 16  # position and speed at the instant of the torque
ALL: Final = 31
HELD_PASSES: Final = 10  # of the search for what an integrator holds
HELD_CLOSE: Final = 1e-4  # relative: where it ends
LEAST_PASSED: Final = 0.05  # of the inner torque that friction lets pass, however large its coefficient; assumption
MODES: Final = {"position": POSITION, "torque": TORQUE}

K1, K2, K3, K4 = (slot("base", name) for name in BASE)
DT, MIDDLE, CLEAR, LIMIT, PER_SPEED, PER_OPENING, SPEED_LATE, HELD = (slot("setting", name) for name in SETTING)
DELAY, SKEW, BIAS = slot("command_delay", "delay_s"), slot("channel_skew", "skew_s"), slot("position_bias", "rad")
VALVE_DELAY = slot("valve_delay", "delay_s")
KI, WINDUP = slot("integral_action", "ki"), slot("integral_action", "limit")
LAG, SPRINGY = slots("valve_lag")  # the second is one over the square of the damping ratio
BAND, ROUNDING = slot("valve_deadband", "half_width"), slot("valve_deadband", "rounding")
SATURATION = slot("flow_saturation", "limit")
(ASYMMETRY, AREAS), DRIFT = slots("direction_asymmetry"), slot("gain_drift", "rate_per_s")
LEAK_DRIFT = slot("leakage_drift", "rate_per_s")
DROOP, RECOVERY, PUMP = slots("supply_droop")
ORIFICE = slot("orifice_flow", "effort_max_nm")
SLOPE, UNEVEN, EXCHANGE, COMPRESSION = slots("position_dependent_stiffness")
COMPLIANCE, GAP = slot("transmission_compliance", "stiffness_nm_per_rad"), slot("backlash", "gap")
COULOMB, COULOMB_ASYMMETRY = slot("coulomb_friction", "friction_nm"), slot("coulomb_friction", "asymmetry_nm")
PRESLIDING = slot("coulomb_friction", "presliding_rad")
STATIC, STRIBECK = slot("stribeck_friction", "static_nm"), slot("stribeck_friction", "velocity_rad_s")
EXPONENT = slot("stribeck_friction", "exponent")
(VISCOUS, BEHIND), LOAD = slots("viscous_friction"), slot("load_dependent_friction", "coefficient")
OFFSET = slot("torque_bias", "nm")
