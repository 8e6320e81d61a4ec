"""Free-running replay of the two-chamber model for the comparison table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.actuators.two_chamber import TwoChamber
from hqpipe.kernels.chamber_windows import replay
from hqpipe.logs.trajectory import Trajectory
from hqpipe.sysid.free_run import require_channels


@dataclass(frozen=True)
class ChamberReplay:
    """A `TwoChamber` as a `hqpipe.sysid.free_run.TorquePredictor`."""

    model: TwoChamber

    def predict(self, trajectory: Trajectory, window: int) -> np.ndarray:
        """(T, J) N·m, restarted from the log every `window` samples with the memory that the log leaves behind.

        Raises:
            IdentificationError: a channel is missing.
            UsageError: the model lacks a joint or belongs to another sample time.
        """
        require_channels(trajectory, ("effort", "position_command"), "replaying the two_chamber model")
        self.model.check_dt(trajectory.dt)
        rows = self.model.for_joints(trajectory.joints).parameters
        first = np.arange(0, trajectory.samples - 1, window)
        bounds = np.stack([first, np.minimum(first + window, trajectory.samples - 1)], axis=1)
        predicted = np.array(trajectory.effort)
        for j in range(len(trajectory.joints)):
            signals = (trajectory.effort, trajectory.position_command, trajectory.position, trajectory.velocity)
            columns = [np.ascontiguousarray(signal[:, j]) for signal in signals]
            column = columns[0].copy()
            replay(rows[j], *columns, bounds, first == 0, column)
            predicted[:, j] = column
        return predicted
