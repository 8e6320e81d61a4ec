"""A hydraulic test bench: the compiled hydraulics with the joints moved by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hqpipe.plant import hydraulics
from hqpipe.plant.config import PlantConfig
from hqpipe.plant.parameters import build_schedule
from hqpipe.robots import RobotSpec, load_robot

BODY_STEP = 5.0e-4
TICK = 1.0e-3


@pytest.fixture(scope="session")
def robot() -> RobotSpec:
    return load_robot("hydraulic_quadruped")


class Bench:
    """Hydraulics of all joints, without a body: the angles follow a given motion."""

    def __init__(self, robot: RobotSpec, overrides: dict[str, Any], substep: float = 5.0e-5) -> None:
        parameters = build_schedule(robot, PlantConfig(overrides))[0]
        self.joint, self.machine, self.substep, self.time = parameters.joint, parameters.machine, substep, 0.0
        count = len(robot.joints)
        self.state = np.zeros(count, hydraulics.STATE)
        self.ledger, self.supply = np.zeros(count, hydraulics.LEDGER), np.zeros(1, hydraulics.SUPPLY)
        self.supply["pressure"] = self.machine["supply_pressure"]
        self.angles = self.joint["position_middle"].copy()
        self.commands, self.neighbour = np.zeros((64, count)), np.arange(count)
        self.fill(10.75e6, 10.75e6)

    def fill(self, pressure_a: float, pressure_b: float) -> None:
        """Rest at the present angles with these chamber pressures, Pa."""
        a, b = np.full(len(self.joint), pressure_a), np.full(len(self.joint), pressure_b)
        hydraulics.settle(self.joint, self.machine, self.state, self.angles, a, b, self.time)

    def run(self, duration: float, angle: Callable[[float], np.ndarray] | None = None) -> None:
        """Advance; `angle` gives (J,) rad at a time, None holds."""
        for _ in range(round(duration / BODY_STEP)):
            now = self.angles
            then = now if angle is None else angle(self.time + BODY_STEP)
            clock = np.array([self.time, self.substep, TICK, round(BODY_STEP / self.substep)], dtype=float)
            rate = (then - now) / BODY_STEP
            hydraulics.advance(
                self.joint,
                self.machine,
                self.state,
                self.ledger,
                self.supply,
                self.commands,
                self.neighbour,
                now,
                then,
                rate,
                clock,
            )
            self.angles, self.time = then, self.time + BODY_STEP

    def volume(self) -> tuple[np.ndarray, np.ndarray]:
        """Geometric volume of both chambers, (J,) m³."""
        p, s = self.joint, self.state
        return (
            p["cylinder_dead_volume_a"] + p["cylinder_area_a"] * s["x_a"],
            p["cylinder_dead_volume_b"] + p["cylinder_area_b"] * (p["cylinder_stroke"] - s["x_b"]),
        )

    def stored(self) -> np.ndarray:
        """(J,) J in compressed oil, stretched chain and moving pistons."""
        p, s, modulus = self.joint, self.state, self.joint["fluid_bulk_modulus"]
        total = (
            0.5 * p["cylinder_piston_mass"] * (s["v_a"] ** 2 + s["v_b"] ** 2)
            + 0.5 * p["chain_mass"] * s["v_chain"] ** 2
        )
        for volume, oil, pressure in zip(
            self.volume(), (s["oil_a"], s["oil_b"]), (s["pressure_a"], s["pressure_b"]), strict=True
        ):
            total = total + oil * modulus * np.log1p(pressure / modulus) - pressure * volume
        pitch = 0.5 * p["cylinder_stroke"] + p["radius"] * (self.angles - p["position_middle"])
        for stiffness, stretch in (
            (p["chain_stiffness"], np.maximum(s["x_a"] - s["chain"], 0.0)),
            (p["chain_stiffness"], np.maximum(s["chain"] - s["x_b"], 0.0)),
            (p["chain_tooth_stiffness"], s["chain"] - pitch),
        ):
            total = total + 0.5 * stiffness * stretch**2
        return total


@pytest.fixture
def bench(robot: RobotSpec) -> Callable[..., Bench]:
    def make(overrides: dict[str, Any] | None = None, substep: float = 5.0e-5) -> Bench:
        return Bench(robot, overrides or {}, substep)

    return make
