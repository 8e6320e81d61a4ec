"""The model of one joint with a force loop, from its logs."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.layers.torque.joint import TorqueJoint, samples_of
from hqpipe.layers.torque.likely import likely_start
from hqpipe.layers.torque.noise import error_noise
from hqpipe.layers.torque.parameters import Sizes, base_parameters, effects
from hqpipe.layers.torque.record import Record, Scales, record_of, scales_of
from hqpipe.layers.torque.start import Look, first_look
from hqpipe.layers.torque.windows import Windows, windows_of
from hqpipe.logs.joint_kinds import unit_of
from hqpipe.logs.trajectory import LogSet

PRESSURE = "pressure"  # source of an effort that knows nothing of friction
LEAD = 3.0  # response times of the loop before the first judged sample, where the noise of its start has faded to 5 %
STEP, LONGEST_STEP_S = 0.25, 1e-3
"""Longest substep: of a response time, where the midpoint rule errs by less than a hundredth; s, for the lag of a servo
valve."""
MOST_SUBSTEPS = 40  # of a sample; assumption: logs of 25 Hz
STABLE = 0.8  # of a response time, a substep beyond which the midpoint rule grows
FIRST_STEPS = 8_000  # substeps of each try before anything is fitted
FEWEST_WINDOWS = 10  # of the fit trials; assumption: fewer do not tell an effect from chance
NOTABLE = 0.05  # of a steady command or the usual effort, from which a loss is told; assumption


@dataclass(frozen=True, eq=False)
class Seen:
    """What is known of a joint before it is modelled: sizes, records of both splits, and a first look."""

    scales: Scales
    records: tuple[Record, Record]
    look: Look


def seen_in(log_set: LogSet, j: int, dt: float) -> str | Seen:
    """What is known of joint `j`, or why it cannot be judged; dt: s, from sample to sample."""
    scales = scales_of(log_set.fit, j)
    if scales.effort == 0.0:
        return "its measured torque never changes"
    if scales.error == 0.0:
        return "its measured torque is its command in every sample: log what a sensor measures"
    if scales.half_travel == 0.0 or scales.speed == 0.0:
        return "it never moves"
    fit, held = (record_of(trials, j, scales, dt) for trials in (log_set.fit, log_set.heldout))
    return Seen(scales, (fit, held), first_look(fit))


def joint_of(log_set: LogSet, name: str, seen: Seen, window_s: float, without: Collection[str]) -> str | TorqueJoint:
    """The model of one joint, or why there is none.

    Args:
        window_s: length of a free run. without: names of effects to leave out.
    """
    look, dt = seen.look, seen.records[0].dt
    steps = max(round(window_s / dt), 2)
    lead = min(int(np.ceil(LEAD / look.rate / dt)), steps // 3)
    substeps = int(np.clip(np.ceil(max(dt * look.rate / STEP, dt / LONGEST_STEP_S) - 1e-6), 1, MOST_SUBSTEPS))
    fastest = STABLE * substeps / dt
    fit, held = (windows_of(record, steps, lead, substeps) for record in seen.records)
    if fit.windows < FEWEST_WINDOWS:
        return f"only {fit.windows} windows of {window_s:.3g} s away from its end stops"
    first = _sizes(seen, len(log_set.joints) == 1, log_set.effort_source != PRESSURE, log_set.kinds.get(name))
    few = windows_of(seen.records[0], steps, lead, substeps, FIRST_STEPS)
    tried = _model(name, seen, first, fastest, (few, held), ())

    def opening_of(compensation: float) -> tuple[float, float]:
        return _opening(seen.records[0], compensation)

    rate, found = likely_start(tried, first.effort / first.speed, fastest, opening_of)
    usual, full = opening_of(found)
    size = replace(first, rate=rate, compensation=found, opening=usual, full=full)
    return _model(name, seen, size, fastest, (fit, held), without)


def _model(
    name: str, seen: Seen, size: Sizes, fastest: float, cuts: tuple[Windows, Windows], without: Collection[str]
) -> TorqueJoint:
    """The joint with its effects, judged on the samples of `cuts`."""
    fit, held = (error_noise(record, seen.look.rate, seen.look.speed_share) for record in seen.records)
    return TorqueJoint(
        joint=name,
        unit=size.unit,
        dt=size.dt,
        base=base_parameters(size, fastest),
        effects=effects(size, without),
        fit=samples_of(seen.records[0], cuts[0]),
        heldout=samples_of(seen.records[1], cuts[1]),
        noise=(fit, held),
        notes=_notes(seen, size),
        settings={
            "dt": size.dt,
            "error_scale": size.opening,
            "speed_scale": size.speed,
            "effort_scale": size.effort,
            "most_effort": size.most_effort,
            "longest_s": size.longest_s,
        },
        records=seen.records,
        windows=cuts,
    )


def _sizes(seen: Seen, alone: bool, at_output: bool, kind: str | None) -> Sizes:
    """Sizes before anything is fitted: no compensation, the rate of the first look."""
    scales, look = seen.scales, seen.look
    usual, full = _opening(seen.records[0], 0.0)
    return Sizes(
        dt=seen.records[0].dt,
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
