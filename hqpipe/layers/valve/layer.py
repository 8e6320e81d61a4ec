"""Joints moved by a valve whose command is logged: from the command to the motion."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.errors import IdentificationError
from hqpipe.identify.model import LayerJoints
from hqpipe.identify.window_choice import MIN_WINDOWS
from hqpipe.layers.refusal import no_joint_judged
from hqpipe.layers.valve.joint import ValveJoint, of_one_log, samples_of, settings_of
from hqpipe.layers.valve.kernel import FREE
from hqpipe.layers.valve.masks import at_end_stops, blocked, usual_speeds
from hqpipe.layers.valve.noise import sensor_noise
from hqpipe.layers.valve.parameters import base_parameters, effects
from hqpipe.layers.valve.record import Record, Scales, record_of, scales_of
from hqpipe.layers.valve.start import Look, first_look, sizes_of
from hqpipe.layers.valve.windows import windows_of
from hqpipe.logs.trajectory import LogSet, Trial

LEAST_ROWS = 20  # of a window; assumption: twice the least that a window of any layer has
LEAST_S = 0.1  # of a window: that of the other control modes
CLEAR = 30.0  # of the sensor's noise, that a joint travels in a window of usual speed, if its position is predicted; assumption
RESPONSES = 5.0  # times that a valve is late, in a window: what is left of a first-order response is e⁻⁵, 0.7 %
LONGEST_S = 2.0  # of a window chosen by these rules; assumption: longer than a valve and its joint take to settle
SHORTER = 0.9  # steps in which the longest windows are looked for
FEWEST_WINDOWS = 10  # of the fit trials; assumption: fewer do not tell an effect from chance


class Valve:
    """The actuator layer in control mode valve: command → velocity, judged by the velocity or the position that follows."""

    NAME = "actuator"

    def lacking(self, log_set: LogSet) -> list[str]:
        """Columns that the logs do not have."""
        has = all(t.trajectory.valve_command is not None for t in log_set.trials)
        return [] if has else ["valve_command"]

    def joints(self, log_set: LogSet, window_s: float | None = None, without: Collection[str] = ()) -> LayerJoints:
        """The joints that a valve command moves.

        Args:
            log_set: with valve commands. window_s: length of a free run; None for one that suits the logs.
            without: names of effects to leave out.

        Raises:
            IdentificationError: no joint can be judged.
        """
        if self.lacking(log_set):
            raise IdentificationError(
                f"{log_set.path}: no column valve_command, which the layer '{self.NAME}' in mode valve needs",
                file=log_set.path,
                field="valve_command",
                fix="record the command of the valves",
            )
        travels = any(t.trajectory.velocity_source == "differentiated" for t in log_set.trials)
        every = {name: _seen(log_set, j) for j, name in enumerate(log_set.joints)}
        left = {name: seen for name, seen in every.items() if isinstance(seen, str)}
        kept = {name: seen for name, seen in every.items() if not isinstance(seen, str)}
        length, reason = _window(log_set, kept, travels, window_s)
        models: list[ValveJoint] = []
        for name, seen in kept.items():
            model = _joint(log_set, name, seen, length, travels, without)
            if isinstance(model, str):
                left[name] = model
            else:
                models.append(model)
        if not models:
            raise no_joint_judged(
                log_set.path, "by its valve command", left, "record motions that the valve commands", "valve_command"
            )
        return LayerJoints(self.NAME, "free_run_rmse", length, reason, of_one_log(models), left)


@dataclass(frozen=True, eq=False)
class Seen:
    """What is known of a joint before it is modelled: sizes, fit record, noise of the position, and a first look."""

    scales: Scales
    record: Record
    noise: float
    look: Look


def _seen(log_set: LogSet, j: int) -> str | Seen:
    """What is known of joint `j`, or why it cannot be judged."""
    scales = scales_of(log_set.fit, j)
    if scales.command == 0.0:
        return "its valve command never changes"
    if scales.half_travel == 0.0 or scales.speed == 0.0:
        return "it never moves"
    record = _record(log_set, log_set.fit, j, scales)
    noise = sensor_noise(record.position, record, scales)
    return Seen(scales, record, noise, first_look(record, scales))


def _dt(log_set: LogSet) -> float:
    """s from sample to sample; all trials of a log set have one rate."""
    return float(np.median([t.trajectory.dt for t in log_set.trials]))


def _slides(log_set: LogSet, j: int) -> bool:
    return log_set.kinds.get(log_set.joints[j], "revolute") == "prismatic"


def _record(log_set: LogSet, trials: Sequence[Trial], j: int, scales: Scales) -> Record:
    """The samples of joint `j`; the speeds of joints of the other kind are given the size of its own."""
    same = np.array([_slides(log_set, k) == _slides(log_set, j) for k in range(len(scales.speeds))])
    speeds = np.maximum(np.array(scales.speeds), 1e-300)
    alike = np.where(same, 1.0, speeds[j] / speeds)
    return record_of(trials, j, scales, same, _slides(log_set, j), alike, _dt(log_set))


def _window(log_set: LogSet, joints: dict[str, Seen], travels: bool, window_s: float | None) -> tuple[float, str]:
    """Length of a free run, s, and why."""
    dt = _dt(log_set)
    if window_s is not None:
        return max(window_s, 10.0 * dt), "as asked for, and at least ten samples"
    length, reason = max(LEAST_ROWS * dt, LEAST_S), f"at least {LEAST_ROWS} samples and {LEAST_S:g} s"
    if not joints:
        return float(length), reason
    length, reason = _settled(log_set, joints, length, reason)
    if travels:
        clear = min(max(CLEAR * seen.noise / seen.scales.speed for seen in joints.values()), LONGEST_S)
        if clear > length:
            length, reason = clear, "the travel in shorter ones is not well above the noise of the position"
    return float(length), reason


def _settled(log_set: LogSet, joints: dict[str, Seen], least: float, reason: str) -> tuple[float, str]:
    """Length of a window, s, in which the slowest joint has responded, and why; `least` and its reason if that is longer."""
    slowest = max(joints, key=lambda name: joints[name].look.delay_s)
    late = joints[slowest].look.delay_s
    follows = f"the {1e3 * late:.0f} ms by which {slowest} follows its command"
    length, why = RESPONSES * late, f"{RESPONSES:g} times {follows}"
    if length > LONGEST_S:
        length, why = LONGEST_S, f"at most {LONGEST_S:g} s, less than {why}"
    while length > least and _windows(log_set, length) < MIN_WINDOWS:
        length, why = (
            SHORTER * length,
            f"of longer ones the trials hold fewer than {MIN_WINDOWS}; {RESPONSES:g} times {follows} were better",
        )
    return (length, why) if length > least else (least, reason)


def _windows(log_set: LogSet, length: float) -> int:
    """How many windows of `length` s the smaller of both splits holds, but for the first one of each trial."""
    splits = [trials for trials in (log_set.fit, log_set.heldout) if trials]
    return min(sum(max(int(t.trajectory.duration / length) - 1, 0) for t in trials) for trials in splits)


def _joint(
    log_set: LogSet,
    name: str,
    seen: Seen,
    window_s: float,
    travels: bool,
    without: Collection[str],
) -> str | ValveJoint:
    """The model of one joint, or why there is none."""
    scales, record, noise, look = seen.scales, seen.record, seen.noise, seen.look
    j, slides = log_set.joints.index(name), _slides(log_set, log_set.joints.index(name))
    held = _record(log_set, log_set.heldout, j, scales)
    ends = _ends(log_set.trials, j)
    stops = [at_end_stops(r, scales, np.sign(look.gain), ends, noise) for r in (record, held)]
    curve = usual_speeds(record, scales, record.observed & ~stops[0], round(look.delay_s / record.dt))
    stuck = [blocked(r, scales, r.observed & ~s, curve) for r, s in zip((record, held), stops, strict=True)]
    for r, s, b in zip((record, held), stops, stuck, strict=True):
        r.signals[FREE, s | b] = 0.0
    steps = max(round(window_s / record.dt), 2)
    cuts = [windows_of(r, scales, s | b, steps, noise) for r, s, b in zip((record, held), stops, stuck, strict=True)]
    if len(cuts[0].begin) < FEWEST_WINDOWS:
        return f"only {len(cuts[0].begin)} windows of {window_s:.3g} s in which it is commanded or moves"
    own_demand = 0.0 if record.supply else 1.0
    size = sizes_of(record, scales, look, len(log_set.joints), slides)
    output_noise = noise * np.sqrt(1.0 + 1.0 / cuts[0].begin_samples)
    if not travels:
        output_noise = sensor_noise(record.velocity, record, scales)
    length_unit = "m" if slides else "rad"
    return ValveJoint(
        joint=name,
        unit=length_unit if travels else f"{length_unit}/s",
        dt=record.dt,
        base=base_parameters(size),
        effects=effects(size, without),
        fit=samples_of(record, cuts[0], travels),
        heldout=samples_of(held, cuts[1], travels),
        noise=(float(output_noise), float(output_noise)),
        notes=_notes(record, held, stops, stuck),
        travels=travels,
        settings=settings_of(scales.command, own_demand, float(record.time.max())),
        records=(record, held),
        windows=(cuts[0], cuts[1]),
    )


def _ends(trials: Sequence[Trial], j: int) -> tuple[float, float]:
    positions = [t.trajectory.position[:, j] for t in trials]
    return min(float(q.min()) for q in positions), max(float(q.max()) for q in positions)


def _notes(record: Record, held: Record, stops: list[np.ndarray], stuck: list[np.ndarray]) -> tuple[str, ...]:
    found, dt = [], record.dt
    at_stops, standing = sum(int(s.sum()) for s in stops), sum(int(s.sum()) for s in stuck)
    total = len(record.command) + len(held.command)
    if at_stops:
        found.append(f"stood at an end stop for {at_stops * dt:.3g} s ({at_stops / total:.1%}) in all: left out")
    if standing:
        found.append(
            f"stood still for {standing * dt:.3g} s ({standing / total:.1%}) under commands that move it elsewhere, as when"
            " something blocks it: left out"
        )
    return tuple(found)
