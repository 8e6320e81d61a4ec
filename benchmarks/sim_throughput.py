"""How many policy steps (10 ms, 1 kHz physics and actuator) the training simulator makes per second.

Every row runs in the same minute on the same machine, standing robots with the hydraulic actuator model, so that the
rows can be compared even where other programs are busy. "engine alone" counts only the time inside the engine's own
step function, on one core. "SubprocVecEnv" is what one would write with Stable-Baselines3 alone, a robot in each process.

Run: python benchmarks/sim_throughput.py [--envs 128] [--steps 40] [--repeats 3]
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from functools import partial

import mujoco
import numpy as np
from plain_env import PlainEnv
from stable_baselines3.common.vec_env import SubprocVecEnv

from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.rl.config import GaitConfig
from hqpipe.rl.observation import observation_layout, state_layout
from hqpipe.robots import RobotSpec, load_robot
from hqpipe.sim.engine import DECIMATION, FRICTION, robot_setup
from hqpipe.sim.mujoco_model import robot_spec
from hqpipe.sim.pybullet_robot import load_robot_into, open_world, pybullet
from hqpipe.sim.world import BatchedWorld

GAINS = {"k1": 149_000.0, "k2": 0.05, "k3": 5_970.0, "k4": 0.0}  # k1 R² = 537 N·m/rad, k3 R² = 21.5 N·m·s/rad
PLAIN_ENVS = 8
SETTLE_STEPS = 100  # policy steps before the clock starts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--envs", type=int, default=128)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    robot = load_robot("hydraulic_quadruped")
    print(f"{_processor()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, Python {platform.python_version()}")
    print(f"mujoco {mujoco.__version__}, pybullet {pybullet.getAPIVersion()}, {arguments.envs} environments")
    print(f"{'':38s}{'policy steps/s':>16s}{'of the engine':>16s}")
    plain, bare = plain_pybullet(robot, arguments.steps, arguments.repeats)
    _row("pybullet, engine alone", bare, bare)
    _row("pybullet, plain Python loop", plain, bare)
    for processes in sorted({2, os.cpu_count() or 1}):
        rate = stable_baselines(robot, processes, arguments.steps, arguments.repeats)
        _row(f"pybullet, SubprocVecEnv, {processes} processes", rate, bare)
    for workers in (1, 2):
        _row(f"pybullet, our world, {workers} worker(s)", _world(robot, "pybullet", workers, arguments), bare)
    bare = bare_mujoco(robot, arguments.steps, arguments.repeats)
    _row("mujoco, engine alone", bare, bare)
    for workers in (1, 2):
        _row(f"mujoco, our world, {workers} worker(s)", _world(robot, "mujoco", workers, arguments), bare)


def _row(name: str, rate: float, bare: float) -> None:
    print(f"{name:38s}{rate:16.0f}{rate / bare:16.2f}", flush=True)


def _world(robot: RobotSpec, engine: str, workers: int, arguments: argparse.Namespace) -> float:
    """Best rate of a BatchedWorld over the repeats, policy steps/s."""
    actuator = Hydraulic.build(
        robot.joints,
        dt=0.001,
        sprocket_radius=robot.sprocket_radius,
        effort_limit=robot.effort_limit,
        **GAINS,
    )
    with BatchedWorld(robot, actuator, arguments.envs, engine=engine, workers=workers) as world:
        targets = np.tile(robot.nominal_position, (arguments.envs, 1))
        for _ in range(SETTLE_STEPS):
            world.step(targets)
        best = np.inf
        for _ in range(arguments.repeats):
            start = time.perf_counter()
            for _ in range(arguments.steps):
                world.step(targets)
            best = min(best, time.perf_counter() - start)
    return arguments.envs * arguments.steps / best


def plain_pybullet(robot: RobotSpec, steps: int, repeats: int) -> tuple[float, float]:
    """One client per environment and numpy for the actuator: rate of the loop, and of stepSimulation within it."""
    setup, envs = robot_setup(robot), []
    for _ in range(PLAIN_ENVS):
        client, _ = open_world()
        loaded = load_robot_into(client, setup, robot.urdf, FRICTION, (0.0, 0.0, robot.nominal_height))
        for joint, angle in zip(loaded.joints, robot.nominal_position, strict=True):
            pybullet.resetJointState(loaded.body, joint, angle, physicsClientId=client)
        envs.append((client, loaded, np.zeros(len(robot.joints))))
    k1, k3 = (GAINS[name] * robot.sprocket_radius**2 for name in ("k1", "k3"))
    fastest, fastest_inside = np.inf, np.inf
    for repeat in range(repeats + 1):
        count = steps if repeat else SETTLE_STEPS
        start, inside = time.perf_counter(), 0.0
        for _ in range(count * DECIMATION):
            for client, loaded, effort in envs:
                rows = pybullet.getJointStates(loaded.body, loaded.joints, physicsClientId=client)
                q, qd = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
                effort += k1 * (robot.nominal_position - q) - GAINS["k2"] * effort - k3 * qd
                np.clip(effort, -robot.effort_limit, robot.effort_limit, out=effort)
                pybullet.setJointMotorControlArray(
                    loaded.body, loaded.joints, pybullet.TORQUE_CONTROL, forces=effort, physicsClientId=client
                )
                before = time.perf_counter()
                pybullet.stepSimulation(physicsClientId=client)
                inside += time.perf_counter() - before
        if repeat:
            fastest = min(fastest, time.perf_counter() - start)
            fastest_inside = min(fastest_inside, inside)
    for client, _, _ in envs:
        pybullet.disconnect(physicsClientId=client)
    return PLAIN_ENVS * steps / fastest, PLAIN_ENVS * steps / fastest_inside


def stable_baselines(robot: RobotSpec, processes: int, steps: int, repeats: int) -> float:
    """Rate of Stable-Baselines3's `SubprocVecEnv`, a robot in each process, with an observation of the training's size."""
    gains = (GAINS["k1"] * robot.sprocket_radius**2, GAINS["k2"], GAINS["k3"] * robot.sprocket_radius**2)
    size = observation_layout(robot, GaitConfig().prior).size + state_layout(robot).size
    envs = SubprocVecEnv([partial(PlainEnv, gains, size)] * processes)
    try:
        envs.reset()
        actions = np.zeros((processes, len(robot.joints)), dtype=np.float32)
        fastest = np.inf
        for repeat in range(repeats + 1):
            count, start = steps if repeat else SETTLE_STEPS, time.perf_counter()
            for _ in range(count):
                envs.step(actions)
            if repeat:
                fastest = min(fastest, time.perf_counter() - start)
    finally:
        envs.close()
    return processes * steps / fastest


def bare_mujoco(robot: RobotSpec, steps: int, repeats: int) -> float:
    """Rate of mj_step alone, called from Python for a standing robot, policy steps/s."""
    setup = robot_setup(robot)
    model = robot_spec(setup, setup.variants[0]).compile()
    joints = [model.joint(name).id for name in robot.joints]
    place, dof = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    datas = [mujoco.MjData(model) for _ in range(PLAIN_ENVS)]
    for data in datas:
        data.qpos[2], data.qpos[place] = robot.nominal_height, robot.nominal_position
    best = np.inf
    for repeat in range(repeats + 1):
        inside, count = 0.0, steps if repeat else SETTLE_STEPS
        for _ in range(count * DECIMATION):
            for data in datas:
                error = robot.nominal_position - data.qpos[place]
                data.qfrc_applied[dof] = robot.stiff_pd.kp * error - robot.stiff_pd.kd * data.qvel[dof]
                before = time.perf_counter()
                mujoco.mj_step(model, data)
                inside += time.perf_counter() - before
        if repeat:
            best = min(best, inside)
    return PLAIN_ENVS * steps / best


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (FileNotFoundError, StopIteration):
        return platform.processor() or platform.machine()


if __name__ == "__main__":
    main()
