"""How many environment steps a policy needs until it walks, and with which gait, by what it is given: the paper's
observation, a clock, a trot.

Every few iterations 32 robots that differ as in training, in another draw, walk under each of four commands for 30 s, and
stand under a fifth, with noise and without pushes, steered by nobody. A policy walks when none of them falls, their mean
motion is within 0.05 m/s and 0.05 rad/s of the command, and none that is to stand goes further than 0.1 m. The first rows of
each prior are the zero action.

Run: python benchmarks/gait_priors.py [--priors none clock trot_residual] [--steps 4000000] [--engine mujoco] [--actuator DIR]
     [--seed 1] [--set JSON] [--until-it-walks] [--csv FILE] [--policies DIR]
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from training import reference_actuator

from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.files import load_actuator
from hqpipe.rl.config import CONTROL_PERIOD_S, PRIORS, TrainConfig, from_mapping
from hqpipe.rl.evaluate import Actor, network_actor, zero_actor
from hqpipe.rl.policy_io import save_policy
from hqpipe.rl.task import LocomotionTask
from hqpipe.rl.train import Trainer
from hqpipe.rl.walk_measures import SETTLING_S, clearance, contact_schedule, wander
from hqpipe.rl.worlds import training_world
from hqpipe.robots import RobotSpec, load_robot

TOLERANCE = 0.05  # m/s and rad/s
WANDER = 0.1  # m, of a robot that is to stand: what `hqpipe validate` allows
COMMANDS = ((0.4, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.5), (0.0, 0.3, 0.0), (0.0, 0.0, 0.0))
RATE_HZ = 1.0 / CONTROL_PERIOD_S
# A gait that is learned from standing is that of the profile `learned`; what each of its numbers does: docs/theory/training.md.
# With a clock the feet follow the schedule of the trot.
_PIPELINE = yaml.safe_load((Path(__file__).parents[1] / "pipeline.yaml").read_text(encoding="utf-8"))
_TRAINING = _PIPELINE["profiles"]["learned"]["retrain"]["training"]
_RECIPE = ("curriculum", "command", "policy", "ppo", "randomisation", "reward")
LEARNED: dict[str, Any] = {name: _TRAINING[name] for name in _RECIPE}
WITH_CLOCK: dict[str, Any] = {**LEARNED, "reward": {**LEARNED["reward"], "gait_match": 1.0}}
RECIPES: dict[str, dict[str, Any]] = {"none": LEARNED, "clock": WITH_CLOCK, "trot_residual": {}}


@dataclass(frozen=True)
class Walk:
    """What the robots with one command did: the mean over those that stayed upright, or over all if none did.

    Attributes:
        command, velocity: vx, vy (m/s), ω (rad/s).
        robots, falls: counts.
        error: mean over the robots of the distance of the mean velocity from the command, m/s; yaw_error: likewise, rad/s.
        wander: m, the largest of the distances that the robots went from where they were after settling.
        lift: m, see `hqpipe.rl.walk_measures.clearance`.
        duty, frequency: share of the time that a foot stands, and strides per second.
        phase, regularity: of the feet, see `hqpipe.rl.walk_measures.Schedule`; mean over the robots on the circle.
    """

    command: tuple[float, float, float]
    velocity: tuple[float, float, float]
    robots: int
    falls: int
    error: float
    yaw_error: float
    wander: float
    lift: float
    duty: float
    frequency: float
    phase: tuple[float, ...]
    regularity: tuple[float, ...]

    @property
    def passed(self) -> bool:
        miss = np.subtract(self.velocity, self.command)
        stays = any(self.command) or self.wander <= WANDER
        return self.falls == 0 and stays and np.hypot(*miss[:2]) <= TOLERANCE and abs(miss[2]) <= TOLERANCE

    @property
    def miss(self) -> float:
        """How far from its command the robots were on average, m/s with turning at a lever of 1 m; a fall counts 1."""
        return self.falls / self.robots + self.error + self.yaw_error

    def row(self) -> dict[str, Any]:
        """As columns of a table."""
        row: dict[str, Any] = {}
        for name, value in vars(self).items():
            several = isinstance(value, tuple)
            row |= {f"{name}_{i}": each for i, each in enumerate(value)} if several else {name: value}
        return row

    def __str__(self) -> str:
        told = " ".join(f"{v:5.2f}" for v in self.velocity)
        feet = " ".join(f"{p:.2f}±{1.0 - r:.2f}" for p, r in zip(self.phase[1:], self.regularity[1:], strict=True))
        stood = "" if any(self.command) else f"went {100.0 * self.wander:.1f} cm, "
        return (
            f"{self.command!s:17s} {self.falls:>2} of {self.robots} fell, {told}, error {self.error:.3f} {self.yaw_error:.3f}, "
            f"{stood}lift {100.0 * self.lift:4.1f} cm, duty {self.duty:.2f}, {self.frequency:.2f} Hz, phases {feet}"
        )


class Exam:
    """The robots that a policy has to walk with."""

    def __init__(
        self, robot: RobotSpec, actuator: ActuatorModel, trainer: Trainer, robots: int, seconds: float, workers: int
    ) -> None:
        calm = replace(trainer.config.randomisation, push_interval_s=0.0)
        command = replace(trainer.config.command, ramp_s=0.0)
        config = replace(trainer.config, randomisation=calm, command=command, episode_s=2.0 * seconds)
        self.ramp = round(0.5 * trainer.config.command.ramp_s * RATE_HZ)  # periods, as in the exams of the training
        self.seed, self.robots, self.periods = config.seed + 1000, robots, round(seconds * RATE_HZ)
        self.commands = np.repeat(np.array(COMMANDS), robots, axis=0)
        world = training_world(robot, actuator, config, num_envs=len(self.commands), workers=workers, seed=self.seed)
        self.task = LocomotionTask(robot, trainer.spec, world, config, training=True, seed=self.seed)

    def hold(self, actor: Actor) -> list[Walk]:
        """Walk with `actor`: always the same starts and the same noise."""
        task, count = self.task, len(self.commands)
        task.rng = np.random.default_rng(self.seed)
        told = task.layout.part("velocity_command")
        observation, fell = task.reset(), np.zeros(count, dtype=bool)
        velocity, place = np.zeros((self.periods, count, 3)), np.zeros((self.periods, count, 2))
        height, contact = np.zeros((self.periods, count, 4)), np.zeros((self.periods, count, 4), dtype=bool)
        for period in range(self.periods):
            commands = self.commands if period >= self.ramp else self.commands * period / self.ramp
            task.set_commands(commands)  # whatever the training would draw
            observation[:, told] = commands
            outcome = task.step(actor(observation))
            observation = outcome.observation
            fell |= outcome.fell
            velocity[period], height[period] = task.base_velocity(), task.foot_height()
            contact[period] = task.world.state.foot_contact
            place[period] = task.world.state.base_position[:, :2]
        steady = slice(round(SETTLING_S * RATE_HZ), None)
        walks = []
        for command, rows in zip(COMMANDS, np.split(np.arange(count), len(COMMANDS)), strict=True):
            upright = rows[~fell[rows]] if not fell[rows].all() else rows
            seen = (values[steady, upright] for values in (velocity, place, height, contact))
            walks.append(_walk(command, int(fell[rows].sum()), self.robots, *seen))
        return walks


def _walk(
    command: tuple[float, float, float],
    falls: int,
    robots: int,
    velocity: np.ndarray,
    place: np.ndarray,
    height: np.ndarray,
    contact: np.ndarray,
) -> Walk:
    """Of (T, N, 3) velocities, (T, N, 2) m over ground, (T, N, L) m of the soles and (T, N, L) contacts of the N robots that
    count."""
    mean = velocity.mean(axis=0)
    miss = mean - command
    schedules = [contact_schedule(feet, RATE_HZ) for feet in contact.transpose(1, 0, 2)]
    lifts = [
        clearance(*both, RATE_HZ) for both in zip(height.transpose(1, 0, 2), contact.transpose(1, 0, 2), strict=True)
    ]
    turns = np.mean([s.regularity * np.exp(2j * np.pi * s.phase) for s in schedules], axis=0)
    return Walk(
        command=command,
        velocity=tuple(float(v) for v in mean.mean(axis=0)),
        robots=robots,
        falls=falls,
        error=float(np.hypot(miss[:, 0], miss[:, 1]).mean()),
        yaw_error=float(np.abs(miss[:, 2]).mean()),
        wander=max(wander(track) for track in place.transpose(1, 0, 2)),
        lift=float(np.mean(lifts)),
        duty=float(np.mean([s.duty for s in schedules])),
        frequency=float(np.mean([s.frequency for s in schedules])),
        phase=tuple(float(p) for p in np.angle(turns) / (2.0 * np.pi) % 1.0),
        regularity=tuple(float(r) for r in np.abs(turns)),
    )


def main() -> None:
    arguments = _arguments()
    robot = load_robot("hydraulic_quadruped")
    actuator = load_actuator(arguments.actuator) if arguments.actuator else reference_actuator(robot)
    print(
        f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {arguments.engine}, seed {arguments.seed}", flush=True
    )
    rows = [row for prior in arguments.priors for row in learn(robot, actuator, prior, arguments)]
    if arguments.csv:
        with arguments.csv.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, rows[0], lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)


def learn(robot: RobotSpec, actuator: ActuatorModel, prior: str, arguments: argparse.Namespace) -> list[dict]:
    """Train with `prior`; a row per exam and command."""
    never = arguments.steps // TrainConfig().rollout_size + 1  # iterations
    plan = {
        "total_steps": arguments.steps,
        "engine": arguments.engine,
        "gait": {"prior": prior},
        "checkpoint_interval": never,
        "evaluation": {"interval": never},
    }
    config = from_mapping(replace(TrainConfig(), seed=arguments.seed), plan)
    for changes in (RECIPES[prior], {"first_share": 0.0}, json.loads(arguments.set)):
        config = from_mapping(config, changes)
    options = {"control_mode": "position", "scratch": None, "report": None, "posterior": None, "stiffness": None}
    trainer = Trainer(robot, actuator, config, workers=arguments.workers, **options)
    exam = Exam(robot, actuator, trainer, arguments.robots, arguments.seconds, arguments.workers)
    size, rows, least, began = trainer.spec.observation.size, [], np.inf, time.perf_counter()

    networks = trainer.model.policy.networks

    def examine(actor: Actor, steps: int) -> bool:
        nonlocal least
        walks = exam.hold(actor)
        seconds = time.perf_counter() - began
        rows.extend({"prior": prior, "steps": steps, "seconds": seconds, **walk.row()} for walk in walks)
        passed = all(walk.passed for walk in walks)
        print(f"{prior}, {steps:,} steps, {seconds:.0f} s{', walks' if passed else ''}", *walks, sep="\n  ", flush=True)
        miss = sum(walk.miss for walk in walks)
        if arguments.policies and steps and miss < least:
            least = miss
            save_policy(arguments.policies / prior, trainer.spec, networks)
        return passed

    try:
        examine(zero_actor(len(robot.joints)), 0)
        progress = trainer._begin()
        while progress.iteration < config.iterations:
            trainer._iterate(progress)
            due = progress.iteration % arguments.interval == 0 or progress.iteration == config.iterations
            steps = progress.iteration * config.rollout_size
            if due and examine(network_actor(networks, size), steps) and arguments.until_it_walks:
                break
    finally:
        trainer.close()
        exam.task.world.close()
    return rows


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--priors", nargs="+", choices=PRIORS, default=list(PRIORS))
    parser.add_argument("--steps", type=int, default=4_000_000, help="budget of each prior")
    parser.add_argument("--interval", type=int, default=100, help="iterations of 9,600 steps between two exams")
    parser.add_argument("--robots", type=int, default=32, help="per command")
    parser.add_argument("--seconds", type=float, default=30.0, help="of a walk")
    parser.add_argument("--engine", default="mujoco")
    parser.add_argument("--actuator", type=Path, help="folder of a model; default: the coefficients of training.py")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", default="{}", help="fields of TrainConfig as JSON, on top of the recipe")
    parser.add_argument(
        "--until-it-walks", action="store_true", help="end a training with the first exam that is passed"
    )
    parser.add_argument("--csv", type=Path)
    parser.add_argument(
        "--policies", type=Path, help="folder for the policy of each prior that missed least in an exam"
    )
    return parser.parse_args()


if __name__ == "__main__":
    main()
