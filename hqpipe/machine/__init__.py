"""Candidate effects: one file each, in the order in which they act; and the compiled chain of them and a base model."""

from __future__ import annotations

import sys
from pathlib import Path

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
    valve_underlap,
    viscous_friction,
)
from hqpipe.machine.effect import Effect
from hqpipe.system.imported_sources import add_import

# A new effect is one file beside this one and one row here; see docs/how-to/add-an-effect.md.
EFFECTS: dict[str, Effect] = {
    module.EFFECT.name: module.EFFECT
    for module in (
        command_delay,
        position_bias,
        integral_action,
        valve_delay,
        flow_saturation,
        valve_lag,
        valve_deadband,
        direction_asymmetry,
        gain_drift,
        supply_droop,
        orifice_flow,
        leakage_drift,
        valve_underlap,
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


def add_effect(effect: Effect, behind: str | None = None) -> None:
    """Put an effect of a module outside the package into the table, before anything is composed of it.

    Args:
        effect: defined in a module that can be imported by its name.
        behind: name of the effect behind which it acts; None for the last one.

    Raises:
        RuntimeError: the chain has been composed already.
    """
    if "hqpipe.machine.layout" in sys.modules:
        raise RuntimeError(f"effect '{effect.name}' comes too late: add it before other modules of hqpipe are imported")
    names = list(EFFECTS)
    at = names.index(behind) + 1 if behind else len(names)
    rows = list(EFFECTS.items())
    EFFECTS.clear()
    EFFECTS.update([*rows[:at], (effect.name, effect), *rows[at:]])
    for module in {law.__module__ for law in effect.laws}:
        add_import(Path(__file__), Path(sys.modules[module].__file__))
