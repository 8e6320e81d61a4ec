"""The effects that servos and arms can have, at sizes that scale with the machine.

A torque is given as a share of the typical torque of the joint's motion, so that 0.15 of it is what a gear of average quality
loses; see docs/theory/joint-cases.md for what each size adds to the log.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqpipe.benchmark.cases.electric.machine import OUTPUT_SHARE, STEP, ElectricMachine
from hqpipe.benchmark.cases.electric.record import commanded
from hqpipe.benchmark.cases.planted import Built, Numbers, Planted, plant_recipe

Build = Callable[[ElectricMachine, int, float, np.random.Generator], Built]
CONTACT_RATE = 2000.0  # rad/s, of the rotor against the flanks of a loose gear; assumption: faster than any log shows
LOAD_RATE = 600.0  # rad/s, likewise of the load, so that the engine's step resolves it


@dataclass(frozen=True)
class Recipe:
    """How an effect is planted.

    Attributes:
        name: of the effect. families: in which machines. sizes: small, typical, large; or one number.
        build: (machine, joint, size, generator) → fields of the joint, and numbers as in diagnosis.json.
        layer: where it is found; None for that of the machine. outside: no library holds it.
        needs: what logset.yaml must state. needs_duty: PWM drives only. hides_with: channel beside which it does not count.
        machine: belongs to all joints by nature. signed: has either sign, the same in all joints.
    """

    name: str
    families: tuple[str, ...]
    sizes: tuple[float, ...]
    build: Build
    layer: str | None = None
    outside: bool = False
    needs: frozenset[str] = frozenset()
    needs_duty: bool = False
    hides_with: str = ""
    machine: bool = False
    signed: bool = False


def _coulomb(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    torque = size * machine.torque[j]
    return {"coulomb": torque}, {"friction_nm": torque, "asymmetry_nm": 0.0}


def _stribeck(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    torque, speed = size * machine.torque[j], rng.uniform(0.08, 0.2) * machine.rooms[j].speed
    return {"static": torque, "stribeck": speed}, {"static_nm": torque, "velocity_rad_s": speed}


def _viscous(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    damping = size * machine.torque[j] / (0.5 * machine.rooms[j].speed)
    return {"viscous": damping}, {"nm_s_per_rad": damping}


def _load_dependent(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    return {"load_share": size}, {"coefficient": size}


def _armature(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    inertia = size * machine.inertia[j]
    return {"armature": inertia}, {"kg_m2": inertia}


def _backlash(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    gap = size * (machine.rooms[j].swing if machine.kinds[j] == "prismatic" else 1.0)
    rotor = float(machine.joints["rotor"][j])
    light = OUTPUT_SHARE * machine.links[j].armature or float(machine.inertia[j])
    stiffness = min(rotor * CONTACT_RATE**2, light * LOAD_RATE**2)
    fields = {
        "flexible": 1.0,
        "sensed_at_load": 0.0,
        "gap": gap,
        "stiffness": stiffness,
        "transmission_damping": 0.4 * (stiffness * rotor) ** 0.5,
    }
    return fields, {"gap": gap}


def _compliance(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    stiffness = machine.torque[j] / (size * (machine.rooms[j].swing if machine.kinds[j] == "prismatic" else 1.0))
    rotor = float(machine.joints["rotor"][j])
    # 3 % of critical damping of the load on the spring, as of harmonic drives; assumption
    damping = 0.06 * (stiffness * machine.inertia[j]) ** 0.5 + 0.02 * (stiffness * rotor) ** 0.5
    fields = {"flexible": 1.0, "stiffness": stiffness, "transmission_damping": damping, "sensed_at_load": 0.0}
    return fields, {"stiffness_nm_per_rad": stiffness}


def _torque_limit(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    limit = size * expected_peak(machine, j)
    return {"limit": limit}, {"effort_max_nm": limit}


def _voltage_sag(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    volts, drawn = machine.supply[0], 0.0
    for k in range(len(machine.names)):
        stall = machine.joints["volt_torque"][k] * volts
        peak = expected_peak(machine, k)
        drawn += min(peak / stall, 1.0) * peak / machine.joints["torque_constant"][k]
    ohm = size * volts / drawn
    return {"source_ohm": ohm}, {"ohm": ohm}


def _gain_error(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    return {"gain_ratio": 1.0 - size}, {"ratio": 1.0 - size}


def _position_bias(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    return {"bias": size}, {"rad": size}


def _command_delay(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    delay = max(round(size / STEP), 1) * STEP
    return {"delay_s": delay}, {"delay_s": delay}


def _spring(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    room = machine.rooms[j]
    stiffness, neutral = size * machine.torque[j] / room.swing, room.middle + rng.uniform(-0.5, 0.5) * room.swing
    return {"spring": stiffness, "neutral": neutral}, {"nm_per_rad": stiffness, "neutral_rad": neutral}


def _channel_skew(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    late = size * max(1.0 / machine.logger.rate_hz, 8e-3)
    return {"skew_s": late}, {"skew_s": late}


def _unsigned(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    return {"unsigned": 1.0}, {}


def _ripple(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    periods = float(rng.integers(5, 16)) / machine.rooms[j].swing  # radians of phase a radian of travel
    return {"ripple_nm": size * machine.torque[j], "ripple_periods": 2.0 * np.pi * periods / 2.0}, {}


def _lost_frames(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    return {"lost_frames": size}, {}


def _stale_rows(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    return {"stale_rows": size}, {}


def _hysteresis(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    return {"hysteresis_nm": size * machine.torque[j], "hysteresis_rad": 0.3 * machine.rooms[j].swing}, {}


def _push(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    start = rng.uniform(0.2, 0.7)  # share of the trial
    sign = float(rng.choice([-1.0, 1.0]))
    return {
        "push_nm": sign * size * machine.torque[j],
        "push_from": start,
        "push_until": start + rng.uniform(0.08, 0.2),
    }, {}


def _hunting(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    return {"hunting": size, "hunting_hz": rng.uniform(0.3, 1.5)}, {}


def _temperature(machine: ElectricMachine, j: int, size: float, rng: Any) -> Built:
    return {"warm_from": rng.uniform(0.35, 0.65), "warm_torque": 1.0 - size, "warm_friction": 0.5}, {}


def payload(machine: ElectricMachine, size: float) -> Planted:
    """A load on the last link that is heavier by `size` times its mass: what changes between two recordings."""
    name, link = machine.names[-1], machine.links[-1]
    layer = "servo" if machine.family == "servo" else "joint_motion"
    numbers: Numbers = {"mass_kg": size * link.load_mass, "com_m": link.length}
    scope = "machine" if len(machine.names) == 1 else "joint"
    settings = {name: {"load_factor": 1.0 + size}}
    return Planted("payload", layer, False, (name,), scope, "typical", {name: numbers}, settings)


_BOTH = ("servo", "arm")
RECIPES: dict[str, Recipe] = {
    recipe.name: recipe
    for recipe in (
        Recipe("command_delay", ("servo",), (0.006, 0.016, 0.04), _command_delay),
        Recipe("coulomb_friction", _BOTH, (0.05, 0.15, 0.35), _coulomb),
        Recipe("stribeck_friction", _BOTH, (0.10, 0.25, 0.5), _stribeck),
        Recipe("viscous_friction", ("servo",), (0.08, 0.25, 0.6), _viscous, needs=frozenset({"drive"})),
        Recipe("viscous_friction_of_arm", ("arm",), (0.05, 0.15, 0.4), _viscous),
        Recipe("load_dependent_friction", _BOTH, (0.06, 0.15, 0.3), _load_dependent),
        Recipe("armature", ("servo",), (0.1, 0.3, 0.8), _armature, needs=frozenset({"load", "drive"})),
        Recipe("backlash", _BOTH, (0.006, 0.018, 0.045), _backlash),
        Recipe("transmission_compliance", ("servo",), (0.01, 0.03, 0.07), _compliance, needs=frozenset({"drive"})),
        Recipe("torque_limit", ("servo",), (0.8, 0.6, 0.45), _torque_limit),
        Recipe(
            "voltage_sag", ("servo",), (0.1, 0.25, 0.45), _voltage_sag, needs_duty=True, hides_with="duty", machine=True
        ),
        Recipe("gain_error", ("servo",), (0.1, 0.25, 0.45), _gain_error, needs=frozenset({"drive"})),
        Recipe("position_bias", ("servo",), (0.008, 0.025, 0.06), _position_bias, signed=True),
        Recipe("spring", ("arm",), (0.08, 0.25, 0.6), _spring),
        Recipe("channel_skew", ("arm",), (0.4, 1.2, 3.5), _channel_skew, layer="sensing"),
        Recipe("unsigned_sensor", ("arm",), (1.0,), _unsigned, layer="sensing"),
        Recipe("torque_ripple", _BOTH, (0.2,), _ripple, outside=True),
        Recipe("dropped_frames", ("servo",), (0.15,), _lost_frames, outside=True),
        Recipe("stale_samples", ("arm",), (0.15,), _stale_rows, outside=True),
        Recipe("hysteresis", _BOTH, (0.3,), _hysteresis, outside=True),
        Recipe("outside_push", _BOTH, (0.6,), _push, outside=True),
        Recipe("gain_hunting", ("servo",), (0.45,), _hunting, outside=True),
        Recipe("temperature_jump", _BOTH, (0.25,), _temperature, outside=True),
    )
}


def expected_peak(machine: ElectricMachine, j: int) -> float:
    """99.5 % quantile of the torque, N·m, that joint `j` of the machine without effects would need over all its trials.

    The loop is taken as the linear second-order system that it nearly is.
    """
    from scipy.signal import cont2discrete, lfilter

    inertia = float(machine.inertia[j])
    highest = 0.0
    for trial in machine.trials:
        kp = float(machine.joints["kp"][j]) * trial.gain / inertia
        kd = float(machine.joints["kd"][j] + machine.joints["back_emf"][j]) / inertia
        command = commanded(machine, trial)[1][::4, j]
        system = cont2discrete(([kp], [1.0, kd, kp]), 4 * STEP, method="bilinear")
        position = lfilter(system[0].ravel(), system[1], command - command[0]) + command[0]
        acceleration = np.gradient(np.gradient(position, 4 * STEP), 4 * STEP)
        torque = inertia * acceleration + machine.gravity[j] * np.sin(position)
        highest = max(highest, float(np.quantile(np.abs(torque), 0.995)))
    return highest


def with_ordinary(
    machine: ElectricMachine, planted: tuple[Planted, ...], rng: np.random.Generator
) -> tuple[Planted, ...]:
    """The effects as they are: friction is drawn with them."""
    return planted


def possible(machine: ElectricMachine, outside: bool = False) -> list[str]:
    """Keys of the recipes that show on this machine's logs."""
    duty = bool(machine.joints["by_duty"].any())
    return [
        key
        for key, recipe in RECIPES.items()
        if machine.family in recipe.families
        and recipe.outside == outside
        and recipe.needs <= machine.states
        and (duty or not recipe.needs_duty)
        and not (recipe.hides_with and recipe.hides_with in machine.logger.channels)
    ]


def plant(
    machine: ElectricMachine,
    key: str,
    size: str | None,
    joints: Sequence[str],
    rng: np.random.Generator,
    ordinary: bool = False,
) -> Planted:
    """An effect of a size in some joints, scattered between them."""
    recipe = RECIPES[key]
    layer = recipe.layer or ("servo" if machine.family == "servo" else "joint_motion")

    def build(name: str, level: float) -> Built:
        fields, numbers = recipe.build(machine, machine.names.index(name), level, rng)
        return fields, numbers if layer == "servo" else _as_logged(machine, name, numbers)

    effect = key.removesuffix("_of_arm")
    return plant_recipe(recipe, effect, layer, size, joints, machine.names, build, rng, ordinary)


_TORQUES = ("friction_nm", "asymmetry_nm", "static_nm", "nm_s_per_rad", "nm_per_rad")


def _as_logged(machine: ElectricMachine, name: str, numbers: Numbers) -> Numbers:
    """Torques in the unit of the log, which is amperes where the current was recorded as the effort."""
    scale = float(machine.logger.effort_scale[machine.names.index(name)])
    return {key: value * scale if key in _TORQUES and value is not None else value for key, value in numbers.items()}
