"""Drawing a sound legged machine: joints that scatter around what they share, its logger, and its trials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.benchmark.cases.legged.hydraulics import lever
from hqpipe.benchmark.cases.legged.robots import NEVER, Robot

TICK = 1.0e-3  # s, of the firmware
RATES = {1: 0.3, 2: 0.22, 3: 0.1, 4: 0.14, 5: 0.14, 10: 0.1}
"""Ticks between two rows of the log (1000, 500, 333, 250, 200, 100 Hz) and how often loggers do that; assumption."""
SCATTER = {  # relative standard deviation between joints of one machine; assumptions after makers' tolerances
    "area_a": 0.004,
    "area_b": 0.004,
    "dead_a": 0.04,
    "dead_b": 0.04,
    "leakage": 0.12,
    "coulomb": 0.2,
    "stribeck": 0.2,
    "viscous": 0.15,
    "link_stiffness": 0.08,
    "flow": 0.03,
    "natural_hz": 0.08,
    "damping": 0.05,
    "overlap": 0.25,
    "radius": 0.002,
    "side_a": 0.003,
    "side_b": 0.003,
}
SHARED = {
    "modulus": 0.1,
    "leakage": 0.12,
    "coulomb": 0.3,
    "viscous": 0.2,
    "natural_hz": 0.1,
    "flow": 0.04,
    "gain": 0.05,
}
"""The same between machines of one design: oil, wear of the whole fleet, settings; assumptions."""
FREE = ("multisine", "sweep", "moves", "steps", "slow")
STAND = ("tread", "press")


@dataclass(frozen=True)
class LeggedLogger:
    """What is recorded.

    Attributes:
        every: ticks between two rows. effort_source: "load_cell" or "pressure". speed, pressures, supply: recorded or not.
        torque_noise: share of the highest torque, RMS. pressure_noise: Pa RMS. policy_ticks: between two targets.
    """

    every: int
    effort_source: str
    speed: bool
    pressures: bool
    supply: bool
    torque_noise: float
    pressure_noise: float
    policy_ticks: int


@dataclass(frozen=True)
class LeggedTrial:
    """One trial.

    Attributes:
        file, split, seconds, seed: as in `hqpipe.benchmark.cases.planted.Motion`. motion: of `FREE` or `STAND`.
        pace: factor on speeds and rates. plate: N/m of the plates under the feet, 0 where the legs hang free.
    """

    file: str
    split: str
    seconds: float
    seed: int
    motion: str
    pace: float
    plate: float


@dataclass(frozen=True)
class LeggedMachine:
    """A machine and its trials.

    Attributes:
        robot: without scatter. cylinders: (J,) of `JOINT`, sound. faulty: with what is wrong. supplies: (2,) of `SUPPLY`,
            sound and faulty. span: shares of each trial in which the faulty ones act, None for always.
    """

    robot: Robot
    cylinders: np.ndarray
    faulty: np.ndarray
    supplies: np.ndarray
    logger: LeggedLogger
    trials: tuple[LeggedTrial, ...]
    span: tuple[float, float] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        return self.robot.joints

    @property
    def arms(self) -> np.ndarray:
        """(J,) m, moment arm of the piston where the robot stands."""
        return np.array([lever(joint, place)[1] for joint, place in zip(self.cylinders, self.robot.stand, strict=True)])

    @property
    def top_torque(self) -> np.ndarray:
        """(J,) N·m at the full supply, with half of both areas, where the robot stands."""
        pressure = float(self.supplies[0]["pressure"] - self.supplies[0]["tank"])
        return pressure * 0.5 * (self.cylinders["area_a"] + self.cylinders["area_b"]) * self.arms

    @property
    def oil_stiffness(self) -> np.ndarray:
        """(J,) N·m/rad of both chambers at half stroke, with the arm of the stand."""
        c = self.cylinders
        sides = sum(c[f"area_{s}"] ** 2 / (c[f"dead_{s}"] + 0.5 * c["stroke"] * c[f"area_{s}"]) for s in "ab")
        return c["modulus"] * sides * self.arms**2


def draw_machine(robot: Robot, rng: np.random.Generator) -> LeggedMachine:
    """A sound machine of this design."""
    cylinders = robot.cylinders.copy()
    for field, width in SHARED.items():
        cylinders[field] *= np.exp(rng.normal(0.0, width))
    for field, width in SCATTER.items():
        cylinders[field] *= np.exp(rng.normal(0.0, width, len(cylinders)))
    cylinders["null"] = rng.normal(
        0.0, 0.002, len(cylinders)
    )  # opening: what an adjusted servo valve keeps; assumption
    supplies = np.array([robot.supply, robot.supply])
    return LeggedMachine(robot, cylinders, cylinders.copy(), supplies, _logger(rng), _trials(rng))


def _logger(rng: np.random.Generator) -> LeggedLogger:
    pressures = bool(rng.random() < 0.35)
    return LeggedLogger(
        every=int(rng.choice(list(RATES), p=list(RATES.values()))),
        effort_source="pressure" if rng.random() < 0.4 else "load_cell",
        speed=bool(rng.random() < 0.8),
        pressures=pressures,
        supply=bool(rng.random() < 0.4),
        torque_noise=float(rng.uniform(4e-4, 2e-3)),
        pressure_noise=float(rng.uniform(1e4, 3e4)),
        policy_ticks=int(rng.choice([1, 10], p=[0.6, 0.4])),
    )


def _trials(rng: np.random.Generator) -> tuple[LeggedTrial, ...]:
    """Four to six trials of 10 to 20 s, one or two held out; hanging and standing legs are in the fit of every machine."""
    count, held = int(rng.integers(4, 7)), int(rng.integers(1, 3))
    fit = ["multisine", "tread", str(rng.choice(STAND)), *rng.choice(FREE + STAND, 3)][: count - held]
    motions = [str(name) for name in rng.permutation(fit)] + [
        "tread",
        str(rng.choice(["multisine", "press", "moves"])),
    ][:held]
    found = []
    for number, motion in enumerate(motions):
        plate = float(rng.uniform(4e4, 1.2e5)) if motion in STAND else 0.0
        seed, seconds = int(rng.integers(2**31)), float(rng.integers(10, 21))
        pace = float(rng.uniform(0.8, 1.3))
        split = "fit" if number < len(fit) else "heldout"
        found.append(LeggedTrial(f"{motion}_{number + 1}.parquet", split, seconds, seed, motion, pace, plate))
    return tuple(found)


def with_settings(machine: LeggedMachine, settings: Mapping[str, Mapping[str, float]]) -> LeggedMachine:
    """The machine with other values of some fields.

    Args:
        settings: joint, or "supply" → field of `JOINT` or `SUPPLY` → value.
    """
    faulty, supplies = machine.faulty.copy(), machine.supplies.copy()
    for name, fields in settings.items():
        for field, value in fields.items():
            if name == "supply":
                supplies[1][field] = value
            else:
                faulty[field][machine.names.index(name)] = value
    return replace(machine, faulty=faulty, supplies=supplies)


def seconds_of(machine: LeggedMachine, trial: LeggedTrial) -> tuple[float, float]:
    """From when to when of a trial the faulty joints act, s."""
    if machine.span is None:
        return -NEVER, NEVER
    start, stop = machine.span
    return (start * trial.seconds if start > 0.0 else -NEVER), (stop * trial.seconds if stop < 1.0 else NEVER)
