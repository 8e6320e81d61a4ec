"""The effects that hydraulic cylinders can have, at sizes that scale with the machine; commands run from −1 to 1."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hqpipe.benchmark.cases.cylinder.machine import STEP, CylinderMachine
from hqpipe.benchmark.cases.cylinder.record import references
from hqpipe.benchmark.cases.planted import Built, Planted, one_setting, plant_recipe

Build = Callable[[CylinderMachine, int, float, np.random.Generator], Built]
LAYER = "valve"
SPOOL = "valve_lag"  # of which every valve has its own
JUMP = "opening_jump"  # of the flow just behind the edges of a deadband
LOAD = "orifice_flow"  # what a load on the cylinder does to the flow at the same opening


@dataclass(frozen=True)
class CylinderRecipe:
    """How an effect is planted.

    Attributes:
        name: of the effect. sizes: small, typical, large; or one number. build: as in `cases.electric.effects`.
        outside: no library holds it. pressures: True if it needs them logged, False if they must not be, None if either.
        machine: belongs to all joints by nature. signed: has either sign, the same in all joints.
        loaded: smallest and largest share of the supply's force that the load must take for the effect to show; None for any.
    """

    name: str
    sizes: tuple[float, ...]
    build: Build
    outside: bool = False
    pressures: bool | None = None
    machine: bool = False
    signed: bool = False
    loaded: tuple[float, float] | None = None


def _deadband(machine: CylinderMachine, j: int, size: float, rng: Any) -> Built:
    return {"overlap": size}, {"half_width": size}


def _deadband_with_jump(machine: CylinderMachine, j: int, size: float, rng: Any) -> Built:
    """A driver that steps over the overlap once the command leaves a window: by too little (< 1) or by too much (> 1)."""
    return {"overlap": size, "edge_jump": size * rng.uniform(0.3, 1.7)}, {"half_width": size}


def _dead_time_asymmetry(machine: CylinderMachine, j: int, size: float, rng: Any) -> Built:
    side, steps = ("out" if size > 0.0 else "back"), max(round(abs(size) / STEP), 1)
    return {f"delay_{side}_s": steps * STEP}, {"difference_s": float(np.sign(size)) * steps * STEP}


def _leakage(machine: CylinderMachine, j: int, size: float, rng: Any) -> Built:
    """Past the piston, at the pressure of the supply: a share of the flow at full opening."""
    flow = float(machine.top_speed[j]) * float(machine.axes["area_a"][j])
    return {"worn": size * flow / machine.supply[0]}, {}


def _counterbalance(machine: CylinderMachine, j: int, size: float, rng: Any) -> Built:
    """A load-holding valve that meters the lowering, behind a spool whose edge to the tank is wider by `size`."""
    pressure, load = machine.supply[0], RECIPES["counterbalance"].loaded or (0.0, 0.0)
    drop = rng.uniform(0.1, 0.3) * pressure  # across the open valve at full speed
    fields = {
        "hold_flow": float(machine.top_speed[j] * machine.axes["area_a"][j]) / np.sqrt(drop),
        "hold_setting": 1.3 * load[1] * pressure,  # makers ask for 1.3 times the pressure of the largest load
        "hold_span": rng.uniform(0.8, 1.5) * pressure,  # 50 to 100 bar of pilot pressure from cracking to open
        "hold_ratio": rng.uniform(3.0, 4.5),  # the low ratios that are sold for loads which change
        "meter_out": 1.0 + size,
    }
    return fields, {}


def _delay(machine: CylinderMachine, j: int, size: float, rng: Any) -> Built:
    delay = max(round(size / STEP), 1) * STEP
    return {"delay_s": delay}, {"delay_s": delay}


def _saturation(machine: CylinderMachine, j: int, size: float, rng: Any) -> Built:
    needed = [np.quantile(np.abs(references(machine, trial)[1][:, j]), 0.95) for trial in machine.trials]
    limit = size * float(max(needed)) / float(machine.top_speed[j])
    return {"limit": limit}, {"limit": limit}


def _droop(machine: CylinderMachine, j: int, size: float, rng: Any) -> Built:
    flow = sum(room.speed * float(axis["area_a"]) for room, axis in zip(machine.rooms, machine.axes, strict=True))
    slope, recovery = flow / (size * machine.supply[0]), float(rng.uniform(0.05, 0.4))
    return {"pump_slope": slope, "pump_capacity": slope * recovery}, {"droop": None, "recovery_s": recovery}


def _drift(machine: CylinderMachine, j: int, size: float, rng: Any) -> Built:
    longest = max(trial.seconds for trial in machine.trials)
    return {"drift": size / longest}, {"rate_per_s": size / longest}


def _orifice(machine: CylinderMachine, j: int, size: float, rng: Any) -> Built:
    radius = machine.radius_of(j) if machine.kinds[j] == "revolute" else 1.0
    force = machine.supply[0] * float(machine.axes["area_a"][j])
    return {"load_share": size}, {"effort_max_nm": force * radius}


def _temperature(machine: CylinderMachine, j: int, size: float, rng: Any) -> Built:
    return {"jump_from": rng.uniform(0.35, 0.65), "jump_gain": 1.0 - size}, {}


def _hunting(machine: CylinderMachine, j: int, size: float, rng: Any) -> Built:
    return {"hunting": size, "hunting_hz": rng.uniform(0.1, 0.6)}, {}


RECIPES: dict[str, CylinderRecipe] = {
    recipe.name: recipe
    for recipe in (
        CylinderRecipe("valve_deadband", (0.02, 0.06, 0.15), _deadband),
        CylinderRecipe("valve_deadband_with_jump", (0.02, 0.06, 0.15), _deadband_with_jump),
        CylinderRecipe("command_delay", (0.01, 0.03, 0.08), _delay),
        CylinderRecipe("valve_lag", (0.035, 0.08, 0.2), one_setting("lag", "time_constant_s")),
        CylinderRecipe("flow_saturation", (0.9, 0.75, 0.5), _saturation),
        CylinderRecipe("direction_asymmetry", (0.04, 0.12, 0.25), one_setting("asymmetry", "ratio"), signed=True),
        CylinderRecipe("supply_droop", (0.15, 0.4, 0.65), _droop, pressures=False, machine=True),
        CylinderRecipe("gain_drift", (0.05, 0.15, 0.3), _drift, signed=True),
        CylinderRecipe("orifice_flow", (0.15, 0.3, 0.5), _orifice, pressures=True),
        CylinderRecipe("dead_time_asymmetry", (0.015, 0.04, 0.1), _dead_time_asymmetry, signed=True),
        CylinderRecipe("leakage", (0.05, 0.13, 0.3), _leakage, pressures=True, loaded=(0.3, 0.45)),
        CylinderRecipe("counterbalance", (0.5, 1.5, 4.0), _counterbalance, pressures=True, loaded=(0.25, 0.35)),
        CylinderRecipe("load_dependence", (0.4,), one_setting("load_share"), outside=True, pressures=False),
        CylinderRecipe("sticking_valve", (0.08,), one_setting("stiction"), outside=True),
        CylinderRecipe("hysteresis", (0.06,), one_setting("play"), outside=True),
        CylinderRecipe("dropped_frames", (0.15,), one_setting("lost_frames"), outside=True),
        CylinderRecipe("temperature_jump", (0.25,), _temperature, outside=True),
        CylinderRecipe("gain_hunting", (0.25,), _hunting, outside=True),
    )
}


def with_ordinary(
    machine: CylinderMachine, planted: tuple[Planted, ...], rng: np.random.Generator
) -> tuple[Planted, ...]:
    """The effects with what every such machine has and no layer's base model knows of."""
    return with_lags(machine, with_load(machine, with_jumps(planted), rng), LAYER)


def with_jumps(planted: tuple[Planted, ...]) -> tuple[Planted, ...]:
    """The effects with the jump behind a deadband's edges under its own name, which is right but not asked for."""
    jumps = []
    for one in planted:
        if any(fields.get("edge_jump") for fields in one.settings.values()):
            nothing: dict[str, dict[str, float]] = {joint: {} for joint in one.joints}
            jumps.append(Planted(JUMP, one.layer, False, one.joints, one.scope, None, {}, nothing, ordinary=True))
    return (*planted, *jumps)


def with_lags(machine: CylinderMachine, planted: tuple[Planted, ...], layer: str) -> tuple[Planted, ...]:
    """The effects with the lag that every spool has: one where none was planted is named rightly."""
    lag = {name: float(value) for name, value in zip(machine.names, machine.axes["lag"], strict=True)}
    slow = next((effect for effect in planted if effect.effect == SPOOL), None)
    if slow is None:
        parameters: dict[str, dict[str, float | None]] = {
            name: {"time_constant_s": value} for name, value in lag.items()
        }
        settings = {name: {"lag": value} for name, value in lag.items()}
        return (
            *planted,
            Planted(SPOOL, layer, False, machine.names, "machine", None, parameters, settings, ordinary=True),
        )
    parameters = {name: {"time_constant_s": value} for name, value in lag.items()} | slow.parameters
    everywhere = replace(slow, joints=machine.names, scope="machine", parameters=parameters)
    return tuple(everywhere if effect is slow else effect for effect in planted)


def with_load(machine: CylinderMachine, planted: tuple[Planted, ...], rng: np.random.Generator) -> tuple[Planted, ...]:
    """The effects with the load beside which they show, and so the orifices' flow, if one of them needs it.

    Its arm swings from nearly level to nearly upright, so that the load changes on the way.
    """
    needed = [RECIPES[one.effect].loaded for one in planted if one.effect in RECIPES and RECIPES[one.effect].loaded]
    if not needed or any(one.effect == LOAD for one in planted):
        return planted
    recipe = replace(RECIPES[LOAD], sizes=(float(rng.uniform(*needed[0] or (0.0, 0.0))),))
    turned = {"load_angle": float(rng.uniform(0.45, 0.75))}

    def build(name: str, level: float) -> Built:
        fields, numbers = recipe.build(machine, machine.names.index(name), level, rng)
        return fields | turned, numbers

    load = plant_recipe(recipe, LOAD, LAYER, None, machine.names, machine.names, build, rng, ordinary=True)
    return (*planted, load)


def possible(machine: CylinderMachine, outside: bool = False) -> list[str]:
    """Keys of the recipes that show on this machine's logs."""
    pressures = machine.logger.pressures
    return [
        key for key, recipe in RECIPES.items() if recipe.outside == outside and recipe.pressures in (None, pressures)
    ]


def plant(
    machine: CylinderMachine,
    key: str,
    size: str | None,
    joints: Sequence[str],
    rng: np.random.Generator,
) -> Planted:
    """An effect of a size in some joints, scattered between them."""

    def build(name: str, level: float) -> Built:
        return RECIPES[key].build(machine, machine.names.index(name), level, rng)

    effect = key.removesuffix("_with_jump")
    return plant_recipe(RECIPES[key], effect, LAYER, size, joints, machine.names, build, rng)
