"""One joint in the trials of one split, cut into windows for the compiled loops."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hqpipe.identify.model import Samples
from hqpipe.layers.actuator.window_runs import window_runs
from hqpipe.logs.differentiate import step_speed
from hqpipe.logs.end_stops import judged_windows
from hqpipe.logs.finer_clock import between, held
from hqpipe.logs.held_commands import command_between
from hqpipe.logs.trajectory import Trajectory, Trial, recording_of
from hqpipe.machine.chain import Signals

MOST_SAMPLES = 8_000  # judged of a joint and split: a free run changes little from one millisecond to the next
RECORDED = 0.5  # of a window's samples that must have been recorded; assumption


@dataclass(frozen=True, eq=False)
class Record:
    """The windows of one joint in the fit or the held-out trials.

    Attributes:
        files: names of the trials. trial: (W,) index into them.
        signals: for the loops on the clock of the controller, with the speed from one position to the next; the command as late
            as it may have come (`command_between`), the position as it was logged last. Of long trials runs of windows, each
            bounded like a trial.
        moving: (T,) command as early as it may have come, and position on a smooth curve between rows; the same where the
            controller is no faster than the log. logged: (T,) speed as it was logged. by_speed, by_opening: (T,) flow that all
            joints draw, as their speeds and as the errors of their positions tell it, rad/s.
        step: (S,) samples behind the start of a window that are judged. judged: (W, S) whether each was recorded.
    """

    files: tuple[str, ...]
    trial: np.ndarray
    signals: Signals
    moving: tuple[np.ndarray, np.ndarray]
    logged: np.ndarray
    by_speed: np.ndarray
    by_opening: np.ndarray
    step: np.ndarray
    judged: np.ndarray

    @property
    def windows(self) -> int:
        return len(self.trial)

    def picked(self, rows: np.ndarray) -> np.ndarray:
        """(N,) the judged ones of (steps, W) values of samples 1 … steps of each window, window by window."""
        return rows[self._every].T.ravel() if self._whole else rows.ravel()[self._places]

    @cached_property
    def _every(self) -> slice:
        """The rows of `step`, which are evenly apart."""
        return slice(int(self.step[0]) - 1, None, int(self.step[0]))

    @cached_property
    def _whole(self) -> bool:
        return bool(self.judged.all())

    @cached_property
    def _places(self) -> np.ndarray:
        """(N,) place of each judged sample among all values of all windows, step by step."""
        window, step = np.nonzero(self.judged)
        return (self.step[step] - 1) * self.windows + window

    def driven_by(
        self,
        logged: float,
        opening: float,
        moving: Sequence[float] = (),
        last: Signals | None = None,
        moved: Sequence[str] = (),
    ) -> Signals:
        """The signals with a share of the logged speed, of the flow that the openings tell, and of the motion of command and
        position between rows.

        Args:
            last: signals that were driven by other shares; None if there are none. moved: names of those that differ from them.
        """
        s, channels = self.signals, {}
        if last is None or "velocity" in moved:
            channels["velocity"] = s.velocity + logged * (self.logged - s.velocity) if logged else s.velocity
        if last is None or "demand" in moved:
            channels["demand"] = self.by_speed + opening * (self.by_opening - self.by_speed) if opening else s.demand
        for name, line, share in zip(("command", "position"), self.moving, moving, strict=False):
            if last is None or name in moved:
                channels[name] = getattr(s, name) + share * (line - getattr(s, name))
        return (last or s)._replace(**channels)

    def samples(self) -> Samples:
        """The samples that the joint is judged on."""
        s = self.signals
        at = (s.first[:, None] + self.step[None, :])[self.judged]
        return Samples(
            files=self.files,
            trial=np.broadcast_to(self.trial[:, None], self.judged.shape)[self.judged],
            time=s.time[at],
            position=s.position[at],
            velocity=self.logged[at],
            output=self.picked(s.target[1:]),
            held=np.broadcast_to(s.target[0][:, None], self.judged.shape)[self.judged],
        )


def record_of(
    trials: Sequence[Trial], j: int, steps: int, draws: tuple[np.ndarray, np.ndarray], per_row: int = 1
) -> Record:
    """Joint `j` in complete windows of `steps` rows, as many as are judged of long trials.

    Left out are windows in which the joint touches an end stop, those that start at a sample that was not recorded, and those
    of which half was not.

    Args:
        draws: (J,) what the speed, and what the position error of each joint count in the flow from the supply.
        per_row: samples of the controller from one row of the log to the next.
    """
    logs = [trial.trajectory for trial in trials]
    if not logs:
        return _empty(steps * per_row)
    runs = window_runs([t.samples for t in logs], [window_starts(t, j, steps) for t in logs], steps)
    bounds = np.cumsum([0, *(run.samples(per_row) for run in runs)])
    first = np.concatenate(
        [(run.first - run.start) * per_row + begun for run, begun in zip(runs, bounds, strict=False)]
    ).astype(np.int64)
    names = [recording_of(trial) for trial in trials]
    files = tuple(dict.fromkeys(names))
    trial = np.repeat([files.index(names[run.trial]) for run in runs], [len(run.first) for run in runs])

    def joined(pick: Callable[[Trajectory], np.ndarray]) -> np.ndarray:
        whole = {k: np.asarray(pick(logs[k]), dtype=np.float64) for k in dict.fromkeys(run.trial for run in runs)}
        return np.concatenate([run.of(whole[run.trial], per_row) for run in runs])

    def kept(pick: Callable[[Trajectory], np.ndarray]) -> np.ndarray:
        return joined(lambda t: held(pick(t), per_row))

    def smooth(pick: Callable[[Trajectory], np.ndarray]) -> np.ndarray:
        return joined(lambda t: between(pick(t), per_row))

    commands = {
        k: command_between(logs[k].position_command[:, j], per_row) for k in dict.fromkeys(r.trial for r in runs)
    }
    late, early = (np.concatenate([run.of(commands[run.trial][end], per_row) for run in runs]) for end in (0, 1))
    effort = smooth(lambda t: t.effort[:, j])
    every, steps = max(1, -(-len(first) * steps // MOST_SAMPLES)), steps * per_row
    target = np.ascontiguousarray(effort[first[None, :] + np.arange(steps + 1)[:, None]])
    recorded = kept(lambda t: np.ones(t.samples) if t.observed is None else t.recorded[:, j]) > 0.0
    target[1:][~recorded[first[None, :] + np.arange(1, steps + 1)[:, None]]] = np.nan
    step = np.arange(every, steps // per_row + 1, every) * per_row
    signals = Signals(
        command=late,
        position=kept(lambda t: t.position[:, j]),
        velocity=joined(lambda t: step_speed(between(t.position[:, j], per_row), t.dt / per_row)),
        effort=effort,
        time=smooth(lambda t: t.time - t.time[0] + t.start),
        demand=kept(lambda t: np.abs(t.velocity) @ draws[0]),
        bounds=bounds.astype(np.int64),
        first=first,
        steps=steps,
        target=target,
    )
    return Record(
        files=files,
        trial=trial,
        signals=signals,
        moving=(early, smooth(lambda t: t.position[:, j])),
        logged=smooth(lambda t: t.velocity[:, j]),
        by_speed=signals.demand,
        by_opening=kept(lambda t: np.abs(t.position_command - t.position) @ draws[1]),
        step=step,
        judged=~np.isnan(target[step].T),
    )


def draws_of(trials: Sequence[Trajectory], slides: Sequence[bool]) -> tuple[np.ndarray, np.ndarray]:
    """(J,) rad/s of flow per speed, and per position error, of each joint.

    Joints that slide count as much as those that turn do when both are as fast as they usually are, and all openings together
    as much as all speeds.
    """
    speeds = np.concatenate([t.velocity for t in trials])
    errors = np.concatenate([t.position_command - t.position for t in trials])
    by_speed, by_opening = _alike(speeds, slides), _alike(errors, slides)
    size = [float(np.sqrt(np.mean((np.abs(x) @ w) ** 2))) for x, w in ((speeds, by_speed), (errors, by_opening))]
    return by_speed, by_opening * size[0] / max(size[1], 1e-300)


def _alike(values: np.ndarray, slides: Sequence[bool]) -> np.ndarray:
    """(J,) what (T, J) values count: 1 where a joint turns, and where it slides as much as makes it a usual one of these.

    Joints at rest say nothing of what is usual.
    """
    size = np.sqrt(np.mean(values**2, axis=0))
    slide = np.array(slides, dtype=bool) & (size > 0.0)
    turning = size[~np.array(slides, dtype=bool) & (size > 0.0)]
    if not slide.any() or not len(turning):
        return np.ones(len(size))
    return np.where(slide, np.median(turning) / np.where(slide, size, 1.0), 1.0)


def window_starts(t: Trajectory, j: int, steps: int) -> np.ndarray:
    """(W,) first samples of the complete windows of a trial in which joint `j` is judged, see `record_of`."""
    starts = np.arange(0, t.samples - steps, steps)
    free = judged_windows(t, steps)
    if free is not None:
        starts = starts[free[:, j]]
    if t.observed is None:
        return starts
    seen = t.recorded[:, j]
    total = np.concatenate([[0.0], np.cumsum(seen)])
    return starts[seen[starts] & ((total[starts + steps + 1] - total[starts]) / (steps + 1) > RECORDED)]


def _empty(steps: int) -> Record:
    none, windows = np.zeros(0), np.zeros(0, dtype=np.int64)
    signals = Signals(
        none,
        none,
        none,
        none,
        none,
        none,
        np.zeros(1, dtype=np.int64),
        windows,
        steps,
        np.zeros((steps + 1, 0)),
    )
    step = np.arange(1, steps + 1)
    return Record((), windows, signals, (none, none), none, none, none, step, np.zeros((0, steps), dtype=bool))
