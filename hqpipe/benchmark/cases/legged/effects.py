"""The effects of legged machines that a library of the diagnosis holds, in sizes of wear, ageing and settings.

Each recipe turns a size into fields of the simulated joint and the numbers that a diagnosis would state. Openings count
in shares of the spool's stroke of about 0.5 mm, so that 1 % of overlap is 5 µm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hqpipe.benchmark.cases.legged.draw import LeggedMachine
from hqpipe.benchmark.cases.planted import Built

BAR = 1.0e5  # Pa
Build = Callable[[LeggedMachine, int, float, np.random.Generator], Built]


@dataclass(frozen=True)
class LeggedRecipe:
    """How an effect is planted.

    Attributes:
        name: as in diagnosis.json. unit: of the sizes. sizes: small, typical, large; or one number. build: fields and numbers.
        layer: of the contract. outside: no library holds it. source: "load_cell" if it shows in that torque alone.
        machine: belongs to all joints by nature. signed: has either sign, the same in all joints.
        spans: may act in a part of a trial.
    """

    name: str
    unit: str
    sizes: tuple[float, ...]
    build: Build
    layer: str = "actuator"
    outside: bool = False
    source: str | None = None
    machine: bool = False
    signed: bool = False
    spans: bool = True


def seal_area(machine: LeggedMachine, j: int) -> float:
    """Mean area of a joint's piston, m²: a friction in bar is a force over it."""
    return float(0.5 * (machine.cylinders["area_a"][j] + machine.cylinders["area_b"][j]))


def arm(machine: LeggedMachine, j: int) -> float:
    """Moment arm of a joint's piston where the robot stands, m."""
    return float(machine.arms[j])


def friction_nm(machine: LeggedMachine, j: int, bar: float) -> float:
    """Torque of a seal whose piston needs this pressure to move."""
    return bar * BAR * seal_area(machine, j) * arm(machine, j)


def _delay(field: str) -> Build:
    def build(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
        before = float(machine.cylinders[field][j])
        late = round((size * 1e-3 + before) * 1e4) * 1e-4 if field == "valve_delay_s" else size * 1e-3
        return {field: late}, {"delay_s": late}

    return build


def _lag(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    """A clogged pilot filter: less bandwidth at the same damping."""
    damping = float(machine.cylinders["damping"][j])
    return {"natural_hz": size, "slew": 1.2 * 2.0 * np.pi * size}, lag_numbers(size, damping)


def lag_numbers(natural_hz: float, damping: float) -> dict[str, float | None]:
    return {"time_constant_s": damping / (np.pi * natural_hz), "natural_hz": natural_hz, "damping_ratio": damping}


def _overlap(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    overlap = 0.01 * size
    return {"overlap": overlap}, {"half_width": overlap / float(machine.cylinders["gain"][j])}


def _limit(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    """A coil driver that no longer gives the current of the full stroke: a share of what the fastest motion needs."""
    needed = float(machine.robot.speed[j] / machine.robot.top_speed[j])
    return {"limit": size * needed}, {"limit": size * needed / float(machine.cylinders["gain"][j])}


def _asymmetry(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    ratio = 0.01 * size
    return {"asymmetry": ratio}, {"ratio": ratio}


def _drift(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    rate = 0.01 * size / max(trial.seconds for trial in machine.trials)
    return {"gain_drift": rate}, {"rate_per_s": rate}


def _leak_drift(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    """Oil that warms by `size` kelvin in the longest trial thins by 3 % a kelvin (SOURCES.md), and leaks more."""
    rate = 0.03 * size / max(trial.seconds for trial in machine.trials)
    return {"leakage_drift": rate}, {"rate_per_s": rate}


def _integral(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    history = rng.uniform(-0.3, 0.3) * 0.1  # opening: what operation before the record has left
    return {"integral": size, "history": history}, {"ki": size}


def _coulomb(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    total = float(machine.cylinders["coulomb"][j]) + size * BAR * seal_area(machine, j)
    return {"coulomb": total}, {"friction_nm": total * arm(machine, j)}


def _stribeck(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    extra, speed = size * BAR * seal_area(machine, j), float(rng.uniform(0.01, 0.03))
    numbers: dict[str, float | None] = {"static_nm": extra * arm(machine, j), "velocity_rad_s": speed / arm(machine, j)}
    return {"stribeck": extra, "stribeck_speed": speed}, numbers


def _viscous(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    """Cold oil and tight guides: `size` bar of the piston at 0.1 m/s."""
    total = float(machine.cylinders["viscous"][j]) + size * BAR * seal_area(machine, j) / 0.1
    return {"viscous": total}, {"nm_s_per_rad": total * arm(machine, j) ** 2}


def _load_friction(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    return {"load_friction": 0.01 * size}, {"coefficient": 0.01 * size}


def _play(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    return {"play": 1e-3 * size}, {"gap": 1e-3 * size / arm(machine, j)}


def _compliance(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    """A loosened bracket or a longer chain: the link is `size` times as stiff as the oil."""
    stiffness = size * float(machine.oil_stiffness[j])
    return {"link_stiffness": stiffness / arm(machine, j) ** 2}, {"stiffness_nm_per_rad": stiffness}


def _hoses(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    """One hose longer, the other replaced by a manifold: oil of `size` half strokes on one side, next to none on the other."""
    joint = machine.cylinders[j]
    half = 0.5 * float(joint["stroke"])
    dead_a, dead_b = 0.1 * half * float(joint["area_a"]), size * half * float(joint["area_b"])
    if rng.random() < 0.5:
        dead_a, dead_b = size * half * float(joint["area_a"]), 0.1 * half * float(joint["area_b"])
    return {"dead_a": dead_a, "dead_b": dead_b}, {"slope_per_rad": stiffness_slope(machine, j, dead_a, dead_b)}


def stiffness_slope(machine: LeggedMachine, j: int, dead_a: float, dead_b: float) -> float:
    """Relative change of the oil's stiffness per rad, in the middle of the joint's motion."""
    joint, r = machine.cylinders[j], arm(machine, j)
    place = r * float(machine.robot.stand[j] - joint["middle"])
    a, b, half = float(joint["area_a"]), float(joint["area_b"]), 0.5 * float(joint["stroke"])
    volume_a, volume_b = dead_a + a * (half + place), dead_b + b * (half - place)
    return r * (b**3 / volume_b**2 - a**3 / volume_a**2) / (a**2 / volume_a + b**2 / volume_b)


def _droop(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    """A worn pump on an accumulator that lost its gas: `size` percent less pressure at a brisk pace."""
    c, robot = machine.cylinders, machine.robot
    pressure = float(machine.supplies[0]["pressure"])
    flow = 0.25 * float(np.sum(0.5 * (c["area_a"] + c["area_b"]) * c["radius"] * robot.speed))
    steady = float(np.sum(c["leakage"])) * 0.1 * pressure
    slope, recovery = (flow + steady) / (0.01 * size * pressure), float(rng.uniform(0.05, 0.4))
    return {"slope": slope, "capacity": slope * recovery}, {"droop": None, "recovery_s": recovery}


def _torque_bias(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    """Zero drift of a pressure transducer or a load cell, in bar on the piston."""
    offset = size * BAR * seal_area(machine, j) * arm(machine, j)
    return {"torque_bias": offset}, {"nm": offset}


def _null(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    """Null shift of the valve by temperature or a worn feedback wire, which an encoder zero of the loop looks like."""
    null = 0.01 * size + float(machine.cylinders["null"][j])
    return {"null": null}, {"rad": null / float(machine.cylinders["gain"][j])}


def _skew(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    return {"skew_s": 1e-3 * size}, {"skew_s": 1e-3 * size}


def _unsigned(machine: LeggedMachine, j: int, size: float, rng: np.random.Generator) -> Built:
    return {"unsigned": 1.0}, {}


RECIPES: dict[str, LeggedRecipe] = {
    recipe.name: recipe
    for recipe in (
        LeggedRecipe("command_delay", "ms", (2.0, 5.0, 12.0), _delay("command_delay_s")),
        LeggedRecipe("valve_delay", "ms more", (1.0, 3.0, 7.0), _delay("valve_delay_s")),
        LeggedRecipe("valve_lag", "Hz", (45.0, 22.0, 10.0), _lag),
        LeggedRecipe("valve_deadband", "% of the spool's stroke", (1.0, 3.0, 8.0), _overlap),
        LeggedRecipe("flow_saturation", "of the opening at the fastest motion", (0.8, 0.55, 0.35), _limit),
        LeggedRecipe("direction_asymmetry", "%", (5.0, 12.0, 25.0), _asymmetry, signed=True),
        LeggedRecipe("gain_drift", "% in a trial", (8.0, 20.0, 40.0), _drift, signed=True, spans=False),
        LeggedRecipe("leakage_drift", "K in a trial", (8.0, 20.0, 35.0), _leak_drift, spans=False),
        LeggedRecipe("integral_action", "1/s", (0.7, 2.0, 5.0), _integral, spans=False),
        LeggedRecipe("supply_droop", "% of the pressure", (5.0, 15.0, 35.0), _droop, machine=True),
        LeggedRecipe(
            "position_dependent_stiffness", "half strokes of oil in a hose", (2.0, 4.0, 8.0), _hoses, spans=False
        ),
        LeggedRecipe("coulomb_friction", "bar", (2.0, 6.0, 15.0), _coulomb, source="load_cell"),
        LeggedRecipe("stribeck_friction", "bar", (3.0, 8.0, 16.0), _stribeck, source="load_cell"),
        LeggedRecipe("viscous_friction", "bar at 0.1 m/s", (1.5, 5.0, 12.0), _viscous, source="load_cell"),
        LeggedRecipe("load_dependent_friction", "%", (4.0, 10.0, 20.0), _load_friction, source="load_cell"),
        LeggedRecipe("backlash", "mm at the piston", (0.15, 0.5, 1.2), _play),
        LeggedRecipe(
            "transmission_compliance", "times the oil's stiffness", (2.0, 0.8, 0.35), _compliance, spans=False
        ),
        LeggedRecipe("torque_bias", "bar", (2.0, 5.0, 12.0), _torque_bias, layer="sensing", signed=True),
        LeggedRecipe("position_bias", "% of the spool's stroke", (1.0, 3.0, 8.0), _null, layer="sensing", signed=True),
        LeggedRecipe("channel_skew", "ms", (1.5, 4.0, 10.0), _skew, layer="sensing"),
        LeggedRecipe("unsigned_sensor", "", (1.0,), _unsigned, layer="sensing"),
    )
}
