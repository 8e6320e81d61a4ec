"""The joints of a machine with the numbers of a fit: what the simulator steps, and what they predict of a log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.actuators.augmented import OF_THE_LOG, Augmented
from hqpipe.layers.actuator.joint import ActuatorJoint
from hqpipe.layers.actuator.parameters import BASE_NAMES, LOGGED_SPEED
from hqpipe.logs.finer_clock import continued, held, known_so_far
from hqpipe.logs.held_commands import steady_steps
from hqpipe.logs.trajectory import Trajectory
from hqpipe.machine import EFFECTS
from hqpipe.machine.chain import Signals, residual_windows
from hqpipe.machine.layout import neutral_row, slot, slots

_STEP = slot("setting", "sample_time")
_FLOW = [slot("setting", "flow_per_speed"), slot("setting", "flow_per_opening")]
_SAG = [slot(e.name, p.name) for e in EFFECTS.values() if e.reads("demand") for p in e.parameters if p.search.counts]
"""Columns of the effects that hang on the flow from the supply."""


@dataclass(frozen=True, eq=False)
class FittedJoints:
    """Joints of one machine.

    Attributes:
        joints: names. rows: (J, WIDTH) see `hqpipe.machine.layout`, effects of the sensors included.
        logged_speed: (J,) share of the logged speed in that of the hydraulics; the rest is the speed of the positions.
        moving: (J, 2) shares of the motion of command and position between rows of the log that the controller sees.
    """

    joints: tuple[str, ...]
    rows: np.ndarray
    logged_speed: np.ndarray
    moving: np.ndarray

    @classmethod
    def of(cls, models: Sequence[ActuatorJoint], values: Sequence[np.ndarray]) -> FittedJoints:
        """Joints with their values (P,), see `hqpipe.identify.model.all_parameters`.

        The flow from the supply is one for all of them: what it owes to openings is the mean of the joints that feel it.
        """
        share = BASE_NAMES.index(LOGGED_SPEED)
        rows = np.array([model.row(numbers) for model, numbers in zip(models, values, strict=True)])
        by_speed, by_opening = np.array([model.draws for model in models]).T
        opening = np.divide(rows[:, _FLOW[1]], by_opening, out=np.zeros(len(rows)), where=by_opening > 0.0)
        feels = (rows[:, _SAG] != neutral_row()[_SAG]).any(axis=1)
        common = float(opening[feels].mean()) if feels.any() else 0.0
        rows[:, _FLOW] = np.stack([(1.0 - common) * by_speed, common * by_opening], axis=1)
        moving = [model.moving(numbers) or (0.0, 0.0) for model, numbers in zip(models, values, strict=True)]
        logged = [numbers[share] for numbers in values]
        return cls(tuple(model.joint for model in models), rows, np.array(logged), np.array(moving))

    def actuator(self) -> Augmented:
        """The actuator for the training simulator: what the sensors add is no part of it."""
        rows, neutral = self.rows.copy(), neutral_row()
        for name in OF_THE_LOG:
            rows[:, slots(name)] = neutral[slots(name)]
        return Augmented(self.joints, rows, float(rows[0, _STEP]))

    def predict(self, trajectory: Trajectory, window: int) -> np.ndarray:
        """Torque as the log has it, restarted from the log every `window` rows; the last window may be a short one.

        The speed of the positions is that of the step which is predicted, extrapolated from the positions before it.

        Args:
            trajectory: with `effort` and `position_command`; joints are matched by name.

        Returns:
            (T, J) N·m or N; row 0 is the logged torque.
        """
        per_row = max(1, round(trajectory.dt / self.rows[0, _STEP]))
        trajectory, window = known_so_far(trajectory, per_row), window * per_row
        t, predicted = trajectory.for_joints(self.joints), np.array(trajectory.effort, dtype=np.float64)
        whole = (t.samples - 1) // window * window
        pieces = [(np.arange(0, whole, window), window), (np.array([whole]), t.samples - 1 - whole)]
        for j, joint in enumerate(self.joints):
            signals, column = self._signals(t, j, per_row), trajectory.joint(joint)
            for first, steps in pieces:
                if not len(first) or not steps:
                    continue
                at = first[None, :] + np.arange(steps + 1)[:, None]
                target = np.ascontiguousarray(signals.effort[at])
                cut = signals._replace(first=first.astype(np.int64), steps=steps, target=target)
                predicted[at[1:], column] = residual_windows(self.rows[j], cut) + target[1:]
        return predicted[::per_row]

    def _signals(self, t: Trajectory, j: int, per_row: int) -> Signals:
        """Joint `j` of a trial on the clock of the controller, without windows."""
        rows = [channel[::per_row, j] for channel in (t.position_command, t.position)]
        shares = self.moving[j].copy()
        if per_row > 1 and steady_steps(rows[0]) is not None:
            shares[0] = 0.0  # the next step is not known before it has come
        command, position = (
            (1.0 - share) * held(values, per_row) + share * continued(values, per_row)
            for values, share in zip(rows, shares, strict=True)
        )
        speed = held(extrapolated_speed(rows[1], per_row * t.dt), per_row)
        by_speed, by_opening = self.rows[:, _FLOW].T
        flow = np.abs(t.velocity) @ by_speed + np.abs(t.position_command - t.position) @ by_opening
        channels = (
            command,
            position,
            speed + self.logged_speed[j] * (t.velocity[:, j] - speed),
            t.effort[:, j],
            t.time - t.time[0] + t.start,
            flow,
        )
        return Signals(
            *(np.ascontiguousarray(channel, dtype=np.float64) for channel in channels),
            bounds=np.array([0, t.samples]),
            first=np.zeros(0, dtype=np.int64),
            steps=0,
            target=np.zeros((1, 0)),
        )


def extrapolated_speed(position: np.ndarray, dt: float) -> np.ndarray:
    """(T,) mean speed from each sample to the next by the positions up to it: that of the step before, and its change."""
    before = np.diff(position, prepend=position[0]) / dt
    return before + np.diff(before, prepend=before[0])
