"""What an engine needs to know, as plain data that travels to worker processes as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from hqpipe.actuators.loops.actuator_step import PD
from hqpipe.robots import RobotSpec
from hqpipe.sim.state import WorldArrays

GRAVITY = 9.81  # m/s², standard gravity to three digits
PHYSICS_DT = 1.0e-3  # s; paper, sec. on training: simulation and position controller at 1000 Hz
DECIMATION = 10  # physics steps in a policy step; paper: policy at 100 Hz
FRICTION = 0.8  # rubber on dry concrete 0.6–0.9 (assumption)


@dataclass(frozen=True)
class RobotVariant:
    """One robot of a randomised family: its URDF as text, and its friction coefficient on the floor."""

    urdf: str
    friction: float = FRICTION


@dataclass(frozen=True)
class EngineSetup:
    """The robot and the time steps; environment i gets variant i mod K.

    Attributes:
        base_link, joints, foot_links: names in the URDF; arrays follow this order.
        shank_links: may touch the ground as the feet may.
        kind: of the actuator model, see hqpipe.actuators.loops.actuator_step.
        decimation: physics steps in one policy step.
    """

    base_link: str
    joints: tuple[str, ...]
    foot_links: tuple[str, ...]
    shank_links: tuple[str, ...]
    kind: int
    decimation: int
    variants: tuple[RobotVariant, ...]


def robot_setup(
    robot: RobotSpec,
    *,
    kind: int = PD,
    decimation: int = DECIMATION,
    variants: tuple[RobotVariant, ...] | None = None,
) -> EngineSetup:
    """The setup of `robot`; without `variants` of the exact robot alone."""
    return EngineSetup(
        base_link=robot.base_link,
        joints=robot.joints,
        foot_links=robot.foot_links,
        shank_links=robot.shank_links,
        kind=kind,
        decimation=decimation,
        variants=variants or (RobotVariant(robot.urdf.read_text(encoding="utf-8")),),
    )


class Engine(Protocol):
    """Steps the environments of some rows of the world's arrays.

    Attributes:
        PARALLEL: "processes" or "threads" – how several engines of this kind run side by side.
        BLOCK: environments are handed out in multiples of this number, so that the result does not depend on
            the number of workers.
    """

    PARALLEL: str
    BLOCK: int

    def __init__(self, setup: EngineSetup, arrays: WorldArrays, first: int) -> None:
        """`arrays` are the rows of the environments from number `first` on."""

    def step(self) -> None:
        """Advance by one policy step towards `arrays.targets`."""

    def reset(self) -> None:
        """Impose the state of the flagged rows and lower the flags."""

    def close(self) -> None:
        """Free the engine's memory."""
