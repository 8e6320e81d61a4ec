"""Which effects cause the gap of a log set's actuator layer, and how far each of them shrinks it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.effects.layout import slot
from hqpipe.gap.causes import Cause, assemble
from hqpipe.gap.integrator_start import tell_offsets
from hqpipe.gap.joint_data import (
    LOGGED,
    MOVED,
    SPEEDS,
    Flow,
    JointData,
    by_opening,
    by_speed,
    joint_data,
)
from hqpipe.gap.joint_state import JointState, Progress, library, search_joints
from hqpipe.gap.noise import free_run_floor
from hqpipe.gap.replay import Replay
from hqpipe.gap.rest import Rest
from hqpipe.gap.row_model import FLOW, RowModel, SpanRow, kept, replay_all
from hqpipe.gap.second_look import look_again
from hqpipe.gap.set_fit import JointFitter
from hqpipe.gap.shapley import Shrink, shapley
from hqpipe.gap.sharing import pool_groups, seek_consensus
from hqpipe.gap.signs import SignedLogs
from hqpipe.gap.since import Earlier
from hqpipe.gap.spans import Spans, search_spans
from hqpipe.gap.supply import without_steady
from hqpipe.gap.unchanged import drop_unchanged, familiar_error, only_needed
from hqpipe.gap.worth import close_gap, drop_outweighed, drop_slight, drop_trifles
from hqpipe.logs.joint_kinds import PRISMATIC
from hqpipe.logs.survey.signal import difference_noise
from hqpipe.logs.trajectory import LogSet, Trajectory, recording_of

BLURRED = ("backlash",)  # a size is noise round zero torque, which looks like slack once the sign is restored
SHARED = "supply_droop"  # the effect that reads what other joints draw, too
RUBBING = "viscous_friction"  # the effect that shows to which instant a row's torque belongs
EARLIER_OR_LATER = (0.0, -0.25, 0.25, -0.5, 0.5)
"""Samples: a torque may be that of an instant, or a mean of the step before or behind it."""
WINDOWS_PER_BLOCK = 5  # of 0.1 s: errors of neighbouring windows are correlated


@dataclass(frozen=True, eq=False)
class Accusation:
    """What the search found.

    Attributes:
        library: effects that were candidates.
        states: one per joint.
        causes: most important first. shrink: their shares.
        passing: those of them that act for a part of each trial only; spans: when.
        base, rest: the machine without and with the effects on the logs.
        floor: (J,) mean squared error that is no gap: what noise leaves, or an earlier record of the machine.
        noise: (J,) what noise alone leaves. sensor: (J,) the same of the output's sensor only.
        familiar: (J,) what an earlier record may be off by without anything having changed; 0 without one.
        raw: (W, J) held-out squared error per window of the base model on the log as it came, where a torque had lost its
            sign; else None.
        final: (W, J) the same with all causes in the model.
    """

    library: tuple[str, ...]
    states: list[JointState]
    causes: list[Cause]
    passing: tuple[Cause, ...]
    spans: Spans | None
    shrink: Shrink
    base: Rest
    rest: Rest
    floor: np.ndarray
    noise: np.ndarray
    sensor: np.ndarray
    familiar: np.ndarray
    raw: np.ndarray | None
    final: np.ndarray

    @property
    def scale(self) -> np.ndarray:
        """(J,) what the errors of the joints count against where they are pooled."""
        return np.array([state.data.scale for state in self.states])

    @property
    def before(self) -> RowModel:
        """The machine without the effects."""
        return self.base.machine

    @property
    def after(self) -> RowModel:
        """The machine with the effects."""
        return self.rest.machine

    @property
    def heldout(self) -> list[Replay]:
        """Held-out trials, replayed without the effects."""
        return self.base.heldout


def accuse(
    log_set: LogSet,
    steps: int,
    without: Sequence[str] = (),
    signed: SignedLogs | None = None,
    effort_limit: np.ndarray | None = None,
    workers: int = 1,
    progress: Progress | None = None,
    earlier: Earlier | None = None,
) -> Accusation:
    """Search the causes of a log set whose channels have been checked.

    Args:
        log_set: with the command, position, velocity and output of its control mode.
        steps: samples per window.
        without: effects left out of the library.
        signed: joints whose torque was given its sign back.
        effort_limit: (J,) N·m.
        workers: joints searched at a time. progress: called after each joint.
        earlier: a record of the machine, where the question is what changed since.
    """
    mode, joints = log_set.control_mode, log_set.joints
    names = library(mode, log_set.effort_source, len(joints), without, changes=earlier is not None)
    names = without_steady(names, log_set)
    data, speed = prepare(log_set, names, steps, signed, effort_limit, earlier, workers)
    states = search_joints(data, names, workers, progress)
    base = Rest(_machine(states, mode, speed, chosen=False), log_set, steps)
    states = look_again(states, seek_consensus(pool_groups(seek_consensus(states))), workers)
    states = tell_offsets(states, workers)
    noise = _floor(_machine(states, mode, speed, chosen=True), states, log_set, steps)
    familiar = noise + familiar_error(states, base.heldout) if earlier is not None else np.zeros(len(joints))
    floor = np.maximum(noise, np.minimum(familiar, [state.chosen.error for state in states]))
    states = _tidy(drop_unchanged(only_needed(states, noise, familiar), floor), floor)
    rest = Rest(_machine(states, mode, speed, chosen=True), log_set, steps)
    if earlier is None:  # else what the record itself misses could still be explained, too
        sensor = _sensor_floor(rest.machine, states, steps)
        states = drop_outweighed(states, assemble(states, floor), sensor, rest)
    spans = _tidy_spans(search_spans(states, floor, workers), states, floor)
    after = _with_spans(_machine(states, mode, speed, chosen=True), spans, log_set)
    if spans or not np.array_equal(after.rows, rest.machine.rows):
        rest = rest.of(after)
    causes = assemble(states, floor)
    lasting = len(causes)
    if spans:
        inside = [joints.index(state.joint) for state in spans.states]
        passing = assemble(spans.states, floor[inside], joints)
        causes += passing if earlier else [replace(cause, then={}) for cause in passing]  # beside the rest of the trial
    shrink = _shrink(states, causes, lasting, spans)
    order = sorted(range(len(causes)), key=lambda i: -shrink.each[i])
    shrink = Shrink(shrink.each[order], shrink.each_ci95[order], shrink.whole, shrink.whole_ci95)
    return Accusation(
        names,
        states,
        [causes[i] for i in order],
        tuple(causes[lasting:]),
        spans,
        shrink,
        base,
        rest,
        floor,
        noise,
        _sensor_floor(after, states, steps),
        familiar,
        _raw_error(signed, states, data, steps, mode, speed) if signed and signed.findings else None,
        _final_error(states, spans),
    )


def prepare(
    log_set: LogSet,
    names: Sequence[str],
    steps: int,
    signed: SignedLogs | None,
    effort_limit: np.ndarray | None,
    earlier: Earlier | None = None,
    workers: int = 1,
) -> tuple[list[JointData], str]:
    """Windows of every joint with the speed that the model fits better, and that speed.

    What a sagging supply would feel, speeds or valve openings, is chosen likewise, and the instant at which friction acts.
    An earlier record of the machine has chosen already, as far as it says.

    Returns:
        (J,) data, and one of `hqpipe.gap.joint_data.SPEEDS`.
    """
    mode, joints = log_set.control_mode, log_set.joints
    fit, heldout = ([t.trajectory for t in split] for split in (log_set.fit, log_set.heldout))
    linear = [log_set.kinds.get(joint) == PRISMATIC for joint in joints]

    def cut_up(speed: str, flow: Flow) -> list[JointData]:
        data = []
        for j, joint in enumerate(joints):
            noise = output_noise(heldout or fit, j)
            limit = np.inf if effort_limit is None else float(effort_limit[j])
            one = joint_data(fit, heldout, j, mode, steps, noise, limit, speed, flow, linear[j])
            data.append(replace(one, barred=BLURRED) if signed and joint in signed.joints else one)
        return data

    if earlier is not None:
        return _as_then(earlier, cut_up, joints, by_speed(fit, linear), workers)
    flow = by_speed(fit, linear)
    speed, data = MOVED, cut_up(MOVED, flow)
    logged = cut_up(LOGGED, flow)  # two cuts at a time: they are the largest thing in memory
    if _least_misfit(logged, names, workers) < _least_misfit(data, names, workers):
        speed, data = LOGGED, logged
    del logged
    shift = 0.0
    if RUBBING in names:
        shift = min(EARLIER_OR_LATER, key=lambda rows: _misfit(_timed(data, rows), (RUBBING,), workers))
        data = _timed(data, shift)
    if SHARED in names:
        opened = _timed(cut_up(speed, by_opening(fit, mode, linear)), shift)
        data = min(data, opened, key=lambda option: _misfit(option, (SHARED,), workers))
    return data, speed


def _as_then(
    earlier: Earlier, cut_up: Callable[[str, Flow], list[JointData]], joints: Sequence[str], flow: Flow, workers: int
) -> tuple[list[JointData], str]:
    """The joints beside an earlier record, with its speed and flow; where it says neither, the speed that suits, and `flow`."""
    known = np.nan_to_num([earlier.then[joint].row[FLOW] for joint in joints])
    flow = tuple(known.T) if known.any() else flow
    options = {speed: earlier.beside(cut_up(speed, flow)) for speed in ([earlier.speed] if earlier.speed else SPEEDS)}
    speed = min(options, key=lambda name: _misfit(options[name], (), workers))
    return options[speed], speed


def _timed(data: Sequence[JointData], rows: float) -> list[JointData]:
    """The joints with speeds that belong `rows` samples later than assumed."""
    column = slot("setting", "speed_late")
    return [replace(d, row=np.where(np.arange(len(d.row)) == column, d.row + rows, d.row)) for d in data]


def _misfit(data: Sequence[JointData], names: tuple[str, ...], workers: int) -> float:
    """Sum of the logarithms of the joints' losses with a set of effects."""
    with ThreadPoolExecutor(max(workers, 1)) as pool:
        losses = pool.map(lambda one: JointFitter(one).fit(names).loss, data)
        return sum(np.log(loss + 1e-300) for loss in losses)


def _least_misfit(data: Sequence[JointData], names: Sequence[str], workers: int) -> float:
    """The same with the effect that explains most of each joint by itself, or none: an effect that is missing can change the
    error by more than the choice of the speed does, and the fit of the base adapts to it."""

    def least(one: JointData) -> float:
        fitter = JointFitter(one)
        return min(fitter.fit((name,) if name else ()).loss for name in ("", *names) if name not in one.barred)

    with ThreadPoolExecutor(max(workers, 1)) as pool:
        return sum(np.log(loss + 1e-300) for loss in pool.map(least, data))


def _floor(machine: RowModel, states: list[JointState], log_set: LogSet, steps: int) -> np.ndarray:
    """(J,) mean squared error that noise alone leaves; no more than what the best model leaves."""
    sensor = np.array([state.data.noise for state in states]) ** 2
    floor = free_run_floor(replay_all(machine, log_set.heldout, steps), sensor, kept(machine, steps))
    return np.minimum(floor, [state.chosen.error for state in states])


def _sensor_floor(machine: RowModel, states: list[JointState], steps: int) -> np.ndarray:
    """(J,) mean squared error that the noise of the output's sensor leaves: at each sample, and at the restart."""
    noise = np.array([state.data.noise for state in states]) ** 2
    return noise * (1.0 + kept(machine, steps) ** 2).mean(axis=0)


def _tidy(states: list[JointState], floor: np.ndarray) -> list[JointState]:
    """Without the names that close too little of a joint's gap, are no fault, or shrink the machine's by next to nothing."""
    states = close_gap(states, floor)
    states = drop_slight(states, assemble(states, floor))
    causes = assemble(states, floor)
    shares = _shrink(states, causes, len(causes), None)
    return drop_trifles(states, causes, shares.each, shares.each_ci95[:, 0])


def _tidy_spans(spans: Spans | None, states: list[JointState], floor: np.ndarray) -> Spans | None:
    """The stretches without the names that shrink the machine's gap by next to nothing."""
    if spans is None:
        return None
    joints = tuple(state.joint for state in states)
    passing = assemble(spans.states, floor[[joints.index(state.joint) for state in spans.states]], joints)
    shares = _shrink(states, passing, 0, spans)
    kept = drop_trifles(spans.states, passing, shares.each, shares.each_ci95[:, 0])
    kept = [state for state in kept if state.chosen.effects]
    return replace(spans, states=kept) if kept else None


def _final_error(states: list[JointState], spans: Spans | None) -> np.ndarray:
    inside = {state.joint: state for state in spans.states} if spans else {}
    return np.stack(
        [
            s.data.heldout.of_machine(
                spans.errors(s.joint, inside[s.joint].chosen.heldout) if s.joint in inside else s.chosen.heldout
            )
            for s in states
        ],
        axis=1,
    )


def _raw_error(
    signed: SignedLogs, states: list[JointState], data: Sequence[JointData], steps: int, mode: str, speed: str
) -> np.ndarray:
    """What the base model makes of the unsigned torque, in the joints that have it."""
    trials = {name: [t.trajectory for t in getattr(signed.raw, name)] for name in ("fit", "heldout")}
    errors = []
    for state, one in zip(states, data, strict=True):
        if state.joint in signed.joints:
            j = signed.raw.joints.index(state.joint)
            unsigned = joint_data(trials["fit"], trials["heldout"], j, mode, steps, one.noise, speed=speed)
            if one.then is not None:  # the reference's own error, not that of a fit
                unsigned = replace(unsigned, then=one.then, row=one.row)
            errors.append(unsigned.heldout.of_machine(JointFitter(unsigned).fit().heldout))
        else:
            errors.append(state.of_machine(state.base))
    return np.stack(errors, axis=1)


def output_noise(trials: Sequence[Trajectory], j: int) -> float:
    """Standard deviation of the sensor noise of the torque of one joint."""
    return float(np.sqrt(np.mean([difference_noise(t.effort[:, j]) ** 2 for t in trials])))


def _machine(states: list[JointState], mode: str, speed: str, chosen: bool) -> RowModel:
    rows = [state.chosen.row if chosen else state.base.row for state in states]
    return RowModel(tuple(state.joint for state in states), np.array(rows), mode, speed)


def _with_spans(model: RowModel, spans: Spans | None, log_set: LogSet) -> RowModel:
    """The machine with other rows in the stretches; outside of them the joint is sound."""
    if spans is None:
        return model
    rows, extra = model.rows.copy(), {}
    files = [recording_of(trial) for trial in log_set.heldout]
    stretches = {files[index]: (start, end) for index, start, end in spans.stretches}
    for state in spans.states:
        j = model.joints.index(state.joint)
        rows[j] = spans.outside[state.joint].row
        extra[j] = SpanRow(state.chosen.row, stretches)
    return replace(model, rows=rows, spans=extra)


def _shrink(states: list[JointState], causes: list[Cause], lasting: int, spans: Spans | None) -> Shrink:
    """Shapley shares of the causes, over the held-out windows of all joints, each against its own scale.

    Args:
        causes: the first `lasting` of them act all the time, the others inside `spans`.
    """
    edges = np.arange(0, len(states[0].data.heldout.machine_first), WINDOWS_PER_BLOCK)
    passing = {state.joint: state for state in spans.states} if spans else {}

    def error(state: JointState, subset: frozenset[int]) -> np.ndarray:
        active = [i for i in subset if state.joint in causes[i].joints]
        if not active:
            return state.base.heldout
        names = [causes[i].effect for i in active]
        if active[0] >= lasting:
            inside = passing[state.joint]
            left = spans.errors(state.joint, inside.search.fit(names, [inside.chosen]).heldout)
        else:
            left = state.search.fit(names, [state.chosen]).heldout
        return left if np.isfinite(left).all() else state.base.heldout  # a set that runs away explains nothing

    def errors(subset: frozenset[int]) -> np.ndarray:
        return sum(
            np.add.reduceat(s.data.heldout.of_machine(error(s, subset)), edges) / s.data.scale**2 for s in states
        )

    if not causes:
        zero = np.zeros((0, 2))
        return Shrink(np.zeros(0), zero, 0.0, (0.0, 0.0))
    return shapley(len(causes), errors)
