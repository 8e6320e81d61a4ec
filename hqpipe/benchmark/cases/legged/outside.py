"""What is wrong with legged machines that no library of the diagnosis holds, and what every such machine has."""

from __future__ import annotations

import numpy as np

from hqpipe.benchmark.cases.legged.draw import LeggedMachine
from hqpipe.benchmark.cases.legged.effects import LeggedRecipe, arm, lag_numbers, stiffness_slope
from hqpipe.benchmark.cases.planted import Built, Numbers, one_setting

NOTABLE_SLOPE = 0.1  # of the oil's stiffness over the free motion: below it a slope is not listed; assumption
STIFF_LINK = 8.0  # times the oil's stiffness: above it a link is not listed as compliant; assumption
NOTABLE_DELAY = 4.0e-4  # s, of a valve's dead time; assumption
NOTABLE_RATIO = 1e-3  # of unequal areas: the torque at equal pressures is then off by as much as noise of a good sensor


def _cold(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    """Cold oil in a hose passes less until the warm oil arrives, somewhere in the trial."""
    seconds = min(trial.seconds for trial in machine.trials)
    return {"cold": size, "cold_until": float(rng.uniform(0.3, 0.7)) * seconds}, {}


def _hunting(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    return {"hunting": size, "hunting_hz": float(rng.uniform(0.15, 0.6))}, {}


def _ripple(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    """A pump whose flow pulsates, as with a hunting regulator; it would move the pressure by `size` if it did not answer."""
    return {"ripple": size, "ripple_hz": float(rng.uniform(4.0, 15.0))}, {}


def _eccentric(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    return {"ripple_angle": np.radians(size)}, {}


OUTSIDE: dict[str, LeggedRecipe] = {
    recipe.name: recipe
    for recipe in (
        LeggedRecipe("sticking_valve", "of the spool's stroke", (0.04,), one_setting("stiction"), outside=True),
        LeggedRecipe("hysteresis", "of the spool's stroke", (0.03,), one_setting("hysteresis"), outside=True),
        LeggedRecipe("dropped_commands", "of the time", (0.25,), one_setting("lost_share"), outside=True),
        LeggedRecipe("hose_swelling", "Pa", (4.0e6,), one_setting("air"), outside=True),
        LeggedRecipe("cold_oil", "of the flow", (0.35,), _cold, outside=True, spans=False),
        LeggedRecipe("gain_hunting", "of the flow", (0.3,), _hunting, outside=True),
        LeggedRecipe("crosstalk", "of the next joint's opening", (0.15,), one_setting("crosstalk"), outside=True),
        LeggedRecipe("pump_ripple", "of the pressure", (0.12,), _ripple, outside=True, machine=True),
        LeggedRecipe("eccentric_encoder", "degrees", (0.5,), _eccentric, outside=True, spans=False),
        LeggedRecipe("stale_samples", "of the time", (0.3,), one_setting("stale_share"), layer="sensing", outside=True),
    )
}


def ordinary(machine: LeggedMachine) -> dict[str, dict[str, Numbers]]:
    """Effect → joint → numbers of what this machine has without being faulty, as far as it is notable."""
    c, names = machine.cylinders, machine.names
    cell = machine.logger.effort_source == "load_cell"
    found: dict[str, dict[str, Numbers]] = {}

    def put(effect: str, j: int, numbers: Numbers) -> None:
        found.setdefault(effect, {})[names[j]] = numbers

    for j in range(len(names)):
        r, oil = arm(machine, j), float(machine.oil_stiffness[j])
        put("valve_lag", j, lag_numbers(float(c["natural_hz"][j]), float(c["damping"][j])))
        put("orifice_flow", j, {"effort_max_nm": float(machine.top_torque[j])})
        put("position_bias", j, {"rad": float(c["null"][j] / c["gain"][j])})
        if c["overlap"][j] < 0.0:
            put("valve_underlap", j, {"half_width": float(-c["overlap"][j] / c["gain"][j])})
        if c["valve_delay_s"][j] >= NOTABLE_DELAY:
            put("valve_delay", j, {"delay_s": float(c["valve_delay_s"][j])})
        lean = float((c["area_a"][j] - c["area_b"][j]) / (c["area_a"][j] + c["area_b"][j]))
        if abs(lean) >= NOTABLE_RATIO:
            out, back = np.sqrt(1.0 + lean), np.sqrt(1.0 - lean)
            put("direction_asymmetry", j, {"ratio": float((out - back) / (out + back))})
        link = float(c["link_stiffness"][j]) * r**2
        if link < STIFF_LINK * oil:
            put("transmission_compliance", j, {"stiffness_nm_per_rad": link})
        slope = stiffness_slope(machine, j, float(c["dead_a"][j]), float(c["dead_b"][j]))
        if abs(slope) * float(machine.robot.swing[j]) >= NOTABLE_SLOPE:
            put("position_dependent_stiffness", j, {"slope_per_rad": slope})
        if cell:
            put("coulomb_friction", j, {"friction_nm": float(c["coulomb"][j]) * r})
            put("viscous_friction", j, {"nm_s_per_rad": float(c["viscous"][j]) * r**2})
            speed = float(c["stribeck_speed"][j]) / r
            put("stribeck_friction", j, {"static_nm": float(c["stribeck"][j]) * r, "velocity_rad_s": speed})
    return found
