"""How many environment steps a policy needs until it walks, by what it is given: the paper's observation, a clock, a trot.

Every few iterations 32 robots that differ as in training, in another draw, walk at 1.0 m/s for 30 s with noise and without
pushes, steered by nobody. A policy walks when none of them falls and their mean speed is within 5 %; the training ends there
or with its budget. The first row of each prior is the zero action.

Run: python benchmarks/gait_priors.py [--priors none clock trot_residual] [--steps 4000000] [--engine mujoco] [--actuator DIR]
     [--csv FILE]
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from training import reference_actuator

from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.files import load_actuator
from hqpipe.rl.config import CONTROL_PERIOD_S, PRIORS, CommandConfig, TrainConfig, from_mapping
from hqpipe.rl.evaluate import Actor, network_actor, zero_actor
from hqpipe.rl.task import LocomotionTask
from hqpipe.rl.train import Trainer
from hqpipe.rl.walk_measures import SETTLING_S
from hqpipe.rl.worlds import training_world
from hqpipe.robots import RobotSpec, load_robot

ROBOTS, SECONDS, SPEED, TOLERANCE = 32, 30.0, 1.0, 0.05
# Without a trot to start from, exploration has to be wide and the penalties have to come late.
_FROM_NOTHING = {"policy": {"initial_log_std": -1.0, "final_log_std": -1.0}, "curriculum": {"iterations": 150}}
RECIPES = {
    "none": {**_FROM_NOTHING, "reward": {"airtime": 0.3, "gait_match": 0.0}},
    "clock": _FROM_NOTHING,
    "trot_residual": {},
}


@dataclass(frozen=True)
class Walk:
    """What the robots of one exam did; speed in m/s, the mean over those that stayed upright, or over all if none did."""

    falls: int
    speed: float

    @property
    def passed(self) -> bool:
        return self.falls == 0 and abs(self.speed / SPEED - 1.0) <= TOLERANCE


class Exam:
    """The robots that a policy has to walk with."""

    def __init__(self, robot: RobotSpec, actuator: ActuatorModel, trainer: Trainer, workers: int) -> None:
        straight = CommandConfig((SPEED, SPEED), (0.0, 0.0), (0.0, 0.0), standing_share=0.0, straight_share=1.0)
        calm = replace(trainer.config.randomisation, push_interval_s=0.0)
        config = replace(trainer.config, command=straight, randomisation=calm, episode_s=2.0 * SECONDS)
        self.seed = config.seed + 1000
        world = training_world(robot, actuator, config, num_envs=ROBOTS, workers=workers, seed=self.seed)
        self.task = LocomotionTask(robot, trainer.spec, world, config, training=True, seed=self.seed)

    def hold(self, actor: Actor) -> Walk:
        """Walk with `actor`: always the same starts and the same noise."""
        task = self.task
        task.rng = np.random.default_rng(self.seed)
        observation, fell = task.reset(), np.zeros(ROBOTS, dtype=bool)
        speeds = []
        for step in range(round(SECONDS / CONTROL_PERIOD_S)):
            outcome = task.step(actor(observation))
            observation = outcome.observation
            fell |= outcome.fell
            if step * CONTROL_PERIOD_S >= SETTLING_S:
                speeds.append(task.base_velocity()[:, 0])
        upright = ~fell if not fell.all() else np.ones(ROBOTS, dtype=bool)
        return Walk(int(fell.sum()), float(np.mean(speeds, axis=0)[upright].mean()))


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
    """Train with `prior` until the exam is passed or the budget spent; a row per exam."""
    chosen = {
        "total_steps": arguments.steps,
        "engine": arguments.engine,
        "gait": {"prior": prior},
        "checkpoint_interval": arguments.steps,
        "evaluation": {"interval": arguments.steps},
    }
    recipe = RECIPES[prior]
    policy = {**recipe.get("policy", {}), "symmetric": prior != "none"}  # the paper's policy prefers a side if it likes
    config = replace(from_mapping(TrainConfig(), {**chosen, **recipe, "policy": policy}), seed=arguments.seed)
    options = {"control_mode": "position", "scratch": None, "report": None, "posterior": None, "stiffness": None}
    trainer = Trainer(robot, actuator, config, workers=arguments.workers, **options)
    exam = Exam(robot, actuator, trainer, arguments.workers)
    size, rows, began = trainer.spec.observation.size, [], time.perf_counter()

    def examine(actor: Actor, steps: int) -> bool:
        walk = exam.hold(actor)
        seconds = time.perf_counter() - began
        rows.append({"prior": prior, "steps": steps, "falls": walk.falls, "speed": walk.speed, "seconds": seconds})
        told = f"{walk.falls:>3} of {ROBOTS} fell, {walk.speed:5.2f} m/s"
        print(f"{prior:14s}{steps:>10,} steps  {told}  {seconds:6.0f} s{'  walks' if walk.passed else ''}", flush=True)
        return walk.passed

    try:
        examine(zero_actor(len(robot.joints)), 0)
        progress = trainer._begin()
        while progress.iteration < config.iterations:
            trainer._iterate(progress)
            due = progress.iteration % arguments.interval == 0 or progress.iteration == config.iterations
            steps = progress.iteration * config.rollout_size
            if due and examine(network_actor(trainer.model.policy.networks, size), steps):
                break
    finally:
        trainer.close()
        exam.task.world.close()
    return rows


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--priors", nargs="+", choices=PRIORS, default=list(PRIORS))
    parser.add_argument("--steps", type=int, default=4_000_000, help="budget of each prior")
    parser.add_argument("--interval", type=int, default=12, help="iterations of 9,600 steps between two exams")
    parser.add_argument("--engine", default="mujoco")
    parser.add_argument("--actuator", type=Path, help="folder of a model; default: the coefficients of training.py")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--csv", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main()
