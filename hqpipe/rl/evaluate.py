"""Deterministic evaluation: how well a policy follows fixed commands in the simulator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from hqpipe.rl.config import CONTROL_PERIOD_S
from hqpipe.rl.networks import LocomotionNetworks
from hqpipe.rl.task import LocomotionTask
from hqpipe.rl.walk_measures import SETTLING_S

# Share of the time after which the robots are pushed, and the angle between the pushes of two neighbours: the golden
# angle spreads any number of directions evenly.
PUSH_TIME, PUSH_ANGLE = 2.0 / 3.0, np.pi * (3.0 - np.sqrt(5.0))
# A fall weighs as much as missing the command by 1 m/s over the whole trial; assumption.
FALL_PENALTY = 1.0

Actor = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class CommandResult:
    """What the robots with one command did.

    Attributes:
        command, velocity: vx, vy (m/s), ω (rad/s); the velocity is the mean in the base frame of those that did not
            fall, or of all if all fell.
        error: mean of |(vx, vy) − command|, m/s; yaw_error: of |ω − command|, rad/s.
        falls, robots: counts.
        foot_clearance: lowest of the feet's highest lifts, m.
        saturation: share of the joint samples at the effort limit.
    """

    command: tuple[float, float, float]
    velocity: tuple[float, float, float]
    error: float
    yaw_error: float
    falls: int
    robots: int
    foot_clearance: float
    saturation: float


@dataclass(frozen=True)
class Evaluation:
    """Results per command, and one number to compare policies by (lower is better)."""

    results: tuple[CommandResult, ...]

    @property
    def falls(self) -> int:
        return sum(r.falls for r in self.results)

    @property
    def robots(self) -> int:
        return sum(r.robots for r in self.results)

    @property
    def score(self) -> float:
        """Mean of the errors, half weight for turning, plus the share of falls."""
        errors = [r.error + 0.5 * r.yaw_error if r.falls < r.robots else FALL_PENALTY for r in self.results]
        return float(np.mean(errors)) + FALL_PENALTY * self.falls / self.robots

    def to_dict(self) -> dict[str, Any]:
        return {
            "score": self.score,
            "falls": self.falls,
            "robots": self.robots,
            "commands": [asdict(r) for r in self.results],
        }

    @classmethod
    def from_dict(cls, raw: dict[str, Any]) -> Evaluation:
        """Inverse of `to_dict`."""
        rows = [{**r, "command": tuple(r["command"]), "velocity": tuple(r["velocity"])} for r in raw["commands"]]
        return cls(tuple(CommandResult(**r) for r in rows))


def network_actor(networks: LocomotionNetworks, observation_size: int) -> Actor:
    """The mean action of the networks as a function of numpy observations (N, n)."""

    def act(observation: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            seen = torch.as_tensor(np.ascontiguousarray(observation[:, :observation_size]))
            return networks.action(seen).numpy()

    return act


def zero_actor(joints: int) -> Actor:
    """The prior alone: what the robot does before it has learned anything."""
    return lambda observation: np.zeros((len(observation), joints), dtype=np.float32)


def evaluate(
    actor: Actor,
    task: LocomotionTask,
    commands: Sequence[Sequence[float]],
    seconds: float,
    push_speed: float = 0.0,
) -> Evaluation:
    """Run every robot of `task` with one of `commands` for `seconds`, from standing.

    The robots are dealt out to the commands in turn; those with the same command differ by the randomisation of the
    world and the direction of the push. With `push_speed` (m/s) zero nobody is pushed and speeds are averaged to
    the end.
    """
    order = np.arange(task.count) % len(commands)
    wanted = np.asarray(commands, dtype=float)[order]
    steps = round(seconds / CONTROL_PERIOD_S)
    start = min(round(SETTLING_S / CONTROL_PERIOD_S), steps // 2)
    end = steps if push_speed == 0.0 else max(start + 1, round(PUSH_TIME * steps))
    task.reset()
    task.set_commands(wanted)
    observation = task.observe()
    fell = np.zeros(task.count, dtype=bool)
    velocity = np.zeros((steps, task.count, 3))
    lift = np.zeros((task.count, len(task.robot.feet)))
    saturated = np.zeros(task.count)
    for i in range(steps):
        if i == end:
            angle = PUSH_ANGLE * np.arange(task.count)
            task.push(np.arange(task.count), push_speed * np.stack((np.cos(angle), np.sin(angle)), axis=1))
        outcome = task.step(actor(observation))
        observation = outcome.observation
        fell |= outcome.fell
        velocity[i] = task.base_velocity()
        if start <= i < end:
            lift = np.maximum(lift, task.foot_height())
            effort = np.abs(task.world.state.joint_effort)
            saturated += (effort >= 0.999 * task.robot.effort_limit).mean(axis=1) / (end - start)
    measured = _Measured(velocity[start:end], fell, lift, saturated)
    return Evaluation(tuple(measured.summary(tuple(map(float, c)), order == i) for i, c in enumerate(commands)))


@dataclass(frozen=True)
class _Measured:
    """velocity (T, N, 3) vx, vy, ω; fell (N,); lift (N, L) m; saturated (N,) share of joint samples at the limit."""

    velocity: np.ndarray
    fell: np.ndarray
    lift: np.ndarray
    saturated: np.ndarray

    def summary(self, command: tuple[float, float, float], rows: np.ndarray) -> CommandResult:
        falls, robots = int(self.fell[rows].sum()), int(rows.sum())
        upright = rows & ~self.fell if falls < robots else rows
        mean = self.velocity[:, upright].mean(axis=0)
        miss = mean - np.asarray(command)
        return CommandResult(
            command=command,
            velocity=tuple(float(v) for v in mean.mean(axis=0)),
            error=float(np.hypot(miss[:, 0], miss[:, 1]).mean()),
            yaw_error=float(np.abs(miss[:, 2]).mean()),
            falls=falls,
            robots=robots,
            foot_clearance=float(self.lift[upright].mean(axis=0).min()),
            saturation=float(self.saturated[upright].mean()),
        )
