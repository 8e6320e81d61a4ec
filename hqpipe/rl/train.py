"""Training: PPO over the batched simulator with evaluations, checkpoints and a metrics table."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure

from hqpipe.actuators.posterior import Posterior
from hqpipe.errors import DivergedError
from hqpipe.rl.actuator_draws import draws_report
from hqpipe.rl.checkpoint import Progress, load_checkpoint, save_checkpoint
from hqpipe.rl.config import TrainConfig, to_mapping
from hqpipe.rl.curriculum import curriculum_factor, widest_log_std
from hqpipe.rl.env import LocomotionVecEnv
from hqpipe.rl.evaluate import Evaluation, evaluate, network_actor, zero_actor
from hqpipe.rl.networks import LocomotionNetworks
from hqpipe.rl.policy import LocomotionPolicy
from hqpipe.rl.policy_spec import PolicySpec
from hqpipe.rl.ppo import ConcurrentPPO
from hqpipe.rl.task import LocomotionTask
from hqpipe.rl.worlds import actuator_seed, evaluation_world, training_actuators, training_world
from hqpipe.robots import RobotSpec

Report = Callable[[int, int, str], None]


@dataclass(frozen=True)
class TrainResult:
    """A trained policy and how it came about.

    Attributes:
        spec, networks: the policy with the best evaluation.
        rows: one mapping per iteration, keys as in Stable-Baselines3; the same seed gives the same rows.
        baseline: evaluation of the prior alone (zero action). best: of the policy.
        best_iteration: after which it was taken; 0 is the untrained policy.
        steps_per_second: environment steps, everything included; resumed_from: iteration of the checkpoint, or 0.
        actuators: how the actuators of the robots differed, see `hqpipe.rl.actuator_draws.draws_report`.
    """

    spec: PolicySpec
    networks: LocomotionNetworks
    rows: list[dict[str, Any]]
    baseline: Evaluation
    best: Evaluation
    best_iteration: int
    steps_per_second: float
    resumed_from: int
    actuators: dict[str, Any]


class _TermMeter(BaseCallback):
    """Mean of each weighted reward term over a rollout."""

    def __init__(self, env: LocomotionVecEnv) -> None:
        super().__init__()
        self.env = env
        self.sums: dict[str, float] = {}
        self.count = self.falls = 0
        self.reward = 0.0

    def _on_rollout_start(self) -> None:
        self.sums, self.count, self.falls, self.reward = {}, 0, 0, 0.0

    def _on_step(self) -> bool:
        outcome = self.env.last
        self.count += 1
        self.falls += int(outcome.fell.sum())
        self.reward += float(outcome.reward.mean())
        for name, value in outcome.terms.items():
            self.sums[name] = self.sums.get(name, 0.0) + value
        return True

    def means(self) -> dict[str, float]:
        return {
            "rollout/reward_mean": self.reward / self.count,
            "rollout/falls": self.falls,
            **{f"reward/{name}": value / self.count for name, value in self.sums.items()},
        }


class Trainer:
    """One training; `run` does it all.

    Args:
        actuator: instance of an actuator model, joints matched by name.
        control_mode: what the joint targets are on the machine, position or torque; goes into the policy's spec.
        scratch: folder of the checkpoint. report: progress(done, total, note) in environment steps.
        workers: processes of the simulator; they do not change the result.
        posterior: of the actuator's parameters, for the randomisation; None if it has none.
        stiffness: (J,) static stiffness that the trot compensates, N·m/rad, joints as in the robot; None takes the
            actuator's own.

    Raises:
        DivergedError: a gradient or the reward is not finite.
    """

    def __init__(
        self,
        robot: RobotSpec,
        actuator: Any,
        config: TrainConfig,
        *,
        control_mode: str,
        scratch: Path | None,
        report: Report | None,
        workers: int,
        posterior: Posterior | None,
        stiffness: np.ndarray | None,
    ) -> None:
        torch.set_num_threads(config.torch_threads)
        self.config, self.scratch, self.report = config, scratch, report
        self.spec = PolicySpec.build(robot, actuator, config, control_mode, stiffness)
        options: dict[str, Any] = {"num_envs": config.num_envs, "seed": config.seed, "posterior": posterior}
        table = training_actuators(robot, actuator, config, **options)
        model = actuator.for_joints(robot.joints)
        self.actuators = draws_report(
            model, config.randomisation.actuator, posterior, table, actuator_seed(config.seed)
        )
        self.fingerprint = _fingerprint(robot, actuator, config, self.spec, table)
        self._worlds = lambda engine: (
            training_world(robot, actuator, config, workers=workers, engine=engine, **options),
            evaluation_world(robot, actuator, config, workers=workers, engine=engine),
        )
        self.engine = config.engine_of(0)
        world, trial_world = self._worlds(self.engine)
        self.task = LocomotionTask(robot, self.spec, world, config, training=True, seed=config.seed)
        self.trial = LocomotionTask(robot, self.spec, trial_world, config, training=False, seed=config.seed)
        self.env = LocomotionVecEnv(self.task)
        self.model = self._model()
        self.meter = _TermMeter(self.env)

    def _model(self) -> ConcurrentPPO:
        p = self.config.policy
        model = ConcurrentPPO(
            LocomotionPolicy,
            self.env,
            config=self.config.ppo,
            seed=self.config.seed,
            policy_kwargs={
                "spec": self.spec,
                "initial_log_std": p.initial_log_std,
                "output_gain": p.output_gain,
                "critic_learning_rate": self.config.ppo.critic_learning_rate,
                "estimator_learning_rate": self.config.ppo.estimator_learning_rate,
            },
        )
        model.set_logger(configure(None, []))
        return model

    def run(self) -> TrainResult:
        """Train to the end, from the last checkpoint of this very training if there is one."""
        began = time.perf_counter()
        progress = self._begin()
        first, total = progress.iteration, self.config.iterations
        try:
            while progress.iteration < total:
                self._iterate(progress)
                self._after_iteration(progress)
            networks = LocomotionNetworks(self.spec)
            networks.load_state_dict(progress.best)
        except DivergedError as error:
            error.rows = progress.rows
            raise
        finally:
            self.close()
        steps = (total - first) * self.config.rollout_size
        return TrainResult(
            spec=self.spec,
            networks=networks,
            rows=progress.rows,
            baseline=Evaluation.from_dict(progress.baseline),
            best=Evaluation.from_dict(progress.best_evaluation),
            best_iteration=progress.best_iteration,
            steps_per_second=steps / (time.perf_counter() - began),
            resumed_from=first,
            actuators=self.actuators,
        )

    def close(self) -> None:
        """End the simulator's processes."""
        self.task.world.close()
        self.trial.world.close()

    def _begin(self) -> Progress:
        self.model._setup_learn(self.config.total_steps, self.meter)
        self.meter.init_callback(self.model)
        progress = None
        if self.scratch is not None:
            progress = load_checkpoint(self.scratch, self.fingerprint, self.model, self.task)
        progress = progress or Progress()
        self._enter_engine(progress)
        self._restart_episodes()
        return progress

    def _enter_engine(self, progress: Progress) -> None:
        """Go on in the engine of the next iteration; where a new one begins, what was best in the one before does not count."""
        engine = self.config.engine_of(progress.iteration)
        if engine != self.engine:
            self.close()
            self.task.world, self.trial.world = self._worlds(engine)
            self.engine = engine
        if progress.iteration in (0, self.config.first_iterations):
            progress.best, progress.best_evaluation, progress.best_iteration = {}, {}, 0
            baseline = evaluate(zero_actor(len(self.spec.joints)), self.trial, *self._trial_plan())
            progress.baseline = baseline.to_dict()

    def _restart_episodes(self) -> None:
        """Reset every robot, so that what follows depends on the random state and the networks alone."""
        self.model._last_obs = self.env.reset()
        self.model._last_episode_starts[:] = True

    def _iterate(self, progress: Progress) -> None:
        model, config = self.model, self.config
        self.task.curriculum = curriculum_factor(config.curriculum, progress.iteration)
        model.policy.limit_exploration(widest_log_std(config.policy, progress.iteration, config.iterations))
        model.collect_rollouts(self.env, self.meter, model.rollout_buffer, config.ppo.n_steps)
        model.train()
        if not math.isfinite(self.meter.reward):
            raise DivergedError("the training diverged: the mean reward is not a number; lower ppo.learning_rate")
        progress.iteration += 1
        row = {"iteration": progress.iteration, "time/total_timesteps": model.num_timesteps}
        episodes = list(model.ep_info_buffer)
        for name, key in (("ep_len_mean", "l"), ("ep_rew_mean", "r")):
            row[f"rollout/{name}"] = sum(e[key] for e in episodes) / len(episodes) if episodes else None
        row |= self.meter.means()
        row["curriculum/factor"] = self.task.curriculum
        row |= {key: value for key, value in model.logger.name_to_value.items()}
        model.logger.dump(progress.iteration)
        progress.rows.append(row)

    def _after_iteration(self, progress: Progress) -> None:
        config, i = self.config, progress.iteration
        row, last = progress.rows[-1], i == config.iterations
        if last or i % config.evaluation.interval == 0:
            evaluation = self._evaluate(self.model.policy.networks)
            row["eval/score"] = evaluation.score
            row["eval/falls"] = evaluation.falls
            row["eval/speed"] = evaluation.results[0].velocity[0]
            row["eval/velocity_error"] = sum(result.error for result in evaluation.results) / len(evaluation.results)
            if not progress.best or evaluation.score < progress.best_evaluation["score"]:
                state = self.model.policy.networks.state_dict()
                progress.best = {k: v.clone() for k, v in state.items()}
                progress.best_evaluation, progress.best_iteration = evaluation.to_dict(), i
        if i % config.checkpoint_interval == 0 and not last:
            if self.scratch is not None:
                save_checkpoint(self.scratch, self.fingerprint, self.model, self.task, progress)
            self._enter_engine(progress)
            self._restart_episodes()
        if self.report is not None:
            note = f"reward {row['rollout/reward_mean']:.3f}, falls {row['rollout/falls']}"
            self.report(i * config.rollout_size, config.iterations * config.rollout_size, note)

    def _evaluate(self, networks: LocomotionNetworks) -> Evaluation:
        actor = network_actor(networks, self.spec.observation.size)
        return evaluate(actor, self.trial, *self._trial_plan())

    def _trial_plan(self) -> tuple[Any, float, float]:
        e = self.config.evaluation
        return e.commands, e.seconds, e.push_speed


def _fingerprint(
    robot: RobotSpec, actuator: Any, config: TrainConfig, spec: PolicySpec, table: np.ndarray | None
) -> str:
    """Names a training, so that a checkpoint of another one is never resumed; `table` as of `training_actuators`."""
    drawn = "" if table is None else hashlib.sha256(table.tobytes()).hexdigest()
    parts = [robot.hash, actuator.to_dict(), to_mapping(config), spec.to_dict(), drawn, torch.__version__]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def train(
    robot: RobotSpec,
    actuator: Any,
    config: TrainConfig,
    *,
    control_mode: str = "position",
    scratch: Path | None = None,
    progress: Report | None = None,
    workers: int = 2,
    posterior: Posterior | None = None,
    stiffness: np.ndarray | None = None,
) -> TrainResult:
    """Train a policy; arguments as of `Trainer`.

    A training that was killed goes on from its last checkpoint in `scratch` and ends with the same networks and rows,
    bit for bit on the same machine, as one that was not: every checkpoint restarts all episodes in either case.
    """
    trainer = Trainer(
        robot,
        actuator,
        config,
        control_mode=control_mode,
        scratch=scratch,
        report=progress,
        workers=workers,
        posterior=posterior,
        stiffness=stiffness,
    )
    return trainer.run()
