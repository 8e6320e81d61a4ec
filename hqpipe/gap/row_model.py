"""A machine's actuators with effects, driven by logged trials: the replay that places and noise floors start from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hqpipe.actuators.augmented import SENSING, Augmented
from hqpipe.effects.layout import neutral_row, slot, slots
from hqpipe.gap.joint_data import MOVED, cut
from hqpipe.gap.replay import Replay
from hqpipe.kernels.augmented_fit import residual_windows
from hqpipe.kernels.augmented_signals import Signals
from hqpipe.logs.trajectory import Trajectory, Trial, recording_of

FLOW = [slot("setting", "flow_per_speed"), slot("setting", "flow_per_opening")]
EVERY = 1 << 62  # windows: no thinning


def driven(t: Trajectory, predicted: np.ndarray, mode: str) -> Trajectory:
    """The trial with `position_command` − `position` as what drives the actuator: in torque mode the torque error.

    Output and drive must share no noise, or a part of the noise could be predicted: the error is that of the model's torque.
    """
    if mode == "position":
        return t
    return replace(t, position_command=t.position + t.effort_command - predicted)


@dataclass(frozen=True, eq=False)
class SpanRow:
    """Another row (WIDTH,) for a stretch of each recorded trial: file → (start, end), s."""

    row: np.ndarray
    stretches: dict[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class RowModel:
    """Actuators of a machine.

    Attributes:
        joints: names. rows: (J, WIDTH), see hqpipe.effects.layout. mode: control mode.
        speed: see `SPEEDS`. spans: joint index → its row for some time.
    """

    joints: tuple[str, ...]
    rows: np.ndarray
    mode: str
    speed: str = MOVED
    spans: dict[int, SpanRow] = field(default_factory=dict)

    @property
    def memory(self) -> np.ndarray:
        """(J,) share of a torque offset that is left after one sample."""
        decay = self.rows[:, slot("base", "k2")] + (self.rows[:, slot("base", "k1")] if self.mode == "torque" else 0.0)
        return np.clip(1.0 - decay, 0.0, 1.0)

    def actuator(self) -> Augmented | None:
        """The actuator for the training simulator, where the mode is position: what the sensors add is no part of it."""
        if self.mode != "position":
            return None
        rows, neutral = self.rows.copy(), neutral_row()
        for name in SENSING:
            rows[:, slots(name)] = neutral[slots(name)]
        return Augmented(self.joints, rows, float(rows[0, slot("setting", "sample_time")]))

    def replay(self, trial: Trial, steps: int) -> Replay:
        """Run the model through one trial in windows of `steps` samples, and one step ahead."""
        t, file = trial.trajectory, recording_of(trial)
        free, one = self._predict(file, t, steps), self._predict(file, t, 1)
        return Replay(trial.file, driven(t, free, self.mode), steps, free, one)

    def predict(self, trajectory: Trajectory, window: int) -> np.ndarray:
        """(T, J) torque as the log has it, sensors included; the last window of the trial may be a short one.

        Stretches play no part.
        """
        t, predicted = trajectory.for_joints(self.joints), np.array(trajectory.effort, dtype=np.float64)
        whole = (t.samples - 1) // window * window
        for j, joint in enumerate(self.joints):
            row, column = self.rows[j], trajectory.joint(joint)
            if whole:
                signals = self._signals(t, j, window)
                output = residual_windows(row, signals) + signals.target[1:]
                predicted[1 : whole + 1, column] = output.T.ravel()
            if rest := t.samples - 1 - whole:
                signals = self._signals(t, j, rest)
                target = np.ascontiguousarray(signals.effort[whole:, None])
                signals = signals._replace(first=np.array([whole]), target=target)
                predicted[whole + 1 :, column] = (residual_windows(row, signals) + target[1:])[:, 0]
        return predicted

    def _signals(self, t: Trajectory, j: int, steps: int) -> Signals:
        return cut([t], j, self.mode, steps, EVERY, self.speed, tuple(self.rows[:, FLOW].T), masked=False).signals

    def _predict(self, file: str, t: Trajectory, steps: int) -> np.ndarray:
        predicted = t.effort.astype(np.float64).copy()
        if t.samples <= steps:
            return predicted
        for j in range(len(self.joints)):
            signals = self._signals(t, j, steps)
            output = residual_windows(self.rows[j], signals) + signals.target[1:]
            if j in self.spans and file in self.spans[j].stretches:
                start, end = (round((at - t.start) / t.dt) for at in self.spans[j].stretches[file])
                inside = (signals.first >= start) & (signals.first < end)
                other = residual_windows(self.spans[j].row, signals) + signals.target[1:]
                output[:, inside] = other[:, inside]
            predicted[signals.first[None, :] + np.arange(1, steps + 1)[:, None], j] = output
        return predicted


def kept(model: RowModel, steps: int) -> np.ndarray:
    """(steps, J) how much of a torque offset at the window start is left after 1 … steps samples."""
    return model.memory[None, :] ** np.arange(1, steps + 1)[:, None]


def replay_all(model: RowModel, trials: Sequence[Trial], steps: int) -> list[Replay]:
    """The trials that hold at least one window."""
    found = [model.replay(trial, steps) for trial in trials]
    return [item for item in found if item.windows]
