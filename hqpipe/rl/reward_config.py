"""What each term of the reward counts."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RewardConfig:
    """Coefficients k of the reward terms; formulas and units in rewards.py. Penalties carry a minus sign.

    Attributes:
        scale: multiplies the sum, so that a return is of order one.
        fall: added once when an episode ends in illegal contact, after `scale`.
        clearance_target: h_tar, height of the sole in swing, m.
    """

    scale: float = 0.03
    fall: float = -1.0
    clearance_target: float = 0.08
    # Table "Global Rewards" of the paper
    command: float = 0.5
    yaw: float = -0.1
    base_height: float = 0.2
    base_motion: float = -0.5
    torque: float = -2e-7
    torque_clip: float = -1e-6
    nominal_position: float = -0.05
    joint_velocity: float = -3e-4
    joint_acceleration: float = -1e-3
    action_smoothness: float = -0.5
    # Table "Local Rewards" of the paper
    flight: float = -0.2
    airtime: float = 0.0
    slip: float = -0.05
    clearance_1: float = -2.0
    clearance_2: float = 1.0
    grf_smoothness: float = -1e-8
    action_clip: float = -0.5
    joint_limit: float = -0.2
    # Terms of ours, without which short trainings do not converge
    tracking: float = 1.0
    tracking_yaw: float = 0.5
    mean_speed: float = -1.0
    mean_yaw: float = -0.5
    gait_match: float = 0.3
    orientation: float = -2.0
    angular_motion: float = -0.05
    # Terms of ours that lead from standing to a trot, for a policy that is given none
    lift: float = 0.0
    late: float = 0.0
    diagonal: float = 0.0
