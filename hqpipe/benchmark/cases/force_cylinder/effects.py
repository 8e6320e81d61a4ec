"""The effects that cylinders commanded in force can have.

What is planted at the valve is told in the unit of the command, N or N·m: the opening over the force loop's gain, which is the
error of the force that asks for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqpipe.benchmark.cases.cylinder.effects import with_lags
from hqpipe.benchmark.cases.cylinder.machine import STEP
from hqpipe.benchmark.cases.force_cylinder.machine import ForceMachine, motion
from hqpipe.benchmark.cases.force_cylinder.record import run
from hqpipe.benchmark.cases.planted import Built, Planted, one_setting, plant_recipe

LAYER = "torque"
Build = Callable[[ForceMachine, int, float, np.random.Generator], Built]


@dataclass(frozen=True)
class ForceRecipe:
    """How an effect is planted; fields as of `hqpipe.benchmark.cases.cylinder.effects.CylinderRecipe`."""

    name: str
    sizes: tuple[float, ...]
    build: Build
    outside: bool = False
    pressures: bool | None = None
    machine: bool = False
    signed: bool = False


def _per_opening(machine: ForceMachine, j: int) -> float:
    """N or N·m of error for which the force loop opens the valve fully."""
    return machine.radius_of(j) / float(machine.loops["force_gain"][j])


def _asymmetry(machine: ForceMachine, j: int, size: float, rng: Any) -> Built:
    """A drive that evens out the areas too little or too much; at ratios of 0.5 to 0.84, not at all is 0.04 to 0.17."""
    return {"asymmetry": size}, {"ratio": size}


def _delay(machine: ForceMachine, j: int, size: float, rng: Any) -> Built:
    delay = max(round(size / STEP), 1) * STEP
    return {"delay_s": delay}, {"delay_s": delay}


def _deadband(machine: ForceMachine, j: int, size: float, rng: Any) -> Built:
    """Overlap of the spool, as a share of its travel."""
    return {"overlap": size}, {"half_width": size * _per_opening(machine, j)}


def _saturation(machine: ForceMachine, j: int, size: float, rng: Any) -> Built:
    """A valve that is too small for the fast parts of the motions."""
    needed = [np.quantile(np.abs(run(machine, trial)[:, j, 1]), 0.98) for trial in machine.trials]
    limit = size * float(max(needed)) / float(machine.top_speed[j])
    return {"limit": limit}, {"limit": limit * _per_opening(machine, j)}


def _droop(machine: ForceMachine, j: int, size: float, rng: Any) -> Built:
    speeds = [np.quantile(np.abs(motion(machine.rooms, trial)[1]), 0.95, axis=0) for trial in machine.trials]
    flow = float(np.sum(np.max(speeds, axis=0) * machine.axes["area_a"]))
    slope, recovery = flow / (size * machine.supply[0]), float(rng.uniform(0.05, 0.4))
    return {"pump_slope": slope, "pump_capacity": slope * recovery}, {"droop": None, "recovery_s": recovery}


RECIPES: dict[str, ForceRecipe] = {
    recipe.name: recipe
    for recipe in (
        ForceRecipe("direction_asymmetry", (0.03, 0.08, 0.16), _asymmetry, signed=True),
        ForceRecipe("command_delay", (0.004, 0.012, 0.035), _delay),
        ForceRecipe("valve_deadband", (0.002, 0.007, 0.02), _deadband),
        ForceRecipe("flow_saturation", (0.8, 0.6, 0.4), _saturation),
        ForceRecipe("supply_droop", (0.15, 0.35, 0.6), _droop, pressures=False, machine=True),
        ForceRecipe("valve_lag", (0.004, 0.009, 0.02), one_setting("lag", "time_constant_s")),
        ForceRecipe("sticking_valve", (0.03,), one_setting("stiction"), outside=True),
        ForceRecipe("hysteresis", (0.01,), one_setting("play"), outside=True),
        ForceRecipe("dropped_frames", (0.15,), one_setting("lost_frames"), outside=True),
    )
}


def with_ordinary(machine: ForceMachine, planted: tuple[Planted, ...], rng: np.random.Generator) -> tuple[Planted, ...]:
    """The effects with the lag that every spool has."""
    return with_lags(machine, planted, LAYER)


def possible(machine: ForceMachine, outside: bool = False) -> list[str]:
    """Keys of the recipes that show on this machine's logs."""
    pressures = machine.logger.pressures
    return [
        key for key, recipe in RECIPES.items() if recipe.outside == outside and recipe.pressures in (None, pressures)
    ]


def plant(
    machine: ForceMachine, key: str, size: str | None, joints: Sequence[str], rng: np.random.Generator
) -> Planted:
    """An effect of a size in some joints, scattered between them."""

    def build(name: str, level: float) -> Built:
        return RECIPES[key].build(machine, machine.names.index(name), level, rng)

    return plant_recipe(RECIPES[key], key, LAYER, size, joints, machine.names, build, rng)
