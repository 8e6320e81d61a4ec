"""Velocity tracking with N robots: commands, clock, observation, reward, termination. Shared by training and evaluation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hqpipe.rl import gait, rewards
from hqpipe.rl.commands import CommandRamps, sample_commands
from hqpipe.rl.config import CONTROL_PERIOD_S, TrainConfig
from hqpipe.rl.contact_timer import ContactTimer
from hqpipe.rl.initial_state import InitialState, random_state, trial_state
from hqpipe.rl.leg import total_mass
from hqpipe.rl.observation import (
    build_observation,
    build_state,
    noise_half_width,
    rotate_inverse,
)
from hqpipe.rl.policy_spec import PolicySpec
from hqpipe.robots import RobotSpec


@dataclass
class Outcome:
    """One period of N robots.

    Attributes:
        observation: (N, n) o_t and x_t side by side, float32, after the resets.
        final_observation: (N, n) the same before the resets.
        reward: (N,). fell, timed_out: (N,) bool; either ends the episode.
        terms: mean of each weighted reward term.
    """

    observation: np.ndarray
    final_observation: np.ndarray
    reward: np.ndarray
    fell: np.ndarray
    timed_out: np.ndarray
    terms: dict[str, float]


class LocomotionTask:
    """N robots that are to follow velocity commands.

    Args:
        spec: layouts and the rule from actions to targets.
        world: hqpipe.sim BatchedWorld, or anything with its state, step, reset and apply_push.
        training: noise, random initial states, pushes and drawn commands; without it all are off and commands are
            set with `set_commands`.
        seed: of everything random here.
    """

    def __init__(
        self,
        robot: RobotSpec,
        spec: PolicySpec,
        world: Any,
        config: TrainConfig,
        *,
        training: bool,
        seed: int,
    ) -> None:
        self.robot, self.world, self.config, self.training = robot, world, config, training
        self.count = world.num_envs
        self.rng = np.random.default_rng(seed)
        self.geometry = spec.geometry
        self.rule = spec.target_rule()
        self.layout, self.state_layout = spec.observation, spec.state
        self.curriculum = 1.0
        self._mass = total_mass(robot)
        self._has_clock = self.layout.has("clock")
        self._noise = noise_half_width(self.layout, config.noise)
        self._diagonal = gait.diagonal_feet(robot.feet)
        self._offsets = gait.leg_offsets(robot.feet)
        self._episode_steps = round(config.episode_s / CONTROL_PERIOD_S)
        n, joints, feet = self.count, len(robot.joints), len(robot.feet)
        self.ramps = CommandRamps(n, config.command.ramp_s)
        self.phase = np.zeros(n)
        self.steps = np.zeros(n, dtype=np.int64)
        self.targets = np.zeros((n, 3, joints))
        self.foot_force = np.zeros((n, 3, feet))
        self.previous_velocity = np.zeros((n, joints))
        self.previous_clearance = np.zeros((n, feet))
        self.mean_error = np.zeros((n, 3))
        self.timer = ContactTimer(n, feet)

    @property
    def command(self) -> np.ndarray:
        """(N, 3) what each robot is told now, m/s, m/s and rad/s."""
        return self.ramps.command

    @property
    def observation_size(self) -> int:
        return self.layout.size + self.state_layout.size

    def set_commands(self, commands: np.ndarray) -> None:
        """Command each robot: (N, 3) m/s, m/s, rad/s; with `command.ramp_s` they begin from the command before."""
        self.ramps.head_for(np.arange(self.count), commands)

    def reset(self) -> np.ndarray:
        """Start an episode with every robot; returns (N, n) observations."""
        self._reset(np.arange(self.count))
        return self.observe()

    def step(self, actions: np.ndarray) -> Outcome:
        """One period of 10 ms with `actions` (N, J)."""
        clock = gait.clock(self.phase)
        wanted = self.rule.unclipped(np.asarray(actions, dtype=float), clock, self.command)
        targets = self.rule.clipped(wanted)
        self.targets = np.stack((targets, self.targets[:, 0], self.targets[:, 1]), axis=1)
        state = self.world.step(targets)
        self.phase = gait.advance(self.phase, self.config.gait.frequency_hz, CONTROL_PERIOD_S)
        self.steps += 1
        self.timer.advance(state.foot_contact, CONTROL_PERIOD_S)
        force = np.linalg.norm(state.foot_force, axis=-1)
        self.foot_force = np.stack((force, self.foot_force[:, 0], self.foot_force[:, 1]), axis=1)
        # A running mean over about a cycle of the gait, in which its swaying cancels.
        share = CONTROL_PERIOD_S * self.config.gait.frequency_hz
        self.mean_error += share * (self.command - self.base_velocity() - self.mean_error)
        step = self._reward_step(wanted - targets)
        reward, terms = rewards.total(step, self.config.reward, self.curriculum)
        self.previous_velocity = step.velocity
        self.previous_clearance = rewards.foot_clearance(step)
        broken = ~np.isfinite(reward)  # a simulation that diverged is a fall, and must not spoil the others' update
        fell = state.illegal_contact | broken
        reward = np.where(broken, 0.0, reward)
        reward = np.where(fell, reward + self.config.reward.fall, reward)
        timed_out = ~fell & (self.steps >= self._episode_steps)
        if self.training:
            self._draw_commands()
            self._push()
        self.ramps.advance()
        final = np.where(broken[:, None], 0.0, self.observe()).astype(np.float32)
        ended = np.flatnonzero(fell | timed_out) if self.training else np.empty(0, dtype=np.int64)
        observation = final
        if ended.size:
            self._reset(ended)
            observation = self.observe()
            keep = np.ones(self.count, dtype=bool)
            keep[ended] = False
            observation[keep] = final[keep]
        return Outcome(observation, final, reward.astype(np.float32), fell, timed_out, terms)

    def push(self, indices: np.ndarray, change: np.ndarray) -> None:
        """Give robots `indices` (n,) the momentum that would change their velocity by `change` (n, 2), m/s in the world."""
        impulse = np.zeros((len(indices), 3))
        impulse[:, :2] = self._mass * change
        self.world.apply_push(indices, impulse)

    def _reward_step(self, target_clip: np.ndarray) -> rewards.Step:
        s, robot = self.world.state, self.robot
        linear, gravity = self._base_vectors()
        return rewards.Step(
            command=self.command,
            linear_velocity=linear,
            angular_velocity=s.base_angular_velocity,
            mean_error=self.mean_error,
            gravity=gravity,
            height=s.base_position[:, 2],
            nominal_height=robot.nominal_height,
            torque_square=s.effort_mean_square,
            torque_clip=s.effort_clipped,
            position=s.joint_position,
            velocity=s.joint_velocity.copy(),
            previous_velocity=self.previous_velocity,
            nominal_position=robot.nominal_position,
            lower=robot.position_lower,
            upper=robot.position_upper,
            targets=self.targets,
            target_clip=target_clip,
            contact=s.foot_contact,
            air_time=self.timer.air,
            stance_time=self.timer.stance,
            foot_velocity=s.foot_velocity,
            foot_height=self.foot_height(),
            previous_clearance=self.previous_clearance,
            foot_force=self.foot_force,
            clearance_target=self.config.reward.clearance_target,
            opposite=self._diagonal,
            scheduled_stance=self._scheduled_stance(),
        )

    def base_velocity(self) -> np.ndarray:
        """(N, 3) vx, vy and ω_z in the base frame, what the command is compared with."""
        linear, _ = self._base_vectors()
        return np.column_stack((linear[:, :2], self.world.state.base_angular_velocity[:, 2]))

    def _base_vectors(self) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) linear velocity and (N, 3) direction of gravity in the base frame."""
        s = self.world.state
        linear = rotate_inverse(s.base_orientation, s.base_linear_velocity)
        down = np.broadcast_to(np.array([0.0, 0.0, -1.0]), linear.shape)
        return linear, rotate_inverse(s.base_orientation, down)

    def foot_height(self) -> np.ndarray:
        """(N, L) sole above the ground, m."""
        return self.world.state.foot_position[..., 2] - self.geometry.foot_radius

    def _scheduled_stance(self) -> np.ndarray | None:
        if not self._has_clock:
            return None
        return gait.scheduled_stance(self.phase, self._offsets, self.config.gait.duty)

    def observe(self) -> np.ndarray:
        """(N, n) o_t and x_t of the present state, float32; with noise on o_t in training."""
        s = self.world.state
        observed = build_observation(
            s.base_angular_velocity,
            s.joint_position,
            s.joint_velocity,
            self.targets[:, 0],
            self.command,
            gait.clock(self.phase) if self._has_clock else None,
        )
        if self.training:
            observed += self.rng.uniform(-1.0, 1.0, observed.shape).astype(np.float32) * self._noise
        linear, gravity = self._base_vectors()
        height = s.base_position[:, 2]
        privileged = build_state(linear, gravity, height, s.foot_contact, self.foot_height())
        return np.concatenate((observed, privileged), axis=1)

    def _reset(self, indices: np.ndarray) -> None:
        n = len(indices)
        if self.training:
            start: InitialState = random_state(self.robot, self.geometry, self.config.randomisation, n, self.rng)
            self.ramps.stand(indices)
            self.ramps.head_for(indices, self._sample_commands(n), self.rng)
            self.phase[indices] = self.rng.random(n)
        else:
            start = trial_state(self.robot, self.geometry, n)
            self.ramps.stand(indices)
            self.phase[indices] = 0.0
        self.world.reset(
            indices,
            start.base_position,
            start.base_orientation,
            start.base_linear_velocity,
            start.base_angular_velocity,
            start.joint_position,
            start.joint_velocity,
        )
        self.steps[indices] = 0
        self.targets[indices] = start.joint_position[:, None]
        self.foot_force[indices] = 0.0
        self.previous_velocity[indices] = start.joint_velocity
        self.previous_clearance[indices] = 0.0
        self.mean_error[indices] = 0.0
        self.timer.reset(indices)

    def _draw_commands(self) -> None:
        due = self.rng.random(self.count) < CONTROL_PERIOD_S / self.config.command.resample_s
        self.ramps.head_for(np.flatnonzero(due), self._sample_commands(int(due.sum())), self.rng)

    def _sample_commands(self, count: int) -> np.ndarray:
        commands = self.config.command
        if self.curriculum < 1.0 and not commands.standing_at_once:
            commands = replace(commands, standing_share=0.0)
        return sample_commands(commands, count, self.rng)

    def _push(self) -> None:
        r = self.config.randomisation
        if r.push_interval_s <= 0.0:
            return
        pushed = np.flatnonzero(self.rng.random(self.count) < CONTROL_PERIOD_S / r.push_interval_s)
        if pushed.size:
            self.push(pushed, self.rng.uniform(-r.push_speed, r.push_speed, size=(pushed.size, 2)))
