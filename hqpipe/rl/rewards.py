"""Rewards of the paper's two tables, and ten terms of ours.

A term is a function of the step, (N,) without its coefficient. The total is

    scale · Σ k · c_f? · term

with k from RewardConfig (penalties have k < 0) and the curriculum factor c_f where the table has it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hqpipe.rl.reward_config import RewardConfig

# Commands are drawn, so a zero command is exactly zero; the margin only covers float32.
ZERO_COMMAND = 1e-6
# Of a gait: half a cycle at 1.7 Hz in the air, a whole one on the ground.
LONGEST_SWING_S, LONGEST_STANCE_S = 0.3, 0.6


@dataclass
class Step:
    """What the rewards see of one policy period; N robots, J joints, L feet.

    Attributes:
        command: (N, 3) vx, vy, ω. linear_velocity, angular_velocity: (N, 3) in the base frame.
        mean_error: (N, 3) command less motion, vx, vy (m/s) and ω (rad/s), averaged over the last steps of the gait.
        gravity: (N, 3) unit vector in the base frame. height, nominal_height: (N,) and scalar, m.
        torque_square: (N, J) mean of τ² over the period, (N·m)². torque_clip: (N, J) excess over the limit, N·m.
        position, velocity, previous_velocity: (N, J).
        nominal_position, lower, upper: (J,) rad.
        targets: (N, 3, J) joint targets of this and the last two periods, newest first, rad.
        target_clip: (N, J) part of the target that the joint limits cut off, rad.
        contact: (N, L) bool. air_time, stance_time: (N, L) s since lift-off and touch-down; the one that does not
            run is 0.
        foot_velocity: (N, L, 3) world, m/s. foot_height: (N, L) sole above ground, m.
        previous_clearance: (N, L) foot clearance 1 of the last period.
        foot_force: (N, 3, L) magnitude of the ground reaction now and in the last two periods, newest first, N.
        clearance_target: m. opposite: (L,) number of the foot diagonally opposite.
        scheduled_stance: (N, L) bool of the clock, or None without one.
    """

    command: np.ndarray
    linear_velocity: np.ndarray
    angular_velocity: np.ndarray
    mean_error: np.ndarray
    gravity: np.ndarray
    height: np.ndarray
    nominal_height: float
    torque_square: np.ndarray
    torque_clip: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    previous_velocity: np.ndarray
    nominal_position: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    targets: np.ndarray
    target_clip: np.ndarray
    contact: np.ndarray
    air_time: np.ndarray
    stance_time: np.ndarray
    foot_velocity: np.ndarray
    foot_height: np.ndarray
    previous_clearance: np.ndarray
    foot_force: np.ndarray
    clearance_target: float
    opposite: np.ndarray
    scheduled_stance: np.ndarray | None = None

    @property
    def standing(self) -> np.ndarray:
        """(N,) bool: zero velocity is commanded."""
        return (np.abs(self.command) <= ZERO_COMMAND).all(axis=1)

    @property
    def yaw_error_square(self) -> np.ndarray:
        return (self.command[:, 2] - self.angular_velocity[:, 2]) ** 2

    @property
    def speed_error_square(self) -> np.ndarray:
        return _square(self.command[:, :2] - self.linear_velocity[:, :2])


def _square(values: np.ndarray) -> np.ndarray:
    """Squared norm over all but the first axis."""
    return (values * values).reshape(len(values), -1).sum(axis=1)


def command(s: Step) -> np.ndarray:
    """exp(−‖e‖²)(1 + exp(−0.5‖e‖)) + exp(−1.5 e_ω²)."""
    square = s.speed_error_square
    return np.exp(-square) * (1.0 + np.exp(-0.5 * np.sqrt(square))) + np.exp(-1.5 * s.yaw_error_square)


def yaw(s: Step) -> np.ndarray:
    """e_ω², tenfold when no turning is commanded. The table prints ω_z = 0, which a measured rate never is: cmd_z = 0."""
    return np.where(np.abs(s.command[:, 2]) <= ZERO_COMMAND, 10.0, 1.0) * s.yaw_error_square


def base_height(s: Step) -> np.ndarray:
    """exp(−40 |h₀ − h|)."""
    return np.exp(-40.0 * np.abs(s.nominal_height - s.height))


def base_motion(s: Step) -> np.ndarray:
    """v_z² + 0.02 (|ω_x| + |ω_y|)."""
    return s.linear_velocity[:, 2] ** 2 + 0.02 * np.abs(s.angular_velocity[:, :2]).sum(axis=1)


def torque(s: Step) -> np.ndarray:
    """‖τ‖², averaged over the period."""
    return s.torque_square.sum(axis=1)


def torque_clip(s: Step) -> np.ndarray:
    """‖τ_clip‖²: what the model asked for beyond the effort limit."""
    return _square(s.torque_clip)


def nominal_position(s: Step) -> np.ndarray:
    """‖q − q_nom‖, tenfold when standing is commanded."""
    return np.where(s.standing, 10.0, 1.0) * np.sqrt(_square(s.position - s.nominal_position))


def joint_velocity(s: Step) -> np.ndarray:
    """‖q̇‖²."""
    return _square(s.velocity)


def joint_acceleration(s: Step) -> np.ndarray:
    """‖q̇_t − q̇_{t−1}‖²."""
    return _square(s.velocity - s.previous_velocity)


def action_smoothness(s: Step) -> np.ndarray:
    """0.5 ‖q_des,t − 2 q_des,t−1 + q_des,t−2‖² + ‖q_des,t − q_des,t−1‖²."""
    now, last, before = s.targets[:, 0], s.targets[:, 1], s.targets[:, 2]
    return 0.5 * _square(now - 2.0 * last + before) + _square(now - last)


def flight(s: Step) -> np.ndarray:
    """1 while no foot touches the ground."""
    return (~s.contact.any(axis=1)).astype(float)


def airtime(s: Step) -> np.ndarray:
    """Standing: clip(T_s − T_a, ±0.25). Else min(T, 0.2) while T < 0.25, of the air or stance time that is running."""
    still = np.clip(s.stance_time - s.air_time, -0.25, 0.25)
    running = np.where(s.contact, s.stance_time, s.air_time)
    moving = np.where(running < 0.25, np.minimum(running, 0.2), 0.0)
    return np.where(s.standing[:, None], still, moving).sum(axis=1)


def slip(s: Step) -> np.ndarray:
    """‖v_foot,xy‖² of the feet in contact."""
    return (s.contact * (s.foot_velocity[..., :2] ** 2).sum(axis=-1)).sum(axis=1)


def foot_clearance(s: Step) -> np.ndarray:
    """(N, L) ‖v_foot‖ (h − h_tar)² of the feet in the air, unless standing is commanded."""
    speed = np.sqrt((s.foot_velocity**2).sum(axis=-1))
    miss = speed * (s.foot_height - s.clearance_target) ** 2
    return np.where(s.contact | s.standing[:, None], 0.0, miss)


def clearance_1(s: Step) -> np.ndarray:
    """Sum of `foot_clearance` over the feet."""
    return foot_clearance(s).sum(axis=1)


def clearance_2(s: Step) -> np.ndarray:
    """The clearance of the last period again, for the feet that touch now: paid once, at touch-down."""
    return (s.contact * s.previous_clearance).sum(axis=1)


def grf_smoothness(s: Step) -> np.ndarray:
    """0.5 (f_t − 2 f_{t−1} + f_{t−2})² + (f_t − f_{t−1})², summed over the feet."""
    now, last, before = s.foot_force[:, 0], s.foot_force[:, 1], s.foot_force[:, 2]
    return 0.5 * _square(now - 2.0 * last + before) + _square(now - last)


def action_clip(s: Step) -> np.ndarray:
    """Σ |part of the target beyond the joint limits|."""
    return np.abs(s.target_clip).sum(axis=1)


def joint_limit(s: Step) -> np.ndarray:
    """Number of joints beyond a limit."""
    return ((s.position > s.upper) | (s.position < s.lower)).sum(axis=1).astype(float)


def tracking(s: Step) -> np.ndarray:
    """exp(−‖e‖²/0.1): the paper's command term is nearly flat within 0.3 m/s of the command."""
    return np.exp(-s.speed_error_square / 0.1)


def tracking_yaw(s: Step) -> np.ndarray:
    """exp(−e_ω²/0.1)."""
    return np.exp(-s.yaw_error_square / 0.1)


def mean_speed(s: Step) -> np.ndarray:
    """‖ē‖ of the mean speed: a trot sways by 0.1 m/s in every step, beside which a lasting 0.05 m/s costs nothing above."""
    return np.sqrt(_square(s.mean_error[:, :2]))


def mean_yaw(s: Step) -> np.ndarray:
    """|ē_ω| of the mean turning rate."""
    return np.abs(s.mean_error[:, 2])


def gait_match(s: Step) -> np.ndarray:
    """Share of the feet whose contact is the clock's, 1 when standing with all feet down; 0 without a clock."""
    if s.scheduled_stance is None:
        return np.zeros(len(s.contact))
    wanted = s.scheduled_stance | s.standing[:, None]
    return (s.contact == wanted).mean(axis=1)


def lift(s: Step) -> np.ndarray:
    """Σ min(h / h_tar, 1) of the feet that have been in the air for less than 0.3 s, while two feet or more stand.

    0 while standing is commanded. It leads from standing to stepping, and because of the two feet not to hopping.
    """
    paid = (s.contact.sum(axis=1) >= 2) & ~s.standing
    swinging = ~s.contact & (s.air_time < LONGEST_SWING_S) & paid[:, None]
    return (swinging * np.clip(s.foot_height / s.clearance_target, 0.0, 1.0)).sum(axis=1)


def late(s: Step) -> np.ndarray:
    """Number of feet that have been in the air for 0.3 s or on the ground for 0.6 s, unless standing is commanded."""
    overdue = (s.air_time >= LONGEST_SWING_S) | (s.stance_time >= LONGEST_STANCE_S)
    return (overdue & ~s.standing[:, None]).sum(axis=1).astype(float)


def diagonal(s: Step) -> np.ndarray:
    """Share of the feet that stand or swing together with the foot diagonally opposite: 1 in a trot."""
    return (s.contact == s.contact[:, s.opposite]).mean(axis=1)


def orientation(s: Step) -> np.ndarray:
    """‖g_xy‖², the squared tilt of the base."""
    return _square(s.gravity[:, :2])


def angular_motion(s: Step) -> np.ndarray:
    """ω_x² + ω_y²."""
    return _square(s.angular_velocity[:, :2])


@dataclass(frozen=True)
class RewardTerm:
    """A function of the step and whether the table multiplies it by c_f."""

    function: Callable[[Step], np.ndarray]
    curriculum: bool = False


TERMS: dict[str, RewardTerm] = {
    "command": RewardTerm(command),
    "yaw": RewardTerm(yaw, curriculum=True),
    "base_height": RewardTerm(base_height),
    "base_motion": RewardTerm(base_motion),
    "torque": RewardTerm(torque, curriculum=True),
    "torque_clip": RewardTerm(torque_clip, curriculum=True),
    "nominal_position": RewardTerm(nominal_position, curriculum=True),
    "joint_velocity": RewardTerm(joint_velocity, curriculum=True),
    "joint_acceleration": RewardTerm(joint_acceleration, curriculum=True),
    "action_smoothness": RewardTerm(action_smoothness, curriculum=True),
    "flight": RewardTerm(flight, curriculum=True),
    "airtime": RewardTerm(airtime),
    "slip": RewardTerm(slip, curriculum=True),
    "clearance_1": RewardTerm(clearance_1),
    "clearance_2": RewardTerm(clearance_2),
    "grf_smoothness": RewardTerm(grf_smoothness, curriculum=True),
    "action_clip": RewardTerm(action_clip, curriculum=True),
    "joint_limit": RewardTerm(joint_limit, curriculum=True),
    "tracking": RewardTerm(tracking),
    "tracking_yaw": RewardTerm(tracking_yaw),
    "mean_speed": RewardTerm(mean_speed),
    "mean_yaw": RewardTerm(mean_yaw),
    "gait_match": RewardTerm(gait_match),
    "lift": RewardTerm(lift),
    "late": RewardTerm(late),
    "diagonal": RewardTerm(diagonal),
    "orientation": RewardTerm(orientation),
    "angular_motion": RewardTerm(angular_motion),
}


def coefficient(config: RewardConfig, name: str) -> float:
    """k of a term; that of clearance 2 multiplies the reward of clearance 1, hence k_c1 k_c2."""
    if name == "clearance_2":
        return config.clearance_1 * config.clearance_2
    return getattr(config, name)


def total(step: Step, config: RewardConfig, curriculum: float) -> tuple[np.ndarray, dict[str, float]]:
    """Sum of all terms with a nonzero coefficient.

    Returns:
        (N,) reward, and the mean of each weighted term over the N robots.
    """
    reward = np.zeros(len(step.command))
    means = {}
    for name, term in TERMS.items():
        k = config.scale * coefficient(config, name) * (curriculum if term.curriculum else 1.0)
        if k != 0.0:
            value = k * term.function(step)
            reward += value
            means[name] = float(value.mean())
    return reward, means
