"""One joint of a log set as the compiled fits want it: windows side by side, and the sizes of its signals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hqpipe.effects import effect as scales
from hqpipe.effects.layout import neutral_row, slot
from hqpipe.gap.joint_scale import joint_scale
from hqpipe.kernels.augmented_columns import MODES
from hqpipe.kernels.augmented_signals import Signals
from hqpipe.logs.end_stops import away_from_stops, judged_windows
from hqpipe.logs.trajectory import Trajectory

MAX_WINDOWS = 400  # per joint and split; 40 s of windows of 0.1 s say what an hour says, in bounded time
PRESLIDING_SHARE = 0.0003  # of the position's standard deviation: where friction turns round, until it is fitted
CLEAR_SHARE = 0.5  # of the RMS torque: more than a chain chatters within its slack; assumption
MOVED, LOGGED = SPEEDS = ("moved", "logged")
"""Speed from one position to the next, or the logged channel. The first adds up to the travel however coarse the
encoder is, and no filter delays it; the second is right where the controller computes with it."""
CONTINUED = "continued"
"""The first as far as it is known at its sample, for a prediction that is to see no more than others do; no fit uses it."""
LATE = {MOVED: 0.5, LOGGED: 0.0}
"""Samples by which a speed belongs later than its row: the mean speed of the step that begins there, half a one."""
Flow = tuple[np.ndarray | float, np.ndarray | float]
"""What a joint's speed, and what the opening of its valve (1/s per unit of the command's error), count in the flow that
it draws from the supply, in rad/s; of all joints, or (J,)."""
BY_SPEED: Flow = (1.0, 0.0)
LITTLE, AT_TIMES = 0.3, 0.1  # of the RMS flow, and of the time; a sine is below that for 0.14 of it; assumptions
COMMAND_CHANNEL = {"position": "position_command", "torque": "effort_command", "valve": "valve_command"}


@dataclass(frozen=True, eq=False)
class Split:
    """The windows of one joint in the fit or the held-out trials.

    Attributes:
        signals: for the kernels.
        trial: (W,) index of the trial of each window; of a recording's first section for all of its sections.
        window: (W,) place of each window among the M of the machine, of which this joint lacks what its end stops spoil.
        machine_first, machine_trial: (M,) first sample and trial of each of those.
    """

    signals: Signals
    trial: np.ndarray
    window: np.ndarray
    machine_first: np.ndarray
    machine_trial: np.ndarray

    def of_machine(self, errors: np.ndarray) -> np.ndarray:
        """(M,) squared errors (W,) in their places, 0 where the joint is not judged; their mean stays what it was."""
        windows = len(self.machine_first)
        if len(self.window) == windows:
            return errors
        found = np.zeros(windows)
        found[self.window] = errors * (windows / max(len(self.window), 1))
        return found

    def only(self, some: np.ndarray) -> Split:
        """Some of the windows, by a mask or indices of (W,)."""
        signals = self.signals
        target = np.ascontiguousarray(signals.target[:, some])
        part = signals._replace(first=signals.first[some].copy(), target=target)
        return replace(self, signals=part, trial=self.trial[some], window=self.window[some])


@dataclass(frozen=True, eq=False)
class Then:
    """What an earlier record says of one joint.

    Attributes:
        row: (WIDTH,) the joint as it was.
        columns: (C,) columns that were fitted then, where it is known how well. covariance: (C, C).
        familiar: mean squared error of the row on the logs of then beyond their noise; 0 where it is not known.
        swing: mean squared error of holding the output there; None where it is not known.
        heldout: windows of then that the row was not fitted to; None where the record holds none.
        effects: that it had.
    """

    row: np.ndarray
    columns: np.ndarray
    covariance: np.ndarray
    familiar: float = 0.0
    swing: float | None = None
    heldout: Split | None = None
    effects: tuple[str, ...] = ()

    @property
    def rubs(self) -> bool:
        """Whether the joint had friction of any kind that turns round."""
        return bool({"coulomb_friction", "stribeck_friction", "load_dependent_friction"} & set(self.effects))


@dataclass(frozen=True, eq=False)
class JointData:
    """One joint.

    Attributes:
        joint: name. fit, heldout: its windows.
        size: scale → number that bounds and starts of effect parameters are multiples of.
        row: (WIDTH,) row without effects and with zero gains, settings filled in.
        noise: standard deviation of the output's sensor noise.
        scale: what an error of the joint counts against beside those of others, see `hqpipe.gap.joint_scale`.
        linear: whether the joint is prismatic, with m and N in place of rad and N·m.
        barred: effects that this joint's log could only imitate.
        then: the joint in an earlier record, where the question is what changed since.
        held: column → number of an effect that is not this joint's to choose, because the machine has one of it.
    """

    joint: str
    mode: str
    fit: Split
    heldout: Split
    size: dict[str, float]
    row: np.ndarray
    noise: float
    scale: float
    linear: bool = False
    barred: tuple[str, ...] = ()
    then: Then | None = None
    held: Mapping[int, float] = field(default_factory=dict)

    @property
    def output(self) -> float:
        """RMS of the torque."""
        return self.size[scales.EFFORT]

    @property
    def natural(self) -> dict[str, float]:
        """Coefficient of the base model → the size that the signals of this log give it."""
        size = self.size
        return {
            "k1": self.output / size[scales.COMMAND],
            "k2": 1.0,
            "k3": self.output / size[scales.VELOCITY],
            "k4": 1.0 / size[scales.COMMAND],
        }

    @property
    def row_dt(self) -> float:
        """Sample time, s."""
        return float(self.row[slot("setting", "sample_time")])


def joint_data(
    fit: Sequence[Trajectory],
    heldout: Sequence[Trajectory],
    j: int,
    mode: str,
    steps: int,
    noise: float,
    effort_limit: float = np.inf,
    speed: str = MOVED,
    flow: Flow = BY_SPEED,
    linear: bool = False,
) -> JointData:
    """Cut the trials of one joint into windows of `steps` samples.

    Args:
        fit, heldout: trials with the channels of the control mode.
        j: joint index. mode: position or torque.
        noise: standard deviation of the sensor noise of the output.
        effort_limit: N·m.
        speed: where the velocity comes from, of `SPEEDS`. flow: what counts in the flow that all joints draw.
        linear: whether the joint is prismatic.
    """
    row = neutral_row()
    row[slot("setting", "sample_time")] = float(np.median([t.dt for t in fit]))
    row[slot("setting", "middle")] = float(
        np.mean(np.concatenate([away_from_stops(t, j, t.position[:, j]) for t in fit]))
    )
    row[slot("setting", "effort_limit")] = effort_limit
    joints = len(fit[0].joints)
    row[[slot("setting", "flow_per_speed"), slot("setting", "flow_per_opening")]] = [
        np.broadcast_to(part, joints)[j] for part in flow
    ]
    row[slot("setting", "speed_late")] = LATE[speed]
    size = _sizes(fit, j, mode, flow)
    row[slot("setting", "clear")] = CLEAR_SHARE * size[scales.EFFORT]
    row[slot("coulomb_friction", "presliding_rad")] = PRESLIDING_SHARE * size[scales.ANGLE]
    return JointData(
        joint=fit[0].joints[j],
        mode=mode,
        fit=cut(fit, j, mode, steps, speed=speed, flow=flow),
        heldout=cut(heldout, j, mode, steps, speed=speed, flow=flow),
        size=size,
        row=row,
        noise=noise,
        scale=joint_scale([away_from_stops(t, j, t.effort[:, j]) for t in fit]),
        linear=linear,
        held={} if _rests(fit, mode, flow) else {slot("supply_droop", "pump_velocity_rad_s"): 0.0},
    )


def _rests(trials: Sequence[Trajectory], mode: str, flow: Flow) -> bool:
    """Whether little is drawn from the supply at times: only then a flow that the pump keeps up with shows beside a loss that
    is always there, which is no more than another gain."""
    drawn = np.concatenate([_drawn(t, mode, flow) for t in trials])
    return bool(np.mean(drawn < LITTLE * np.sqrt(np.mean(drawn**2))) >= AT_TIMES)


def cut(
    trials: Sequence[Trajectory],
    j: int,
    mode: str,
    steps: int,
    most: int = MAX_WINDOWS,
    speed: str = MOVED,
    flow: Flow = BY_SPEED,
    masked: bool = True,
) -> Split:
    """Complete windows, evenly thinned to `most`.

    Left out are windows that would start at a sample that was not recorded, or hold more of these than others, at any joint;
    what is left of them counts for nothing. So are those in which the joint touches an end stop, of the machine's windows those
    in which every joint does. Nothing is left out unless `masked`.
    """
    starts, trial, free = _windows(trials, j, steps, most, masked)
    machine, window = (starts, trial), np.flatnonzero(free)
    starts, trial = starts[window], trial[window]
    bounds = np.cumsum([0, *(t.samples for t in trials)])
    parts = [_channels(t, j, mode, speed, flow) for t in trials]
    command, position, velocity, effort, time, demand = (
        np.ascontiguousarray(np.concatenate(c)) for c in zip(*parts, strict=True)
    )
    target = np.ascontiguousarray(effort[starts[None, :] + np.arange(steps + 1)[:, None]])
    if masked and any(t.observed is not None for t in trials):
        observed = np.concatenate([t.recorded[:, j] for t in trials])
        target[1:][~observed[starts[None, :] + np.arange(1, steps + 1)[:, None]]] = np.nan
    signals = Signals(
        MODES[mode],
        command,
        position,
        velocity,
        effort,
        time,
        demand,
        bounds.astype(np.int64),
        starts.astype(np.int64),
        steps,
        target,
    )
    return Split(signals, trial, window, *machine)


def _windows(
    trials: Sequence[Trajectory], j: int, steps: int, most: int, masked: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First sample and trial of each of the machine's windows, and whether joint `j` is judged in it; (M,) each."""
    first, owner, judged, begun = [], [], [], 0
    for t, index in zip(trials, _owners(trials), strict=True):
        starts, free = _starts(t, j, steps) if masked else _every(t, steps)
        first.append(starts + begun)
        owner.append(np.full(len(starts), index))
        judged.append(free)
        begun += t.samples
    found = np.concatenate(first), np.concatenate(owner), np.concatenate(judged)
    if len(found[0]) <= most:
        return found
    kept = np.linspace(0, len(found[0]) - 1, most).round().astype(int)
    return found[0][kept], found[1][kept], found[2][kept]


def _every(t: Trajectory, steps: int) -> tuple[np.ndarray, np.ndarray]:
    starts = np.arange(0, t.samples - steps, steps)
    return starts, np.ones(len(starts), dtype=bool)


def _starts(t: Trajectory, j: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """First samples of the machine's windows in a trial, and whether joint `j` is judged in each."""
    (starts, free), judged = _every(t, steps), judged_windows(t, steps)
    if judged is not None:
        some = judged.any(axis=1)
        starts, free = starts[some], judged[some, j]
    if t.observed is not None:
        recorded = np.isin(starts, _recorded(starts, t.observed, steps))
        starts, free = starts[recorded], free[recorded]
    return starts, free


def _recorded(starts: np.ndarray, observed: np.ndarray, steps: int) -> np.ndarray:
    """Of the first samples of windows those that were recorded at all joints, and most of the samples behind them."""
    total = np.concatenate([np.zeros((1, observed.shape[1])), np.cumsum(observed, axis=0)])
    share = ((total[starts + steps + 1] - total[starts]) / (steps + 1)).min(axis=1)
    return starts[observed[starts].all(axis=1) & (share > 0.5)]


def _owners(trials: Sequence[Trajectory]) -> list[int]:
    """Per trial its index, or that of the first section of the same recording."""
    names = [t.excerpt.recording if t.excerpt else index for index, t in enumerate(trials)]
    return [names.index(name) for name in names]


def _channels(t: Trajectory, j: int, mode: str, speed: str, flow: Flow) -> tuple[np.ndarray, ...]:
    return (
        getattr(t, COMMAND_CHANNEL[mode])[:, j].astype(np.float64),
        t.position[:, j].astype(np.float64),
        _SPEED_OF[speed](t, j),
        t.effort[:, j].astype(np.float64),
        t.time - t.time[0] + t.start,
        _drawn(t, mode, flow),
    )


def by_speed(trials: Sequence[Trajectory], linear: Sequence[bool] = ()) -> Flow:
    """The flow as the speeds make it: rad/s; of a joint that slides, as much as one that turns has when both are as fast as
    they usually are.

    Args:
        linear: (J,) whether the joint slides; empty where nothing is known.
    """
    return _alike(np.concatenate([t.velocity for t in trials]), linear), 0.0


def by_opening(trials: Sequence[Trajectory], mode: str, linear: Sequence[bool] = ()) -> Flow:
    """The flow as the openings of the valves make it, in the size of the total speed.

    An opening draws oil under load too, where leakage takes it and the joint stands still.
    """
    errors = np.concatenate([_errors(t, mode) for t in trials])
    alike = (0.0, _alike(errors, linear))
    speed, opening = (np.concatenate([_drawn(t, mode, f) for t in trials]) for f in (by_speed(trials, linear), alike))
    return 0.0, alike[1] * float(np.sqrt(np.mean(speed**2) / max(np.mean(opening**2), 1e-300)))


def _alike(values: np.ndarray, linear: Sequence[bool]) -> np.ndarray | float:
    """(J,) factors that give joints that slide the usual size of those that turn; 1 for all of a kind. values: (T, J)."""
    slides = np.array(linear, dtype=bool)
    if not slides.any() or slides.all():
        return 1.0
    size = np.sqrt(np.mean(values**2, axis=0))
    return np.where(slides, np.median(size[~slides]) / np.maximum(size, 1e-12), 1.0)


def _drawn(t: Trajectory, mode: str, flow: Flow) -> np.ndarray:
    """(T,) flow of all joints together, rad/s."""
    drawn = (flow[0] * np.abs(t.velocity)).sum(axis=1)
    if np.any(flow[1]):
        drawn += (flow[1] * np.abs(_errors(t, mode))).sum(axis=1)
    return drawn


def _errors(t: Trajectory, mode: str) -> np.ndarray:
    """(T, J) what opens the valves, in the unit of the command: its error."""
    return getattr(t, COMMAND_CHANNEL[mode]) - (t.position if mode == "position" else t.effort)


def moved(position: np.ndarray, dt: float) -> np.ndarray:
    """Mean speed from each sample to the next, rad/s; its sum is the travel, whatever the encoder's resolution."""
    speed = np.empty(len(position))
    speed[:-1] = np.diff(position) / dt
    speed[-1] = speed[-2]
    return speed


def continued(position: np.ndarray, dt: float) -> np.ndarray:
    """`moved` from the positions up to each sample, rad/s: the speed of the step before it and its change, kept up."""
    before = np.diff(position, prepend=position[0]) / dt
    return before + np.diff(before, prepend=before[0])


_SPEED_OF = {
    MOVED: lambda t, j: moved(t.position[:, j], t.dt),
    LOGGED: lambda t, j: t.velocity[:, j].astype(np.float64),
    CONTINUED: lambda t, j: continued(t.position[:, j], t.dt),
}


def _sizes(fit: Sequence[Trajectory], j: int, mode: str, flow: Flow) -> dict[str, float]:
    def together(pick: Callable[[Trajectory], np.ndarray]) -> np.ndarray:
        return np.concatenate([away_from_stops(t, j, pick(t)) for t in fit])

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(values**2))) + 1e-12

    effort, velocity = rms(together(lambda t: t.effort[:, j])), rms(together(lambda t: t.velocity[:, j]))
    angle = float(np.std(together(lambda t: t.position[:, j])))
    drawn = rms(np.concatenate([_drawn(t, mode, flow) for t in fit]))
    return {
        scales.SECOND: 1.0,
        scales.NONE: 1.0,
        scales.COMMAND: rms(together(lambda t: _errors(t, mode)[:, j])),
        scales.EFFORT: effort,
        scales.VELOCITY: velocity,
        scales.SLOWNESS: 1.0 / drawn,
        scales.FLOW: drawn,
        scales.ANGLE: angle + 1e-12,
        scales.DAMPING: effort / velocity,
        scales.STIFFNESS: effort / (angle + 1e-12),
    }
