"""What a model must beat: predictors that know nothing of the actuator; fitted, if at all, to fit trials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.actuators.stiff_pd import StiffPD
from hqpipe.identify.free_run import require_channels
from hqpipe.identify.paper_model.problem import bounded_least_squares
from hqpipe.logs.trajectory import Trajectory, Trial


@dataclass(frozen=True)
class Persistence:
    """The torque stays what it was: one step ahead the last sample, free-running the window's first."""

    def predict(self, trajectory: Trajectory, window: int) -> np.ndarray:
        """(T, J) N·m; see `hqpipe.identify.free_run.TorquePredictor`."""
        require_channels(trajectory, ("effort",), "persistence")
        started = (np.arange(trajectory.samples - 1) // window) * window
        return np.concatenate([trajectory.effort[:1], trajectory.effort[started]])


@dataclass(frozen=True, eq=False)
class MeanTorque:
    """The mean torque of the fit trials, (J,) N·m."""

    joints: tuple[str, ...]
    mean: np.ndarray

    @classmethod
    def of(cls, trials: list[Trial]) -> MeanTorque:
        effort = np.concatenate([trial.trajectory.effort for trial in trials])
        return cls(trials[0].trajectory.joints, effort.mean(axis=0))

    def predict(self, trajectory: Trajectory, window: int) -> np.ndarray:
        """(T, J) N·m; see `hqpipe.identify.free_run.TorquePredictor`."""
        del window  # it carries no state
        rows = [self.joints.index(joint) for joint in trajectory.joints]
        predicted = np.tile(self.mean[rows], (trajectory.samples, 1))
        predicted[0] = trajectory.effort[0]
        return predicted


@dataclass(frozen=True)
class CommandedTorque:
    """The ideal actuator of torque control: the torque command is reached within one sample."""

    def predict(self, trajectory: Trajectory, window: int) -> np.ndarray:
        """(T, J) N·m; see `hqpipe.identify.free_run.TorquePredictor`."""
        del window  # it carries no state
        require_channels(trajectory, ("effort", "effort_command"), "the ideal torque actuator")
        return np.concatenate([trajectory.effort[:1], trajectory.effort_command[:-1]])


def fit_stiff_pd(trials: list[Trial], effort_limit: np.ndarray) -> StiffPD:
    """Gains of τ = kp (q_des − q) − kd q̇ by least squares, both at least 0.

    Args:
        trials: with position command and effort. effort_limit: (J,) N·m.
    """
    joints = trials[0].trajectory.joints
    gains = np.empty((len(joints), 2))
    for j in range(len(joints)):
        moments, right = np.zeros((2, 2)), np.zeros(2)
        for trial in trials:
            t = trial.trajectory
            error = t.position_command[:-1, j] - t.position[:-1, j]
            x = np.stack([error, -t.velocity[:-1, j]], axis=1)
            moments += x.T @ x
            right += x.T @ t.effort[1:, j]
        gains[j] = bounded_least_squares(moments, right, np.zeros(2), np.full(2, np.inf))
    return StiffPD.build(joints, kp=gains[:, 0], kd=gains[:, 1], effort_limit=effort_limit)
