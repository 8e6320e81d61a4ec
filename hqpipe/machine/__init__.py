"""Candidate effects: one file each, in the order in which they act."""

from __future__ import annotations

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)
from hqpipe.machine import (
    backlash,
    channel_skew,
    command_delay,
    coulomb_friction,
    direction_asymmetry,
    flow_saturation,
    gain_drift,
    integral_action,
    leakage_drift,
    load_dependent_friction,
    orifice_flow,
    position_bias,
    position_dependent_stiffness,
    stribeck_friction,
    supply_droop,
    torque_bias,
    torque_scale,
    transmission_compliance,
    unsigned_sensor,
    valve_deadband,
    valve_delay,
    valve_lag,
    viscous_friction,
)
from hqpipe.machine.effect import Effect

# A new effect is one file beside this one, one row here, and its place in the loops of hqpipe/machine/loops.
EFFECTS: dict[str, Effect] = {
    module.EFFECT.name: module.EFFECT
    for module in (
        command_delay,
        position_bias,
        integral_action,
        valve_delay,
        valve_lag,
        valve_deadband,
        flow_saturation,
        direction_asymmetry,
        gain_drift,
        supply_droop,
        orifice_flow,
        leakage_drift,
        position_dependent_stiffness,
        transmission_compliance,
        backlash,
        coulomb_friction,
        stribeck_friction,
        viscous_friction,
        load_dependent_friction,
        torque_scale,
        torque_bias,
        unsigned_sensor,
        channel_skew,
    )
}
