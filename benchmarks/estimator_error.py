"""How far what a policy believes of its speed is from the truth, what the error costs, and which estimators would do better.

1. Robots that differ as in training walk under a policy in the training simulator, with noise, commands and pushes as in
   training. Estimators learn from them by regression, all with the same number of gradient steps, and are judged on other
   robots: `observation` (o_t), `legs` (o_t and the velocity that each leg gives), `odometry` (their weighted mean and a
   correction, `policy.leg_odometry`), and each of these with observations from before; numbers are periods of 10 ms.
2. The policy walks the scenarios of `hqpipe validate` on the reference plant, sound and with worn valves, on its own
   estimate. Its own estimator and those of step 1 are judged on what it observed there, after the settling time.
3. With --drive it walks again with other estimates in the place of its own: the truth, or an estimator of step 1.

Run: python benchmarks/estimator_error.py POLICY [--steps 1500] [--estimators observation odometry …] [--scenarios forward_10 …]
     [--drive truth odometry …] [--drive-scenarios forward_10 …] [--seed 1500] [--out DIR]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gait_priors import RECIPES
from torch import Tensor, nn
from training import reference_actuator

from hqpipe.plant import Plant, PlantConfig
from hqpipe.plant.repeat import repeat
from hqpipe.plant.run import CONTACT_FORCE
from hqpipe.rl.config import CONTROL_PERIOD_S, TrainConfig, from_mapping
from hqpipe.rl.controller import HeadingHold, torch_controller
from hqpipe.rl.mirror import Mirror, mirror_layout
from hqpipe.rl.networks import LocomotionNetworks, Symmetric, mlp
from hqpipe.rl.normaliser import Normaliser
from hqpipe.rl.observation import build_state, rotate_inverse
from hqpipe.rl.odometry_estimator import OdometryEstimator
from hqpipe.rl.policy_io import load_policy
from hqpipe.rl.policy_spec import PolicySpec
from hqpipe.rl.task import LocomotionTask
from hqpipe.rl.walk_measures import SETTLING_S
from hqpipe.rl.worlds import training_world
from hqpipe.robots import RobotSpec, load_robot
from hqpipe.stages.walks.scenarios import SCENARIOS, _job

MACHINES: dict[str, dict[str, Any]] = {
    "sound": {},
    # Valves that are late, dead around zero and slow: robot.yaml has 0.5 ms, no overlap and 80 Hz.
    "worn valves": {"valve": {"delay": 0.008, "overlap": 0.05, "bandwidth_hz": 20}},
}
LEARN, JUDGE = (256, 101), (64, 202)  # robots and seed
PERIODS = 1000
BATCH, RATE, NORM = 2400, 1e-3, 1.0  # as in training
CHOICES: dict[str, tuple[str, tuple[int, ...]]] = {
    "observation": ("observation", (0,)),
    "legs": ("legs", (0,)),
    "odometry": ("odometry", (0,)),
    "observation 0 1 2 3": ("observation", (0, 1, 2, 3)),
    "observation 0 2 4 8": ("observation", (0, 2, 4, 8)),
    "legs 0 2 4 8": ("legs", (0, 2, 4, 8)),
}
"""Name → kind, and how many periods before the present one the observations were made."""
Estimate = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class Walks:
    """Observations and states of N robots over T periods.

    Attributes:
        seen: (T, N, n) o_t. true: (T, N, m) x_t. age: (T, N) periods since the episode began.
    """

    seen: Tensor
    true: Tensor
    age: Tensor

    def stacked(self, rows: Tensor, lags: tuple[int, ...]) -> Tensor:
        """(B, K n) observations of `lags` (K,) periods before rows (B,) of the flattened (T, N).

        The first of an episode stands for those before it.
        """
        robots = self.seen.shape[1]
        flat, age = self.seen.flatten(0, 1), self.age.flatten()[rows]
        return torch.cat([flat[rows - robots * age.clamp(max=lag)] for lag in lags], dim=-1)


class WithLegs(nn.Module):
    """A network that also sees what each leg of each of the K observations says of the speed."""

    def __init__(self, spec: PolicySpec, network: nn.Module, count: int) -> None:
        super().__init__()
        self.network, self.count, self.odometry = network, count, OdometryEstimator(spec, nn.Identity())

    def forward(self, observations: Tensor) -> Tensor:
        """(B, K n) → (B, m), normalised."""
        legs = [self.odometry.leg_velocities(each).flatten(1) for each in observations.chunk(self.count, dim=-1)]
        return self.network(torch.cat((observations, *legs), dim=-1))


class Estimator(nn.Module):
    """One of `CHOICES` for a policy: (B, K n) o_t in physical units → (B, m) x̃_t in physical units."""

    def __init__(self, spec: PolicySpec, name: str) -> None:
        super().__init__()
        kind, self.lags = CHOICES[name]
        count, n, m, legs = len(self.lags), spec.observation.size, spec.state.size, len(spec.feet)
        if kind == "odometry":
            network: nn.Module = OdometryEstimator(spec, _small(mlp(n + 3 * legs, spec.hidden, m + legs)))
        elif kind == "legs":
            network = WithLegs(spec, _small(mlp(count * (n + 3 * legs), spec.hidden, m)), count)
        else:
            network = _small(mlp(count * n, spec.hidden, m))
        if spec.symmetric:
            image, believed = (mirror_layout(layout, spec.feet) for layout in (spec.observation, spec.state))
            network = Symmetric(network, reduce(Mirror.beside, [image] * count), believed)
        self.network, self.count = network, count
        self.observation, self.state = Normaliser(spec.observation), Normaliser(spec.state)

    def normalised(self, observations: Tensor) -> Tensor:
        parts = [self.observation(each) for each in observations.chunk(self.count, dim=-1)]
        return self.network(torch.cat(parts, dim=-1))

    def forward(self, observations: Tensor) -> Tensor:
        with torch.no_grad():
            return self.state.restore(self.normalised(observations))


def _small(network: nn.Sequential) -> nn.Sequential:
    """With the initial output of a training."""
    with torch.no_grad():
        network[-1].weight.mul_(0.01)
    return network


def simulated_walks(
    robot: RobotSpec, spec: PolicySpec, networks: LocomotionNetworks, config: TrainConfig, robots: int, seed: int
) -> Walks:
    """`PERIODS` of `robots` under the policy without exploration."""
    world = training_world(robot, reference_actuator(robot), config, num_envs=robots, workers=1, seed=seed)
    task = LocomotionTask(robot, spec, world, config, training=True, seed=seed)
    rows, age = [], torch.zeros(PERIODS, robots, dtype=torch.int64)
    try:
        rows.append(torch.as_tensor(task.reset()))
        while len(rows) < PERIODS:
            with torch.no_grad():
                action = networks.action(rows[-1][:, : spec.observation.size])
            outcome = task.step(action.numpy())
            ended = torch.as_tensor(outcome.fell | outcome.timed_out)
            age[len(rows)] = torch.where(ended, 0, age[len(rows) - 1] + 1)
            rows.append(torch.as_tensor(outcome.observation))
    finally:
        world.close()
    return Walks(*torch.stack(rows).split([spec.observation.size, spec.state.size], dim=-1), age)


def learn(spec: PolicySpec, name: str, walks: Walks, steps: int) -> Estimator:
    """Regression on the walks, with the loss of a training; the same samples for every estimator."""
    torch.manual_seed(0)
    estimator, order = Estimator(spec, name), torch.Generator().manual_seed(1)
    optimiser = torch.optim.Adam(estimator.parameters(), lr=RATE)
    true = estimator.state(walks.true.flatten(0, 1))
    for _ in range(steps):
        rows = torch.randint(len(true), (BATCH,), generator=order)
        loss = nn.functional.mse_loss(estimator.normalised(walks.stacked(rows, estimator.lags)), true[rows])
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(estimator.parameters(), NORM)
        optimiser.step()
    return estimator.eval()


def plant_walk(
    folder: Path,
    spec: PolicySpec,
    networks: LocomotionNetworks,
    name: str,
    machine: str,
    seed: int,
    drive: Estimate | None,
) -> tuple[Walks, bool]:
    """A walk of a scenario as `hqpipe validate` has it, and whether it fell.

    Args:
        drive: from (1, n + m) o_t and x_t side by side to the (1, m) x̃_t that the actor gets; None for the policy's own.
    """
    robot, changes = load_robot(spec.robot), MACHINES[machine]
    job = _job(SCENARIOS[name], seed, None, changes, robot.folder)
    plant = Plant(robot, PlantConfig(changes).merged(PlantConfig(job.plant)), seed=job.seed)
    hold = HeadingHold(heading=0.0) if job.wz is None else None
    walker = torch_controller(folder, joints=robot.joints, heading_hold=hold)
    own, rule, rows = walker.infer, spec.target_rule(), []

    def infer(observation: np.ndarray) -> list[np.ndarray]:
        row = torch.as_tensor(np.concatenate((observation[0], _state(plant, spec)))[None])
        rows.append(row)
        if drive is None:
            return list(own(observation))
        layout, seen = spec.observation, row[:, : spec.observation.size]
        believed = drive(row)
        clock = seen[:, layout.part("clock")] if spec.has_clock else None
        with torch.no_grad():
            action = networks.action(seen, networks.normalise_state(believed))
        command = seen[:, layout.part("velocity_command")]
        return [rule.clipped(rule.unclipped(action, clock, command, torch), torch).numpy(), believed.numpy()]

    walker.infer = infer
    start = repeat(robot, job.seed)
    plant.reset(start.posture, start.heading)
    walker.phase = start.phase
    how = {"control_period_s": walker.period_s, "mode": walker.wiring.control_mode, "disturbances": job.disturbances}
    trial = plant.run(walker, job.seconds, command=start.command(job.vx, job.vy, job.wz or 0.0), **how)
    seen, true = torch.stack(rows).split([spec.observation.size, spec.state.size], dim=-1)
    return Walks(seen, true, torch.arange(len(rows))[:, None]), trial.fell


def _state(plant: Plant, spec: PolicySpec) -> np.ndarray:
    """(m,) x_t of the plant, heights above the level z = 0."""
    body = plant.body
    velocity = rotate_inverse(body.base_orientation, body.base_linear_velocity)
    gravity = rotate_inverse(body.base_orientation, np.array([0.0, 0.0, -1.0]))
    force, _ = plant.body.contacts()
    feet = spec.geometry.forward(body.joint_position.reshape(len(spec.feet), 3))
    soles = body.base_position[2] - feet @ gravity - spec.geometry.foot_radius
    contact = np.linalg.norm(force, axis=-1) > CONTACT_FORCE
    return build_state(velocity, gravity, np.asarray(body.base_position[2]), contact, soles)


def figures(spec: PolicySpec, believed: Tensor, true: Tensor) -> dict[str, float]:
    """RMS error and mean error of vx and vy (m/s), RMS length of the error of all three, share of wrong contacts."""
    velocity, contact = spec.state.part("base_linear_velocity"), spec.state.part("foot_contact")
    error = (believed - true)[:, velocity]
    rms, bias = error.square().mean(dim=0).sqrt(), error.mean(dim=0)
    wrong = (believed[:, contact] > 0.5) != (true[:, contact] > 0.5)
    return {
        "rms_vx": float(rms[0]),
        "rms_vy": float(rms[1]),
        "bias_vx": float(bias[0]),
        "bias_vy": float(bias[1]),
        "length": float(rms.norm()),
        "wrong_contact": float(wrong.float().mean()),
    }


def judged(
    spec: PolicySpec, walks: Walks, estimators: dict[str, Any], settling: int = 0
) -> dict[str, dict[str, float]]:
    """`figures` of every estimator on the walks from period `settling` on."""
    robots = walks.seen.shape[1]
    rows = torch.arange(settling * robots, walks.age.numel())
    true = walks.true.flatten(0, 1)[rows]
    table = {}
    for name, estimator in estimators.items():
        lags = getattr(estimator, "lags", (0,))
        believed = torch.cat([estimator(walks.stacked(part, lags)) for part in rows.split(10_000)])
        table[name] = figures(spec, believed, true)
    return table


def show(title: str, table: dict[str, dict[str, float]]) -> None:
    print(title)
    for name, row in table.items():
        print(f"  {name:24s}" + "  ".join(f"{key} {value:+.3f}" for key, value in row.items()), flush=True)


def main() -> None:
    arguments = _arguments()
    torch.set_num_threads(1)
    spec, networks = load_policy(arguments.policy)
    robot = load_robot(spec.robot)
    plan = {"engine": "mujoco", "gait": {"prior": spec.gait.prior}}
    config = from_mapping(from_mapping(TrainConfig(), plan), RECIPES[spec.gait.prior])
    tables: dict[str, Any] = {}

    def own(observation: Tensor) -> Tensor:
        return networks.normalise_state.restore(networks.estimate(observation))

    estimators: dict[str, Any] = {"of the policy": own}
    if arguments.estimators:
        walks = simulated_walks(robot, spec, networks, config, *LEARN)
        for name in arguments.estimators:
            estimators[name] = learn(spec, name, walks, arguments.steps)
    others = simulated_walks(robot, spec, networks, config, *JUDGE)
    tables["simulator"] = judged(spec, others, estimators)
    show("simulator, other robots", tables["simulator"])
    settling = round(SETTLING_S / CONTROL_PERIOD_S)
    size = spec.observation.size
    drives: dict[str, Estimate] = {"truth": lambda row: row[:, size:]}
    drives |= {name: lambda row, e=e: e(row[:, :size]) for name, e in estimators.items() if e is not own}
    runs = [(None, name) for name in arguments.scenarios]
    runs += [(drive, name) for drive in arguments.drive for name in arguments.drive_scenarios]
    for machine in MACHINES:
        for drive, name in runs:
            how = None if drive is None else drives[drive]
            walks, fell = plant_walk(arguments.policy, spec, networks, name, machine, arguments.seed, how)
            speed = walks.true[settling:, 0, :2].mean(dim=0).tolist()
            turning = float(walks.seen[settling:, 0, spec.observation.part("base_angular_velocity")][:, 2].mean())
            driven = "" if drive is None else f", driven by {drive}"
            title = f"{machine}, {name}{driven}"
            table = judged(spec, walks, estimators, settling)
            tables[title] = {"velocity": speed, "turning": turning, "fell": fell, "errors": table}
            fall = f", fell after {CONTROL_PERIOD_S * len(walks.seen):.0f} s" if fell else ""
            show(f"{title}: {speed[0]:.3f}, {speed[1]:.3f} m/s, {turning:.3f} rad/s{fall}", table)
    if arguments.out:
        arguments.out.write_text(json.dumps(tables, indent=1) + "\n", encoding="utf-8")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    single = [name for name, (_, lags) in CHOICES.items() if lags == (0,)]
    parser.add_argument("policy", type=Path, help="folder with policy.json and policy.safetensors")
    parser.add_argument("--estimators", nargs="*", choices=list(CHOICES), default=list(CHOICES))
    parser.add_argument("--steps", type=int, default=1500, help="gradient steps of each estimator")
    parser.add_argument("--scenarios", nargs="*", choices=list(SCENARIOS), default=list(SCENARIOS))
    parser.add_argument("--drive", nargs="*", choices=["truth", *single], default=[])
    parser.add_argument("--drive-scenarios", nargs="*", choices=list(SCENARIOS), default=["forward_10"])
    parser.add_argument("--seed", type=int, default=1500, help="of the walk on the plant")
    parser.add_argument("--out", type=Path, help="JSON with all tables")
    return parser.parse_args()


if __name__ == "__main__":
    main()
