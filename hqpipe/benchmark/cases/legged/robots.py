"""The legged robots of the withheld cases: links, joints and cylinders of a sound machine without scatter.

The quadruped is read from its robot.yaml and URDF. The two others have geometries of their own; the sizes of their cylinders
follow from a torque, a top speed and the two rates that make a hydraulic position loop (Merritt 1967, ch. 8): the loop's
velocity gain and the decay of the oil's pressure through the leak, which must be well above it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from xml.etree import ElementTree

import numpy as np

from hqpipe.benchmark.cases.legged.body import Body
from hqpipe.benchmark.cases.legged.hydraulics import JOINT, SUPPLY
from hqpipe.robots import RobotSpec, load_robot

NEVER = 1.0e9
QUADRUPED = "hydraulic_quadruped"


@dataclass(frozen=True)
class Robot:
    """A sound robot; J = L n joints, leg by leg.

    Attributes:
        name: family in answers.json. robot: what logset.yaml names, None where there is no description. legs: names.
        joints: names. kinds: of each joint, e.g. "knee". body: links. cylinders: (J,) of `JOINT`. supply: () of `SUPPLY`.
        stand: (J,) rad. swing: (J,) rad about it in free motion. speed, acceleration: (J,) rad/s, rad/s² of commands.
        top_speed: (J,) rad/s at full opening without load. velocity_filter_hz, resolution: Hz, rad.
    """

    name: str
    robot: str | None
    legs: tuple[str, ...]
    joints: tuple[str, ...]
    kinds: tuple[str, ...]
    body: Body
    cylinders: np.ndarray
    supply: np.ndarray
    stand: np.ndarray
    swing: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    top_speed: np.ndarray
    velocity_filter_hz: float
    resolution: float

    @property
    def per_leg(self) -> int:
        return len(self.joints) // len(self.legs)


def neutral_cylinders(count: int) -> np.ndarray:
    """(J,) of `JOINT` with nothing wrong and nothing built in."""
    found = np.zeros(count, dtype=JOINT)
    found["limit"] = found["hunting_hz"] = 1.0
    found["stribeck_speed"], found["cold_until"] = 0.02, -NEVER
    found["integral_limit"] = 0.3  # opening; assumption, the value of robot.yaml
    found["corner"] = 1.0e-3  # opening: an edge of 0.5 µm on a spool of 0.5 mm; assumption
    return found


def _triple(text: str) -> list[float]:
    return [float(part) for part in text.split()]


def _merged(parts: Sequence[tuple[float, np.ndarray, np.ndarray]]) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre and principal inertia of bodies that are fixed to each other: (kg, (3,) m, (3,) kg·m²) each."""
    mass = sum(part[0] for part in parts)
    com = sum(part[0] * part[1] for part in parts) / mass
    inertia = np.zeros(3)
    for m, centre, own in parts:
        d = centre - com
        inertia += own + m * (d @ d - d**2)
    return mass, com, inertia


def _urdf_body(robot: RobotSpec) -> Body:
    """Links of the URDF; each leg's foot is fixed to its shank."""
    tree = ElementTree.parse(robot.urdf).getroot()
    links = {link.get("name"): link for link in tree.iter("link")}
    joints = {joint.get("name"): joint for joint in tree.iter("joint")}

    def inertial(name: str) -> tuple[float, np.ndarray, np.ndarray]:
        part = links[name].find("inertial")
        moments = part.find("inertia")
        principal = np.array([float(moments.get(key)) for key in ("ixx", "iyy", "izz")])
        return float(part.find("mass").get("value")), np.array(_triple(part.find("origin").get("xyz"))), principal

    legs, n = len(robot.feet), len(robot.joints) // len(robot.feet)
    body = _empty_body(legs, n)
    for leg, foot in enumerate(robot.feet):
        for k in range(n):
            joint = joints[robot.joints[leg * n + k]]
            body.origin[leg, k] = _triple(joint.find("origin").get("xyz"))
            body.axis[leg, k] = _triple(joint.find("axis").get("xyz"))
            parts = [inertial(joint.find("child").get("link"))]
            if k == n - 1:
                at = np.array(_triple(joints[f"{foot}_ankle"].find("origin").get("xyz")))
                mass, com, own = inertial(f"{foot}_foot")
                parts.append((mass, com + at, own))
                body.foot[leg] = at
            body.mass[leg, k], body.com[leg, k], body.inertia[leg, k] = _merged(parts)
    return body


def _empty_body(legs: int, n: int) -> Body:
    shapes = ((legs, n, 3), (legs, n, 3), (legs, n), (legs, n, 3), (legs, n, 3), (legs, 3))
    return Body(*(np.zeros(shape) for shape in shapes))


@cache
def quadruped() -> Robot:
    """`robot/hydraulic_quadruped`: the gaps of its robot.yaml are chain, open centre, dead time, spool and friction."""
    spec = load_robot(QUADRUPED)
    given = spec.hydraulics
    fluid, supply, piston, chain = (given[key] for key in ("fluid", "supply", "cylinder", "chain"))
    valve, firmware, sensors = given["valve"], given["firmware"], given["sensors"]
    found, radius = neutral_cylinders(len(spec.joints)), float(spec.sprocket_radius[0])
    found["area_a"], found["area_b"], found["stroke"] = piston["area_a"], piston["area_b"], piston["stroke"]
    found["dead_a"], found["dead_b"] = piston["dead_volume_a"], piston["dead_volume_b"]
    found["modulus"], found["leakage"] = fluid["bulk_modulus"], piston["leakage"]
    found["piston_mass"] = 2.0 * piston["piston_mass"] + chain["mass"]  # two pulling cylinders and a chain
    for field, key in (
        ("coulomb", "coulomb_friction"),
        ("stribeck", "stribeck_friction"),
        ("viscous", "viscous_friction"),
    ):
        found[field] = 2.0 * piston[key]
    found["stribeck_speed"] = piston["stribeck_velocity"]
    strands, tooth = 2.0 * chain["stiffness"], chain["tooth_stiffness"]
    found["link_stiffness"] = strands * tooth / (strands + tooth)
    found["link_damping"] = 2.0 * chain["damping"] * (tooth / (strands + tooth)) ** 2
    found["radius"], found["middle"] = radius, 0.5 * (spec.position_lower + spec.position_upper)
    found["flow"] = valve["rated_flow"] / np.sqrt(0.5 * valve["rated_drop"])
    found["natural_hz"], found["damping"], found["slew"] = (
        valve["bandwidth_hz"],
        valve["damping_ratio"],
        valve["slew_rate"],
    )
    found["overlap"], found["valve_delay_s"] = -valve["null_opening"], valve["delay"]
    found["gain"] = firmware["position_pid"]["kp"]
    half = 0.5 * (supply["pressure"] - supply["return_pressure"])
    speed = float(found["flow"][0]) * np.sqrt(half) / piston["area_a"] / radius
    pump = np.zeros((), dtype=SUPPLY)
    pump["pressure"], pump["tank"], pump["pump"] = supply["pressure"], supply["return_pressure"], supply["pump_flow"]
    pump["slope"] = supply["pump_flow"] / supply["relief_override"]
    gas = supply["accumulator_volume"] * (supply["accumulator_precharge"] / supply["pressure"]) ** (
        1 / supply["gas_exponent"]
    )
    pump["capacity"] = (
        gas / (supply["gas_exponent"] * supply["pressure"]) + supply["line_volume"] / fluid["bulk_modulus"]
    )
    kinds = tuple({"R": "roll", "P": "pitch", "K": "knee"}[name[-1]] for name in spec.joints)
    swing = np.array([{"roll": 0.25, "pitch": 0.4, "knee": 0.45}[kind] for kind in kinds])
    return Robot(
        name="legged quadruped of 317 kg",
        robot=QUADRUPED,
        legs=spec.feet,
        joints=spec.joints,
        kinds=kinds,
        body=_urdf_body(spec),
        cylinders=found,
        supply=pump,
        stand=spec.nominal_position.copy(),
        swing=swing,
        speed=np.full(len(kinds), 4.5),
        acceleration=np.full(len(kinds), 90.0),
        top_speed=np.full(len(kinds), speed),
        velocity_filter_hz=float(sensors["velocity_filter_hz"]),
        resolution=float(sensors["encoder_resolution"]),
    )


@dataclass(frozen=True)
class Axis:
    """One kind of joint of a robot that has no description on disk.

    Attributes:
        kind: name. turns: axis. mass, length: kg, m of the link that it moves; it hangs down. stand, swing: rad.
        torque: N·m at the full supply. arm: m. ratio: area_b over area_a. linkage: else a rotary actuator.
        dead: volume of hose and fittings over that of half a stroke.
    """

    kind: str
    turns: str
    mass: float
    length: float
    stand: float
    swing: float
    torque: float
    arm: float
    ratio: float
    linkage: bool
    dead: float


SMALL = (  # a quadruped in the size of HyQ (Semini et al. 2011): rotary roll joints, cylinders on linkages
    Axis("HAA", "x", 4.0, 0.08, 0.0, 0.22, 95.0, 0.05, 1.0, False, 1.6),
    Axis("HFE", "y", 6.5, 0.35, 0.6, 0.45, 110.0, 0.045, 0.94, True, 1.6),
    Axis("KFE", "y", 3.2, 0.35, -1.2, 0.5, 90.0, 0.042, 0.94, True, 1.6),
)
BIPED = (  # a two-legged test stand of adult size, double-rod cylinders on linkages; assumption throughout
    Axis("roll", "x", 4.5, 0.1, 0.0, 0.2, 360.0, 0.055, 1.0, True, 0.9),
    Axis("pitch", "y", 8.0, 0.4, 0.4, 0.4, 380.0, 0.055, 1.0, True, 0.9),
    Axis("knee", "y", 5.0, 0.4, -0.8, 0.45, 300.0, 0.05, 1.0, True, 0.9),
    Axis("ankle", "y", 2.4, 0.14, 0.4, 0.3, 80.0, 0.04, 1.0, True, 1.6),
)


def _own_body(legs: Sequence[tuple[float, float]], axes: Sequence[Axis]) -> Body:
    """Legs whose hips are at (x, y) m, of even bars that hang down one below the other."""
    body = _empty_body(len(legs), len(axes))
    for leg, (x, y) in enumerate(legs):
        for k, axis in enumerate(axes):
            above = axes[k - 1].length if k else 0.0
            body.origin[leg, k] = (
                (x, y, 0.0) if k == 0 else (0.0, np.sign(y) * above, 0.0) if k == 1 else (0.0, 0.0, -above)
            )
            body.axis[leg, k] = (1.0, 0.0, 0.0) if axis.turns == "x" else (0.0, 1.0, 0.0)
            body.mass[leg, k] = axis.mass
            along = (0.0, 0.5 * np.sign(y) * axis.length, 0.0) if k == 0 else (0.0, 0.0, -0.45 * axis.length)
            body.com[leg, k] = along
            slender = axis.mass * axis.length**2 / 12.0
            body.inertia[leg, k] = (slender + 0.002, slender + 0.002, 0.004 + 0.002 * axis.mass)
        body.foot[leg] = (0.0, 0.0, -axes[-1].length)
    return body


def _designed(
    axes: Sequence[Axis], count: int, pressure: float, rates: tuple[float, float, float], modulus: float
) -> np.ndarray:
    """(count · n,) cylinders for `axes`.

    Args:
        rates: top speed in rad/s, velocity gain of the loop and decay of the oil's pressure in 1/s.
    """
    found = neutral_cylinders(len(axes))
    top, loop, decay = rates
    for axis, joint in zip(axes, found, strict=True):
        area = axis.torque / (pressure * axis.arm)  # of the larger side
        travel = 2.0 * 1.6 * axis.swing * axis.arm  # with room beyond the free motion
        joint["area_a"], joint["area_b"], joint["stroke"] = area, area * axis.ratio, travel
        joint["dead_a"] = axis.dead * 0.5 * travel * area
        joint["dead_b"] = joint["dead_a"]
        joint["modulus"] = modulus
        volume = joint["dead_a"] + 0.5 * travel * area
        joint["leakage"] = decay * volume / (2.0 * modulus)
        joint["piston_mass"] = 1.0 + 2.5e3 * area
        stiff = modulus * area**2 * 2.0 / volume
        joint["link_stiffness"] = 12.0 * stiff  # pins and brackets; assumption
        joint["link_damping"] = 0.02 * np.sqrt(joint["link_stiffness"] * joint["piston_mass"])
        seal = 0.8e5 * area  # 0.8 bar of a new low-friction seal; assumption after makers' data
        joint["coulomb"], joint["stribeck"], joint["viscous"] = seal, 0.5 * seal, 0.004 * pressure * area
        joint["radius"], joint["middle"] = axis.arm, axis.stand
        if axis.linkage:  # the arm is longest near the stand and falls by 5 % at the ends of the swing
            joint["side_a"], joint["side_b"] = 1.06 * axis.arm, 5.5 * axis.arm
            joint["phase"] = 0.5 * np.pi - 0.18
        mean = 0.5 * area * (1.0 + axis.ratio)
        joint["flow"] = top * axis.arm * mean / np.sqrt(0.5 * pressure)
        joint["natural_hz"], joint["damping"], joint["slew"] = 110.0, 0.8, 350.0
        joint["overlap"] = -0.002  # a critical centre: 1 µm on a spool of 0.5 mm; assumption
        joint["valve_delay_s"] = 2.0e-4
        joint["gain"] = loop / top
    return np.tile(found, count)


def _pump(cylinders: np.ndarray, speeds: np.ndarray, pressure: float) -> np.ndarray:
    """A pump that gives way by 1.2 % when a third of the joints move at top speed."""
    arms = cylinders["radius"]
    peak = float(np.sum(cylinders["area_a"] * arms * speeds) / 3.0 + np.sum(cylinders["leakage"]) * pressure)
    supply = np.zeros((), dtype=SUPPLY)
    supply["pressure"], supply["tank"], supply["pump"] = pressure, 3.0e5, 2.0 * peak
    supply["slope"] = peak / (0.012 * pressure)
    supply["capacity"] = 0.02 * supply["slope"]  # answers within 20 ms; assumption
    return supply


def _own(
    name: str,
    legs: dict[str, tuple[float, float]],
    axes: Sequence[Axis],
    pressure: float,
    rates: tuple[float, float, float],
    modulus: float,
    motion: tuple[float, float],
) -> Robot:
    count = len(legs)
    cylinders, top = _designed(axes, count, pressure, rates, modulus), np.full(count * len(axes), rates[0])
    return Robot(
        name=name,
        robot=None,
        legs=tuple(legs),
        joints=tuple(f"{leg}_{axis.kind}" for leg in legs for axis in axes),
        kinds=tuple(axis.kind for axis in axes) * count,
        body=_own_body(tuple(legs.values()), axes),
        cylinders=cylinders,
        supply=_pump(cylinders, top, pressure),
        stand=np.tile([axis.stand for axis in axes], count),
        swing=np.tile([axis.swing for axis in axes], count),
        speed=np.full(len(top), motion[0]),
        acceleration=np.full(len(top), motion[1]),
        top_speed=top,
        velocity_filter_hz=160.0,
        resolution=2.0 * np.pi / 2**17,
    )


@cache
def small_quadruped() -> Robot:
    """Twelve joints, 90 kg."""
    hips = {"LF": (0.37, 0.2), "RF": (0.37, -0.2), "LH": (-0.37, 0.2), "RH": (-0.37, -0.2)}
    return _own("legged quadruped of 90 kg", hips, SMALL, 16.0e6, (9.0, 18.0, 150.0), 0.9e9, (4.0, 90.0))


@cache
def biped() -> Robot:
    """Eight joints on a stand."""
    hips = {"left": (0.0, 0.12), "right": (0.0, -0.12)}
    return _own("legged biped stand", hips, BIPED, 20.0e6, (8.0, 20.0, 140.0), 0.8e9, (3.6, 80.0))


ROBOTS = (quadruped, small_quadruped, biped)
