"""The families of machines that withheld cases are made of, and how each is drawn, changed, simulated and described."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from hqpipe.benchmark.cases.cylinder import effects as cylinder_effects
from hqpipe.benchmark.cases.cylinder import machine as cylinder
from hqpipe.benchmark.cases.electric import effects as electric_effects
from hqpipe.benchmark.cases.electric import machine as electric
from hqpipe.benchmark.cases.force_cylinder import effects as force_effects
from hqpipe.benchmark.cases.force_cylinder import machine as force_cylinder
from hqpipe.benchmark.cases.motions import MOTIONS
from hqpipe.benchmark.cases.planted import Motion


@dataclass(frozen=True)
class Family:
    """One kind of machine.

    Attributes:
        draw: a sound machine. model: module with `with_settings` and `at_viscosity`. effects: module of its recipes.
        motions: of `hqpipe.benchmark.cases.motions.MOTIONS`. electric: its friction is drawn beside other effects.
    """

    draw: Callable[[np.random.Generator], Any]
    model: ModuleType
    effects: ModuleType
    motions: tuple[str, ...]
    electric: bool = False


FAMILIES: dict[str, Family] = {
    "servo": Family(electric.draw_servo, electric, electric_effects, tuple(MOTIONS), electric=True),
    "arm": Family(electric.draw_arm, electric, electric_effects, tuple(MOTIONS), electric=True),
    "cylinder": Family(cylinder.draw_cylinder, cylinder, cylinder_effects, cylinder.MOTIONS),
    force_cylinder.FAMILY: Family(force_cylinder.draw_force_cylinder, cylinder, force_effects, force_cylinder.MOTIONS),
}
MACHINES: dict[str, dict[str, float]] = {
    "servo": {"servo": 1.0},
    "arm": {"arm": 1.0},
    "cylinder": {"cylinder": 0.75, force_cylinder.FAMILY: 0.25},
}
"""What may be asked for, and the shares of the families that it is made of."""


def columns(machine: Any, trial: Motion) -> dict[str, np.ndarray]:
    """What the machine's logger writes in a trial."""
    if machine.family == "cylinder":
        from hqpipe.benchmark.cases.cylinder.record import record as record_cylinder

        return record_cylinder(machine, trial)
    if machine.family == force_cylinder.FAMILY:
        from hqpipe.benchmark.cases.force_cylinder.record import record as record_force

        return record_force(machine, trial)
    from hqpipe.benchmark.cases.electric.record import record

    return record(machine, trial)


def stated(machine: Any, trial: Motion) -> Mapping[str, Any]:
    """`drive` and `load` of a trial for logset.yaml."""
    if not FAMILIES[machine.family].electric:
        return {}
    from hqpipe.benchmark.cases.electric.record import stated as stated_electric

    return stated_electric(machine, trial)


def control(machine: Any) -> tuple[str | None, str | None]:
    """Control mode and source of the effort for logset.yaml."""
    if machine.family == "cylinder":
        return "valve", "pressure" if machine.logger.pressures else None
    if machine.family == force_cylinder.FAMILY:
        return "torque", machine.source
    position = machine.family == "servo" or "position_command" in machine.logger.channels
    return "position" if position else None, machine.logger.effort_source


def describe(machine: Any) -> dict[str, Any]:
    """What answers.json says of a machine."""
    found: dict[str, Any] = {"family": machine.family, "joints": list(machine.names), "kinds": list(machine.kinds)}
    found["rate_hz"], found["jitter"] = machine.logger.rate_hz, machine.logger.jitter
    if FAMILIES[machine.family].electric:
        return found | _of_electric(machine)
    found |= {"stops": machine.stops, "natural_lag_s": float(machine.axes["lag"][0])}
    radius = np.array([machine.radius_of(j) for j in range(len(machine.names))])
    if machine.family == force_cylinder.FAMILY:
        loop = machine.loops["force_gain"] * machine.stiffness * machine.top_speed
        return found | {"loop_per_s": loop.tolist(), "typical_effort": (machine.force * radius).tolist()}
    return found | {
        "neutral": machine.axes["neutral"].tolist(),
        "speed_per_command": (machine.top_speed / radius).tolist(),
    }


def _of_electric(machine: Any) -> dict[str, Any]:
    return {
        "coupling": machine.coupling,
        "drive": "duty" if machine.joints["by_duty"].any() else "torque",
        "stated": sorted(machine.states) if machine.family == "servo" else [],
        "effort_unit": "A" if (machine.logger.effort_scale != 1.0).any() else "N·m",
        "typical_torque": machine.torque.tolist(),
        "inertia": machine.inertia.tolist(),
        "gravity": machine.gravity.tolist(),
        "kp": machine.joints["kp"].tolist(),
        "kd": (machine.joints["kd"] + machine.joints["back_emf"]).tolist(),
    }
