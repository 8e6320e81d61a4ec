"""How fast and how well a policy learns to walk: learning curve, speeds, falls, environment steps per second.

The actuator is the paper's model with the coefficients of the packaged robot's reference plant. Every policy is judged
beside the zero action, on robots of another seed, with noise, randomised bodies and actuators, and pushes.

Run: python benchmarks/training.py [--steps 200000] [--engine pybullet] [--prior trot_residual] [--profile]
     [--figure walk.png]
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.rl.config import CONTROL_PERIOD_S, ActuatorRandomisationConfig, TrainConfig, from_mapping
from hqpipe.rl.evaluate import Actor, Evaluation, network_actor, zero_actor
from hqpipe.rl.policy_spec import PolicySpec
from hqpipe.rl.task import LocomotionTask
from hqpipe.rl.train import Trainer, TrainResult, train
from hqpipe.rl.worlds import evaluation_world, training_world
from hqpipe.robots import RobotSpec, load_robot

# k1 R² = 362 N·m/rad, k2, k3 R² = 14.4 N·m·s/rad, k4 R = 1.69/rad, fitted to 10 s of an open-loop trot on the plant.
COEFFICIENTS = {"k1": 362.0 / 0.06**2, "k2": 0.0825, "k3": 14.4 / 0.06**2, "k4": 1.69 / 0.06}
ROBOTS, SECONDS, PUSH_SPEED, PUSH_INTERVAL, SPREAD = 64, 8.0, 1.2, 2.0, 0.3
WALK_SECONDS = 4.0


def main() -> None:
    arguments = _arguments()
    robot = load_robot("hydraulic_quadruped")
    actuator = reference_actuator(robot)
    chosen = {"total_steps": arguments.steps, "engine": arguments.engine, "gait": {"prior": arguments.prior}}
    config = replace(from_mapping(TrainConfig(), chosen), seed=arguments.seed)
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    trained = profiled if arguments.profile else train
    result = trained(robot, actuator, config, workers=arguments.workers)
    every = max(1, len(result.rows) // 10)
    for row in result.rows[::every]:
        print(
            f"{row['time/total_timesteps']:>9} steps  reward {row['rollout/reward_mean']:.4f}  "
            f"falls {row['rollout/falls']:>3}  kl {row['train/approx_kl']:.4f}  "
            f"estimator {row['train/estimator_loss']:.3f}"
        )
    print(f"{result.steps_per_second:.0f} environment steps/s, best after {result.best_iteration} iterations")
    actors = {
        "zero action": zero_actor(len(robot.joints)),
        "policy": network_actor(result.networks, result.spec.observation.size),
    }
    for (name, actor), evaluation in zip(actors.items(), (result.baseline, result.best), strict=True):
        print(f"{name}: {_speeds(evaluation)}")
        print(f"  disturbed: {_disturbed(actor, robot, actuator, result.spec, config, arguments.workers)}")
    if arguments.figure:
        _draw_walk(actors["policy"], robot, actuator, result.spec, config, arguments.figure)


def reference_actuator(robot: RobotSpec) -> ActuatorModel:
    """The paper's model with the coefficients of the packaged robot's plant."""
    return Hydraulic.build(
        robot.joints,
        dt=1e-3,
        sprocket_radius=robot.sprocket_radius,
        effort_limit=robot.effort_limit,
        **COEFFICIENTS,
    )


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=200_000)
    parser.add_argument("--engine", default="pybullet")
    parser.add_argument("--prior", default="trot_residual")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--profile", action="store_true", help="also print where the time goes")
    return parser.parse_args()


def profiled(robot: RobotSpec, actuator: ActuatorModel, config: TrainConfig, *, workers: int) -> TrainResult:
    """`train`, and a table of where its time went."""
    options = {"control_mode": "position", "scratch": None, "report": None, "posterior": None, "stiffness": None}
    trainer = Trainer(robot, actuator, config, workers=workers, **options)
    seconds = {
        "simulator": _timed(trainer.task.world, "step"),
        "environment": _timed(trainer.task, "step"),
        "rollout": _timed(trainer.model, "collect_rollouts"),
        "update": _timed(trainer.model, "train"),
    }
    start = time.perf_counter()
    result = trainer.run()
    total = time.perf_counter() - start
    took = {name: sum(times) for name, times in seconds.items()}
    shares = {
        "simulator with its actuators": took["simulator"],
        "rewards, observations, resets": took["environment"] - took["simulator"],
        "policy in the rollout, buffer": took["rollout"] - took["environment"],
        "PPO's update": took["update"],
        "evaluations and the rest": total - took["rollout"] - took["update"],
    }
    for name, value in shares.items():
        print(f"{name:32s}{value:8.1f} s{100.0 * value / total:6.1f} %")
    return result


def _timed(owner: Any, name: str) -> list[float]:
    """Replace a method by one that writes down how long each call takes, s."""
    times: list[float] = []
    method = getattr(owner, name)

    def inner(*arguments: Any, **options: Any) -> Any:
        start = time.perf_counter()
        try:
            return method(*arguments, **options)
        finally:
            times.append(time.perf_counter() - start)

    setattr(owner, name, inner)
    return times


def _speeds(evaluation: Evaluation) -> str:
    speeds = ", ".join(f"{r.command[0]:g} → {r.velocity[0]:.2f}" for r in evaluation.results)
    return f"{speeds} m/s; {evaluation.falls} of {evaluation.robots} fell; score {evaluation.score:.3f}"


def _disturbed(
    actor: Actor,
    robot: RobotSpec,
    actuator: ActuatorModel,
    spec: PolicySpec,
    config: TrainConfig,
    workers: int,
) -> str:
    """Falls and mean speed error of robots that are pushed hard and differ more than in training."""
    harder = replace(
        config,
        randomisation=replace(
            config.randomisation,
            actuator=ActuatorRandomisationConfig("half_range", half_range=SPREAD),
            friction=0.4,
            kinematics=2.0,
            push_speed=PUSH_SPEED,
            push_interval_s=PUSH_INTERVAL,
        ),
    )
    seed = config.seed + 1000
    world = training_world(robot, actuator, harder, num_envs=ROBOTS, workers=workers, seed=seed)
    task = LocomotionTask(robot, spec, world, harder, training=True, seed=seed)
    observation, falls, errors = task.reset(), 0, []
    for _ in range(round(SECONDS / CONTROL_PERIOD_S)):
        outcome = task.step(actor(observation))
        observation = outcome.observation
        falls += int(outcome.fell.sum())
        errors.append(np.abs(task.base_velocity() - task.command).mean(axis=0))
    world.close()
    vx, vy, wz = np.mean(errors, axis=0)
    return f"{falls} falls in {ROBOTS * SECONDS:.0f} robot seconds, error {vx:.2f}, {vy:.2f} m/s, {wz:.2f} rad/s"


def _draw_walk(
    actor: Actor,
    robot: RobotSpec,
    actuator: ActuatorModel,
    spec: PolicySpec,
    config: TrainConfig,
    path: Path,
) -> None:
    """Speed, soles, contacts and torques of one robot at 1 m/s."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    single = replace(config, evaluation=replace(config.evaluation, num_envs=len(config.evaluation.commands)))
    world = evaluation_world(robot, actuator, single, workers=1)
    task = LocomotionTask(robot, spec, world, single, training=False, seed=0)
    task.reset()
    task.set_commands(np.tile([1.0, 0.0, 0.0], (task.count, 1)))
    steps = round(WALK_SECONDS / CONTROL_PERIOD_S)
    speed, sole, contact, torque = [np.zeros((steps, n)) for n in (1, 4, 4, 12)]
    observation = task.observe()
    for i in range(steps):
        observation = task.step(actor(observation)).observation
        speed[i], sole[i] = task.base_velocity()[0, 0], task.foot_height()[0]
        contact[i], torque[i] = world.state.foot_contact[0], world.state.joint_effort[0]
    world.close()
    time = np.arange(steps) * CONTROL_PERIOD_S
    figure, axes = pyplot.subplots(4, 1, sharex=True, figsize=(9, 9), layout="constrained")
    axes[0].plot(time, speed)
    axes[1].plot(time, 100.0 * sole, label=robot.feet)
    axes[2].imshow(contact.T, aspect="auto", cmap="Greys", extent=(0, WALK_SECONDS, 3.5, -0.5), interpolation="nearest")
    axes[2].set_yticks(range(4), robot.feet)
    axes[3].plot(time, torque[:, 2::3], label=[name for name in robot.joints if name.endswith("K")])
    axes[3].axhline(robot.effort_limit[0], color="0.6", linestyle=":")
    for axis, label in zip(axes, ("speed (m/s)", "sole (cm)", "contact", "knee torque (N·m)"), strict=True):
        axis.set_ylabel(label)
    axes[1].legend(ncols=4, frameon=False)
    axes[3].legend(ncols=4, frameon=False)
    axes[3].set_xlabel("time (s)")
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
