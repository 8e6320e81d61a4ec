"""Parameter records of the compiled code, one set for each span of the trial."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.errors import ConfigError
from hqpipe.plant.config import PlantConfig, Setting, check_base
from hqpipe.plant.schema import BY_PATH, FIELDS, joint_dtype, machine_dtype
from hqpipe.robots import RobotSpec

STABLE = 2.0  # half of the bound of the integrator, see check_stability


@dataclass(frozen=True)
class Parameters:
    """What holds from `start` s on: `joint` (J,) and `machine` (1,) records of float64."""

    start: float
    joint: np.ndarray
    machine: np.ndarray


def build_schedule(robot: RobotSpec, config: PlantConfig) -> list[Parameters]:
    """Parameters by rising start time; the first starts at −inf.

    Raises:
        ConfigError: robot.yaml or the configuration is wrong.
    """
    base = check_base(robot.hydraulics, robot)
    settings = [*base, *config.settings(robot)]
    edges = sorted({edge for s in settings for edge in (s.start, s.stop) if np.isfinite(edge)})
    return [_at(robot, base, settings, start) for start in (-np.inf, *edges)]


def _at(robot: RobotSpec, base: list[Setting], settings: list[Setting], time: float) -> Parameters:
    count = len(robot.joints)
    joint, machine = np.zeros(count, joint_dtype()), np.zeros(1, machine_dtype())
    for field in FIELDS:
        if field.default is not None:
            (joint if field.scope == "joint" else machine)[field.column] = field.default
    for setting in settings:
        if setting.start <= time < setting.stop or setting.start == -np.inf == time:
            column = BY_PATH[setting.path].column
            if setting.joints is None:
                machine[column] = setting.value
            else:
                joint[column][list(setting.joints)] = setting.value
    joint["radius"] = robot.sprocket_radius
    joint["position_lower"], joint["position_upper"] = robot.position_lower, robot.position_upper
    joint["position_middle"] = 0.5 * (robot.position_lower + robot.position_upper)
    joint["firmware_area"] = next(s.value for s in base if s.path == "cylinder.area_a")
    return Parameters(time, joint, machine)


def check_stability(schedule: list[Parameters], robot: RobotSpec, substep: float) -> None:
    """Refuse springs and dampers that the integrator cannot follow.

    Semi-implicit Euler with explicit damping stays bounded while k h²/m + 2 c h/m < 4 (Jury's criterion); half
    of that is allowed, because the spring constants below leave the coupling of neighbours out.

    Raises:
        ConfigError: names the joint, the part and the fields.
    """
    for p in (entry.joint for entry in schedule):
        volume = np.minimum(p["cylinder_dead_volume_a"], p["cylinder_dead_volume_b"])
        area = np.maximum(p["cylinder_area_a"], p["cylinder_area_b"])
        oil = p["fluid_bulk_modulus"] * area**2 / volume + p["cylinder_stop_stiffness"]
        parts = {
            "piston (cylinder.piston_mass, chain.stiffness, chain.damping, cylinder.dead_volume_a, dead_volume_b)": (
                p["cylinder_piston_mass"],
                oil + p["chain_stiffness"],
                p["chain_damping"],
            ),
            "chain (chain.mass, chain.stiffness, chain.tooth_stiffness, chain.damping, chain.tooth_damping)": (
                p["chain_mass"],
                2.0 * p["chain_stiffness"] + p["chain_tooth_stiffness"],
                2.0 * p["chain_damping"] + p["chain_tooth_damping"],
            ),
        }
        for part, (mass, stiffness, damping) in parts.items():
            number = substep * (substep * stiffness + 2.0 * damping) / mass
            worst = int(np.argmax(number))
            if number[worst] > STABLE:
                raise ConfigError(
                    f"plant: joint {robot.joints[worst]}: too stiff for substeps of {substep:g} s: {part} has "
                    f"k h²/m + 2 c h/m = {number[worst]:.2g}, expected at most {STABLE:g}",
                    file=robot.folder / "robot.yaml",
                    field=part.partition(" ")[0],
                    fix="raise the mass, lower stiffness or damping, or pass a smaller `substep`",
                )
