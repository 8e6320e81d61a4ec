"""Joints whose torque is commanded and measured: from the command to the effort."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.errors import IdentificationError
from hqpipe.identify.model import LayerJoints
from hqpipe.layers.torque.joint import TorqueJoint, samples_of
from hqpipe.layers.torque.likely import likely_start
from hqpipe.layers.torque.noise import error_noise
from hqpipe.layers.torque.parameters import Sizes, base_parameters, effects
from hqpipe.layers.torque.record import Record, Scales, record_of, scales_of
from hqpipe.layers.torque.start import Look, first_look
from hqpipe.layers.torque.windows import Windows, windows_of
from hqpipe.logs.end_stops import at_end_stop, mark_end_stops
from hqpipe.logs.joint_kinds import unit_of
from hqpipe.logs.trajectory import LogSet

PRESSURE = "pressure"  # source of an effort that knows nothing of friction
NEEDED = ("effort_command", "effort", "position", "velocity")
LEAST_ROWS, LEAST_S = 20, 0.1  # of a window; assumption: as in the other layers
RESPONSES, LEAD, LONGEST_S = 15.0, 3.0, 0.5
"""Response times of the loop in a window, and before its first judged sample, where the noise of its start has faded to 5 %; s
of a window chosen by these rules. assumption"""
STEP, LONGEST_STEP_S = 0.25, 1e-3
"""Longest substep: of a response time, where the midpoint rule errs by less than a hundredth; s, for the lag of a servo
valve."""
FIRST_STEPS = 8_000  # substeps of each try before anything is fitted
STABLE = 0.8  # of a response time, a substep beyond which the midpoint rule grows
NOTABLE = 0.05  # of a steady command or the usual effort, from which a loss is told; assumption
FEWEST_WINDOWS = 10  # of the fit trials; assumption: fewer do not tell an effect from chance


@dataclass(frozen=True, eq=False)
class Seen:
    """What is known of a joint before it is modelled: sizes, records of both splits, and a first look."""

    scales: Scales
    records: tuple[Record, Record]
    look: Look


class Torque:
    """The actuator layer in control mode torque: commanded torque → measured torque."""

    NAME = "actuator"

    def lacking(self, log_set: LogSet) -> list[str]:
        """Columns that the logs do not have."""
        return [name for name in NEEDED if any(getattr(t.trajectory, name) is None for t in log_set.trials)]

    def joints(self, log_set: LogSet, window_s: float | None = None, without: Collection[str] = ()) -> LayerJoints:
        """The joints whose torque is commanded.

        Args:
            log_set: with commanded and measured efforts; where no end stops are marked, they are looked for.
            window_s: length of a free run; None for one that suits the logs.
            without: names of effects to leave out.

        Raises:
            IdentificationError: no joint can be judged.
        """
        lacking = self.lacking(log_set)
        if lacking:
            raise IdentificationError(
                f"{log_set.path}: no column {' and '.join(lacking)}, which the layer '{self.NAME}' in mode torque needs",
                file=log_set.path,
                field=lacking[0],
                fix="record the commanded and the measured torque of the joints",
            )
        told: tuple[str, ...] = ()
        if all(at_end_stop(trial.trajectory) is None for trial in log_set.trials):
            log_set, told = mark_end_stops(log_set)
        every = {name: _seen(log_set, j) for j, name in enumerate(log_set.joints)}
        left = {name: seen for name, seen in every.items() if isinstance(seen, str)}
        kept = {name: seen for name, seen in every.items() if not isinstance(seen, str)}
        length, reason = _window(log_set, kept, window_s)
        models = []
        for name, seen in kept.items():
            model = _joint(log_set, name, seen, length, without)
            if isinstance(model, str):
                left[name] = model
            else:
                models.append(model)
        if not models:
            reasons = "; ".join(f"{name}: {text}" for name, text in left.items())
            raise IdentificationError(
                f"{log_set.path}: no joint can be judged by its commanded torque ({reasons})",
                file=log_set.path,
                field="effort_command",
                fix="record motions under changing commands",
            )
        return LayerJoints(self.NAME, "free_run_rmse", length, reason, tuple(models), left, told)


def _dt(log_set: LogSet) -> float:
    """s from sample to sample; all trials of a log set have one rate."""
    return float(np.median([t.trajectory.dt for t in log_set.trials]))


def _seen(log_set: LogSet, j: int) -> str | Seen:
    """What is known of joint `j`, or why it cannot be judged."""
    scales = scales_of(log_set.fit, j)
    if scales.effort == 0.0 or scales.error == 0.0:
        return "its measured torque never changes, or is its command"
    if scales.half_travel == 0.0 or scales.speed == 0.0:
        return "it never moves"
    fit, held = (record_of(trials, j, scales, _dt(log_set)) for trials in (log_set.fit, log_set.heldout))
    return Seen(scales, (fit, held), first_look(fit))


def _window(log_set: LogSet, joints: dict[str, Seen], window_s: float | None) -> tuple[float, str]:
    """Length of a free run, s, and why."""
    dt = _dt(log_set)
    if window_s is not None:
        return max(window_s, 10.0 * dt), "as asked for, and at least ten samples"
    slowest = max((RESPONSES / seen.look.rate + seen.look.delay_s for seen in joints.values()), default=0.0)
    length = max(LEAST_ROWS * dt, LEAST_S, min(slowest, LONGEST_S))
    return float(length), f"at least {LEAST_ROWS} samples and {RESPONSES:.0f} response times of the slowest loop"


def _joint(log_set: LogSet, name: str, seen: Seen, window_s: float, without: Collection[str]) -> str | TorqueJoint:
    """The model of one joint, or why there is none."""
    dt, look, scales = _dt(log_set), seen.look, seen.scales
    steps = max(round(window_s / dt), 2)
    lead = min(int(np.ceil(LEAD / look.rate / dt)), steps // 3)
    substeps = int(np.clip(np.ceil(max(dt * look.rate / STEP, dt / LONGEST_STEP_S) - 1e-6), 1, 40))
    fastest = STABLE * substeps / dt
    cuts = [windows_of(r, steps, lead, substeps) for r in seen.records]
    if cuts[0].windows < FEWEST_WINDOWS:
        return f"only {cuts[0].windows} windows of {window_s:.3g} s away from its end stops"
    kind = log_set.kinds.get(name)
    size = _sizes(seen, dt, len(log_set.joints) == 1, log_set.effort_source != PRESSURE, kind)
    sensor = [error_noise(r, look.rate, look.speed_share) for r in seen.records]

    def built(size: Sizes, leave: Collection[str], cuts: tuple[Windows, Windows]) -> TorqueJoint:
        return TorqueJoint(
            joint=name,
            unit=size.unit,
            dt=dt,
            base=base_parameters(size, fastest),
            effects=effects(size, leave),
            fit=samples_of(seen.records[0], cuts[0]),
            heldout=samples_of(seen.records[1], cuts[1]),
            noise=(sensor[0], sensor[1]),
            notes=_notes(seen, size),
            settings={
                "dt": dt,
                "error_scale": size.opening,
                "speed_scale": scales.speed,
                "effort_scale": scales.effort,
                "most_effort": scales.most_effort,
                "longest_s": scales.longest_s,
            },
            records=seen.records,
            windows=(cuts[0], cuts[1]),
        )

    def opening_of(compensation: float) -> tuple[float, float]:
        return _opening(seen.records[0], compensation)

    few = windows_of(seen.records[0], steps, lead, substeps, FIRST_STEPS)
    tried = built(size, (), (few, cuts[1]))
    rate, found = likely_start(tried, scales.effort / scales.speed, fastest, opening_of)
    usual, full = opening_of(found)
    return built(replace(size, rate=rate, compensation=found, opening=usual, full=full), without, (cuts[0], cuts[1]))


def _sizes(seen: Seen, dt: float, alone: bool, at_output: bool, kind: str | None) -> Sizes:
    scales, look = seen.scales, seen.look
    usual, full = _opening(seen.records[0], 0.0)
    return Sizes(
        dt=dt,
        rate=look.rate,
        first_rate=look.rate,
        delay_s=look.delay_s,
        speed_share=look.speed_share,
        offset=look.offset,
        leak=look.leak,
        compensation=0.0,
        opening=usual,
        full=full,
        effort=scales.effort,
        most_effort=scales.most_effort,
        speed=scales.speed,
        longest_s=scales.longest_s,
        supply=seen.records[0].supply,
        at_output=at_output,
        alone=alone,
        unit=unit_of("N·m", kind),
        speed_unit=unit_of("rad/s", kind),
    )


def _opening(record: Record, compensation: float) -> tuple[float, float]:
    """Usual and largest opening of the valve, in the unit of the torque error, if the drive adds so much for the speed."""
    found = record.command - record.effort + compensation * record.velocity
    return float(np.sqrt(np.mean(found**2))), float(np.quantile(np.abs(found), 0.9999))


def _notes(seen: Seen, size: Sizes) -> tuple[str, ...]:
    """What the base model takes from the commanded torque, where it is more than a little."""
    share = 1.0 / (1.0 + seen.look.leak)
    lost, found = seen.look.speed_share * share, []
    if abs(share - 1.0) >= NOTABLE:
        found.append(f"holds {share:.0%} of a steady command")
    if abs(lost) * size.speed >= NOTABLE * size.effort:
        found.append(f"{'loses' if lost > 0.0 else 'gains'} {abs(lost):.3g} {size.unit}/({size.speed_unit}) of speed")
    if not found:
        return ()
    return (f"the drive {' and '.join(found)}: the base model holds this, and no cause is named for it",)
