"""Electric machines without effects: servos on pendulums or light arms, and torque-controlled arms. Drawn, not yet run.

A servo is a stiff second-order system: a position loop of 12 to 30 rad/s that is damped by its drive or by back-EMF. An arm
follows a planned motion and logs the torque of its motors. Neither has friction.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from hqpipe.benchmark.cases.electric.bodies import Link, pendulums, serial_arm
from hqpipe.benchmark.cases.electric.drives import JOINT, neutral_joints
from hqpipe.benchmark.cases.motions import MOTIONS, Range
from hqpipe.benchmark.cases.planted import Motion
from hqpipe.sim.joint_chain import JointChain

STEP = 5.0e-4  # s, of the physics engine
POSTURES = 6  # at which inertia and gravity of an arm are looked up; assumption
RATES = {
    "servo": (50.0, 100.0, 190.0, 200.0, 500.0),
    "arm": (50.0, 100.0, 200.0, 250.0, 500.0, 1000.0),
}  # Hz, of the logs
COUNTS = (4096, 4096, 16384, 65536)  # counts a turn: hobby servos have 12 bits, industrial encoders 14 to 16 and more
AXES = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
GEARED = (
    8.0,
    20.0,
)  # reflected inertia over that of the links, so that coupling stays moderate; assumption: light arms, high ratios
IN_TURN = 0.5  # share of the trials of serial machines in which one joint moves at a time
TURN_S = 4.0  # s, the least that a joint moves in its turn
JITTERY = 0.25  # share of the cases whose clock jitters
OUTPUT_SHARE = 0.3  # of a geared joint's armature that turns with the load, where its transmission is soft; assumption
SMALL_ROTOR = 0.03  # of the load's inertia: what a direct drive adds, within what a stated load is known to; assumption
RESOLUTION_M = 2.0e-5  # m, of a linear encoder


@dataclass(frozen=True)
class Logger:
    """What is recorded, and how well.

    Attributes:
        rate_hz: of the log. jitter: RMS of its clock's steps, share of a sample. host_hz: rate of the commands.
        channels: of each joint. supply: the voltage is logged. effort_source: as in logset.yaml.
        resolution: (J,) rad or m. effort_noise: (J,) N·m RMS. effort_scale: (J,) logged unit per N·m.
        speed_lag: s, of the drive's own estimate of the speed.
    """

    rate_hz: float
    jitter: float
    host_hz: float
    channels: tuple[str, ...]
    supply: bool
    effort_source: str | None
    resolution: np.ndarray
    effort_noise: np.ndarray
    effort_scale: np.ndarray
    speed_lag: float


@dataclass(frozen=True)
class ElectricMachine:
    """A machine and the motions that it was recorded with.

    Attributes:
        family: "servo" or "arm". names, kinds: of the joints. links: of the body. serial: an arm and no pendulums.
        joints: (J,) of `JOINT`. rooms: where each joint moves. torque: (J,) typical N·m of the motion.
        inertia: (J,) kg·m², armature included. gravity: (J,) largest N·m. supply: V and Ω. every: steps a firmware tick.
        logger, trials: what is recorded. states: of "drive" and "load", what logset.yaml says. coupling: label.
    """

    family: str
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    links: tuple[Link, ...]
    serial: bool
    joints: np.ndarray
    rooms: tuple[Range, ...]
    torque: np.ndarray
    inertia: np.ndarray
    gravity: np.ndarray
    supply: tuple[float, float]
    every: int
    logger: Logger
    trials: tuple[Motion, ...]
    states: frozenset[str]
    coupling: str
    sensing: dict[str, float] = field(default_factory=dict)  # field/number of the joint → value

    def latency(self) -> float:
        """s from the host's command to the mean torque that answers it: current loop, and half of a firmware tick."""
        return float(self.joints["lag"][0]) + 0.5 * self.every * STEP

    def xml(self, load: float = 1.0, timestep: float = STEP) -> str:
        """MJCF with the load's mass times `load`."""
        own = [self.sensing.get(f"load_factor/{j}", 1.0) for j in range(len(self.links))]
        links = [replace(link, load_mass=link.load_mass * load * f) for link, f in zip(self.links, own, strict=True)]
        return serial_arm(links, timestep) if self.serial else pendulums(links, timestep)


def draw_servo(rng: np.random.Generator) -> ElectricMachine:
    """One to six servos; half of the machines have one."""
    count = 1 if rng.random() < 0.5 else int(rng.integers(2, 7))
    serial = count > 1 and rng.random() < 0.4
    hobby = rng.random() < 0.6
    scale = rng.uniform(0.2, 0.8) if hobby else rng.uniform(0.8, 4.0)  # kg at the end of the bar
    lever = rng.uniform(0.08, 0.18) if hobby else rng.uniform(0.2, 0.45)  # m
    links = []
    for n in range(count):
        shrink = 0.75**n if serial else 1.0
        axis = (AXES[n % len(AXES)] if rng.random() < 0.5 else AXES[1]) if serial else AXES[1]
        mass, length = scale * shrink * rng.uniform(0.8, 1.2), lever * shrink**0.5 * rng.uniform(0.85, 1.15)
        links.append(Link(axis, length, 0.1 * mass, mass if not serial or n == count - 1 else 0.0, 0.0))
    ratio = rng.uniform(*GEARED) if serial else 0.0
    body = _geared(tuple(links), serial, ratio)
    by_duty = hobby and rng.random() < 0.5
    return _machine("servo", body, serial, "moderate" if serial else "none", hobby, by_duty, rng)


def draw_arm(rng: np.random.Generator) -> ElectricMachine:
    """One to seven joints; a quarter of the machines has one, a slide in a share of them."""
    count = 1 if rng.random() < 0.25 else int(rng.integers(2, 8))
    slide = {0} if count == 1 and rng.random() < 0.4 else set()
    if count > 2 and rng.random() < 0.2:
        slide = {int(rng.choice([0, 2]))}
    strong = count > 1 and rng.random() < 0.25
    heavy, reach = rng.uniform(0.5, 6.0), rng.uniform(0.15, 0.4)
    links = []
    for n in range(count):
        shrink = 0.7**n
        axis = AXES[n % len(AXES)] if count > 1 else AXES[1]
        if n in slide:
            axis = (0.0, 0.0, 1.0) if rng.random() < 0.4 else (1.0, 0.0, 0.0)
        mass = heavy * shrink * rng.uniform(0.8, 1.2)
        load = rng.uniform(0.2, 0.6) * heavy * shrink if n == count - 1 else 0.0
        links.append(Link(axis, reach * shrink**0.4, mass, load, 0.0, n in slide))
    ratio = 0.0 if count == 1 else rng.uniform(0.1, 0.4) if strong else rng.uniform(*GEARED)
    body = _geared(tuple(links), count > 1, ratio)
    label = "none" if count == 1 else "strong" if strong else "moderate"
    return _machine("arm", body, count > 1, label, False, False, rng)


def _geared(links: tuple[Link, ...], serial: bool, ratio: float) -> tuple[Link, ...]:
    """With motors whose reflected inertia is `ratio` times what they move."""
    if ratio == 0.0:
        return links
    inertia, _ = _felt(links, serial)
    return tuple(replace(link, armature=ratio * float(j)) for link, j in zip(links, inertia, strict=True))


def _felt(links: tuple[Link, ...], serial: bool) -> tuple[np.ndarray, np.ndarray]:
    """(J,) largest inertia and largest gravity torque over some postures."""
    chain = JointChain(serial_arm(links, STEP) if serial else pendulums(links, STEP))
    inertia, gravity = np.zeros(len(links)), np.zeros(len(links))
    spread = np.random.default_rng(0)
    for number in range(POSTURES):
        share = spread.uniform(-1, 1, len(links)) if number else np.ones(len(links))
        posture = np.array([0.1 if link.slides else np.pi / 2 for link in links]) * share
        inertia = np.maximum(inertia, np.diag(chain.inertia(posture)))
        gravity = np.maximum(gravity, np.abs(chain.gravity(posture)))
    return inertia, gravity


def _machine(
    family: str,
    links: tuple[Link, ...],
    serial: bool,
    coupling: str,
    hobby: bool,
    by_duty: bool,
    rng: np.random.Generator,
) -> ElectricMachine:
    count = len(links)
    inertia, gravity = _felt(links, serial)
    bandwidth = rng.uniform(12.0, 30.0) * rng.uniform(0.85, 1.15, count)  # rad/s
    damping = rng.uniform(0.5, 1.0) * rng.uniform(0.9, 1.1, count)
    joints = neutral_joints(count)
    joints["kp"] = inertia * bandwidth**2
    joints["kd"] = 2.0 * damping * inertia * bandwidth
    joints["lag"] = rng.uniform(1.0e-4, 3.0e-4)  # s, current loops of 500 to 1500 Hz
    joints["torque_constant"] = rng.uniform(0.3, 1.2, count) if hobby else rng.uniform(1.0, 8.0, count)
    armature = np.array([link.armature for link in links])
    joints["rotor"] = np.where(armature > 0.0, (1.0 - OUTPUT_SHARE) * armature, SMALL_ROTOR * inertia)
    joints["logged_at_load"] = 1.0
    volts = 7.4 if hobby else 24.0
    rooms = tuple(_room(link, b, rng) for link, b in zip(links, bandwidth, strict=True))
    peak = gravity + inertia * np.array([room.acceleration for room in rooms])
    if by_duty:
        joints["by_duty"], joints["back_emf"], joints["kd"] = 1.0, joints["kd"], 0.0
        fastest = np.array([room.speed for room in rooms])
        joints["volt_torque"] = (
            3.0 * peak + joints["back_emf"] * fastest
        ) / volts  # full duty stalls at thrice the peak
    if family == "arm":
        joints["damps_error"], joints["ki"] = 1.0, 0.3 * joints["kp"] * bandwidth * float(rng.random() < 0.5)
    torque = np.maximum(0.7 * gravity, 0.5 * inertia * np.array([room.acceleration for room in rooms]))
    kinds = tuple("prismatic" if link.slides else "revolute" for link in links)
    logger = _logger(family, kinds, torque, by_duty, hobby, joints["torque_constant"], rng)
    several = family == "servo" and rng.random() < 0.3
    trials = draw_trials(count, several, several and not serial, logger.rate_hz, rng, turns=IN_TURN if serial else 0.0)
    return ElectricMachine(
        family=family,
        names=_names(family, count, rng),
        kinds=kinds,
        links=links,
        serial=serial,
        joints=joints,
        rooms=rooms,
        torque=torque,
        inertia=inertia,
        gravity=gravity,
        supply=(volts, 0.0),
        every=int(rng.choice([1, 2])),
        logger=logger,
        trials=trials,
        states=frozenset(what for what in ("drive", "load") if rng.random() < 0.55 and not (what == "load" and serial)),
        coupling=coupling,
    )


def _room(link: Link, bandwidth: float, rng: np.random.Generator) -> Range:
    """Motions of up to a third of the loop's bandwidth."""
    swing = rng.uniform(0.05, 0.15) if link.slides else rng.uniform(0.5, 1.2)
    middle = 0.0 if rng.random() < 0.6 else rng.uniform(-0.5, 0.5) * swing
    return Range(middle, swing, swing * bandwidth / 5.0, swing * (bandwidth / 4.5) ** 2)


def _names(family: str, count: int, rng: np.random.Generator) -> tuple[str, ...]:
    stem = str(rng.choice(["servo", "motor", "joint"] if family == "servo" else ["joint", "axis", "arm"]))
    return (stem,) if count == 1 else tuple(f"{stem}_{n + 1}" for n in range(count))


def draw_trials(
    count: int,
    gains: bool,
    loads: bool,
    rate_hz: float,
    rng: np.random.Generator,
    motions: tuple[str, ...] = (),
    turns: float = 0.0,
) -> tuple[Motion, ...]:
    """Three to six trials, one or two of them held out.

    Args:
        count: of the joints. gains, loads: whether they differ between trials. rate_hz: of the log.
        motions: names to choose from; none for all. turns: share of the trials in which one joint moves at a time.
    """
    number = int(rng.integers(3, 7))
    held = set(rng.permutation(number)[: 1 if number < 5 else 2].tolist())
    known = list(motions or MOTIONS)
    names = [known[i] for i in rng.permutation(len(known))][:number]
    found = []
    for n in range(number):
        long = rng.random() < 0.15 and rate_hz <= 200.0
        seconds = float(np.round(rng.uniform(30.0, 60.0) if long else rng.uniform(10.0, 22.0), 1))
        chosen = tuple(names[n % len(names)] if rng.random() < 0.7 else str(rng.choice(known)) for _ in range(count))
        gain = float(rng.choice([0.5, 1.0, 1.0, 2.0])) if gains else 1.0
        load = float(rng.choice([0.6, 1.0, 1.0, 1.4])) if loads else 1.0
        split = "heldout" if n in held else "fit"
        seed = int(rng.integers(1, 2**31 - 1))
        in_turn = turns > 0.0 and rng.random() < turns
        seconds = max(seconds, TURN_S * count) if in_turn else seconds
        found.append(Motion(f"trial_{n + 1}.parquet", split, seconds, seed, chosen, gain, load, in_turn))
    return tuple(found)


def draw_jitter(rng: np.random.Generator) -> float:
    """RMS of a clock's steps, share of a sample."""
    return float(rng.uniform(0.06, 0.12)) if rng.random() < JITTERY else 0.0


def _logger(
    family: str,
    kinds: tuple[str, ...],
    torque: np.ndarray,
    by_duty: bool,
    hobby: bool,
    torque_constant: np.ndarray,
    rng: np.random.Generator,
) -> Logger:
    rate = float(rng.choice(RATES[family]))
    counts = int(rng.choice(COUNTS[:2] if hobby else COUNTS[2:]))
    resolution = np.array([RESOLUTION_M if kind == "prismatic" else 2.0 * np.pi / counts for kind in kinds])
    channels = ["position"]
    supply = False
    source = None
    scale = np.ones(len(kinds))
    if family == "servo":
        channels.append("position_command")
        if by_duty and rng.random() < 0.5:
            channels.append("duty")
            supply = True
    else:
        channels.append("effort")
        source = "current" if rng.random() < 0.6 else "estimate"
        if source == "current" and rng.random() < 0.3:
            scale = 1.0 / torque_constant  # in amperes
        if rng.random() < 0.5:
            channels.append("position_command")
    if rng.random() < (0.4 if family == "servo" else 0.6):
        channels.append("velocity")
    noise = torque * rng.uniform(0.005, 0.02)
    host = rate if rng.random() < 0.6 else float(rng.choice([50.0, 100.0, 250.0]))
    lag = rng.uniform(5e-3, 2e-2) if family == "servo" else 1e-3
    return Logger(rate, draw_jitter(rng), host, tuple(channels), supply, source, resolution, noise, scale, float(lag))


def with_settings(machine: ElectricMachine, settings: dict[str, dict[str, float]]) -> ElectricMachine:
    """The machine with fields of its joints, of its supply or of its sensors set, joint by joint."""
    joints, supply, sensing = machine.joints.copy(), list(machine.supply), dict(machine.sensing)
    for name, fields in settings.items():
        j = machine.names.index(name)
        for key, value in fields.items():
            if key in JOINT.names:
                joints[key][j] = value
            elif key == "source_ohm":
                supply[1] = value
            else:
                sensing[f"{key}/{j}"] = value
    return replace(machine, joints=joints, supply=(supply[0], supply[1]), sensing=sensing)


def at_viscosity(machine: ElectricMachine, factor: float) -> ElectricMachine:
    """The machine with grease of another viscosity, on which all friction of its gears depends."""
    joints = machine.joints.copy()
    for name in ("coulomb", "static", "viscous"):
        joints[name] *= factor
    return replace(machine, joints=joints)
