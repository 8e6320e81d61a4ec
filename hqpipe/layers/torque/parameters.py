"""Base parameters and effects of a force loop on a valve, with what a data sheet would say of their size."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from hqpipe.identify.model import Effect, Parameter

NEVER = 1.2  # of the largest opening: a valve that is fully open only there never is
MOST_DELAY_S, MOST_LAG_S = 0.2, 0.1  # assumption: a force loop with more would not be stable at any useful gain
LATE_SPEED_S = 0.02  # that the logged speed may be late or early; assumption: a slower filter is of no use to a drive
BEYOND = 0.25  # of a sample, by which a row may lie beyond either convention; assumption: as in valve mode
LOADED = 20.0  # of the largest effort: an effort at which the flow would stop, so large that nobody notices
SLOWEST = 5.0  # 1/s; assumption: a joint that answers slower than in 0.2 s has no force loop
COMPENSATED = 100.0
"""Of usual effort per usual speed; assumption: an oil spring is stiff, so that its speed takes much opening."""


@dataclass(frozen=True)
class Sizes:
    """Sizes in the fit trials that bounds and priors are multiples of.

    Attributes:
        dt: s. rate: 1/s, as is likely. first_rate: 1/s, delay_s: s, speed_share, offset, leak: of a first-order loop that was
            fitted to the logs. compensation: what the drive seems to add to the torque error per speed.
        opening: usual, full: largest opening of the valve, in the unit of the torque error.
        effort: usual about its mean; most_effort: largest. speed: usual where the joint moves.
        longest_s: of the trials. supply: whether its pressure is logged. at_output: whether friction may lie
            between the drive and the sensor of the torque. alone: whether no other joint is.
        unit: of the effort. speed_unit: of the joint.
    """

    dt: float
    rate: float
    first_rate: float
    delay_s: float
    speed_share: float
    offset: float
    leak: float
    compensation: float
    opening: float
    full: float
    effort: float
    most_effort: float
    speed: float
    longest_s: float
    supply: bool
    at_output: bool
    alone: bool
    unit: str
    speed_unit: str


def base_parameters(size: Sizes, fastest: float) -> tuple[Parameter, ...]:
    """Rate of the loop, what the speed takes, the offset, what the drive adds for the speed, and the row of the command.

    What the drive adds passes the valve, and what the motion takes does not. While the valve is linear and prompt only their
    difference `speed_share` shows, and `compensation` does nothing. A valve with a null shift and a torque sensor with a bias
    give the same `offset`. A loop without an integrator lacks in the steady state what leaks past the piston, `leak` times
    the torque. `row_offset_s` is the log's, as in valve mode, and `speed_lead_s` is by how much the logged speed is late.

    Args:
        fastest: 1/s, rate that the simulation bears.
    """
    starts = tuple(dict.fromkeys((size.rate, min(size.first_rate, fastest))))
    per_speed = f"{size.unit}/({size.speed_unit})"
    most = COMPENSATED * size.effort / size.speed
    return (
        Parameter("rate", "1/s", size.rate, np.inf, min(SLOWEST, size.rate), fastest, starts),
        Parameter("speed_share", per_speed, size.speed_share, np.inf),
        Parameter("offset", size.unit, size.offset, np.inf),
        Parameter("leak", "1", size.leak, np.inf, -0.5, 4.0),
        # The speed may take many times the usual error, or nothing; assumption: the logs decide.
        Parameter("compensation", per_speed, size.compensation, 0.2 * most, 0.0, most),
        Parameter("row_offset_s", "s", 0.5 * size.dt, 0.5 * size.dt, -BEYOND * size.dt, (1.0 + BEYOND) * size.dt),
        # Drives filter the speed that they log, at 30 to 300 Hz; assumption.
        Parameter("speed_lead_s", "s", 0.0, 0.003, -LATE_SPEED_S, LATE_SPEED_S),
    )


def effects(size: Sizes, without: Collection[str] = ()) -> tuple[Effect, ...]:
    """Every effect that these logs can show, but those in `without`."""
    found = (*_command_side(size), *_flow_side(size), *_before_sensor(size), *_generic(size))
    return tuple(effect for effect in found if effect.name not in without)


def _command_side(size: Sizes) -> tuple[Effect, ...]:
    never = NEVER * size.full
    # Host to firmware over a field bus: 1 to 10 ms; assumption.
    delays = tuple(dict.fromkeys((max(size.delay_s, size.dt), max(0.3 * size.delay_s, 0.5 * size.dt))))
    delay = Parameter("delay_s", "s", 0.0, 0.01, 0.0, MOST_DELAY_S, delays)
    apart = Parameter("difference_s", "s", 0.0, 0.01, -MOST_DELAY_S, MOST_DELAY_S, (-0.005, 0.005))
    # Servo valves 2 to 10 ms (Jelali & Kroll 2003).
    lag = Parameter("time_constant_s", "s", 0.0, 0.005, 0.0, MOST_LAG_S, (0.002, 0.006))
    # Overlap of servo valves is 0 to 3 % of the stroke (Jelali & Kroll 2003), the usual opening a third of that; assumption.
    band = Parameter(
        "half_width", size.unit, 0.0, 0.1 * size.opening, 0.0, size.full, (0.1 * size.opening, 0.5 * size.opening)
    )
    # What a fully open valve passes falls to nothing at the effort of the full supply pressure, as in `orifice_flow`.
    stall = Parameter(
        "stall_nm",
        size.unit,
        LOADED * size.most_effort,
        0.5 * LOADED * size.most_effort,
        1.02 * size.most_effort,
        LOADED * size.most_effort,
    )
    limits = tuple(share * size.full for share in (0.85, 0.65, 0.45, 0.3))
    limit = Parameter("limit", size.unit, never, size.full, 0.02 * size.full, never, limits)
    # A weak integrator beside a proportional force loop, slower than the loop; assumption.
    ki = Parameter("ki", "1/s", 0.0, 0.05 * size.rate, 0.0, size.rate)
    return (
        Effect("command_delay", (delay,)),
        Effect("dead_time_asymmetry", (apart,)),
        Effect("valve_lag", (lag,)),
        Effect("valve_deadband", (band,)),
        Effect("flow_saturation", (limit, stall)),
        Effect("integral_action", (ki,)),
    )


def _flow_side(size: Sizes) -> tuple[Effect, ...]:
    never = LOADED * size.most_effort
    starts = (1.2 * size.most_effort, 2.0 * size.most_effort, 4.0 * size.most_effort)
    effort = Parameter("effort_max_nm", size.unit, never, 0.5 * never, 1.02 * size.most_effort, never, starts)
    # The side of the rod has 1/2 to 1/1.3 of the area of the other, so that the full supply pressure pushes less there.
    areas = Parameter("area_ratio", "1", 1.0, 0.3, 0.4, 2.5, shape=True)
    droop = (Parameter("droop", "1", 0.0, 0.5, 0.0, 3.0, (1.0,)),)
    if not size.supply:
        # A pump that loses a tenth of its pressure at the usual speed; `recovery_s` from a pump's to an accumulator's.
        droop = (
            Parameter("droop", "1", 0.0, 0.1, 0.0, 3.0, (0.1, 0.4)),
            Parameter("recovery_s", "s", 0.1, 0.2, 0.003, 5.0, (0.05, 0.3), shape=True),
        )
        # The side of the rod takes less oil for the same speed: piston areas are 1.3 to 2 times as large on one side.
        droop = (*droop, Parameter("drawn_ratio", "1", 1.0, 0.3, 0.5, 2.0, shape=True))
        if not size.alone:
            # What other joints draw at their usual speeds, over this one's: cylinders differ by a factor of two; assumption.
            droop = (*droop, Parameter("others", "1", 1.0, 0.5, 0.0, 5.0, shape=True))
    # Share of the pressure that the largest load takes, if the drive evens that out: two thirds at most (Merritt 1967, ch. 6).
    droop = (*droop, Parameter("evened_out", "1", 0.0, 0.3, 0.0, 0.9, shape=True))
    return (
        # Piston areas of differential cylinders are 1.3 to 2 times as large on one side: a ratio of 0.13 to 0.33.
        Effect("direction_asymmetry", (Parameter("ratio", "1", 0.0, 0.15, -0.95, 0.95),)),
        Effect("orifice_flow", (effort, areas)),
        Effect("supply_droop", droop),
        # Viscosity halves over 15 to 20 K of oil temperature; a tenth of the flow over some minutes.
        Effect("gain_drift", (Parameter("rate_per_s", "1/s", 0.0, 0.003, -0.2, 0.2),)),
    )


def _before_sensor(size: Sizes) -> tuple[Effect, ...]:
    """What is lost between the drive and a sensor at its output; pressures know nothing of it."""
    if not size.at_output:
        return ()
    # Gears and seals take some percent of the usual torque, or of each newton metre; assumption.
    dry = Parameter("friction_nm", size.unit, 0.0, 0.05 * size.effort, 0.0, size.most_effort)
    return (
        Effect("coulomb_friction", (dry,), common=True),
        Effect("load_dependent_friction", (Parameter("coefficient", "1", 0.0, 0.1, 0.0, 0.95),), common=True),
    )


def _generic(size: Sizes) -> tuple[Effect, ...]:
    def shape(name: str, signal: str, *parameters: Parameter, excludes: frozenset[str] = frozenset()) -> Effect:
        return Effect(name, parameters, named=False, signal=signal, excludes=excludes)

    def share(name: str, spread: float, most: float = 3.0) -> Parameter:
        return Parameter(name, "1", 0.0, spread, -most, most)

    def addition(name: str) -> Parameter:
        return Parameter(name, size.unit, 0.0, 0.1 * size.opening)

    half = 0.5 * size.longest_s
    moment = Parameter("moment_s", "s", half, 0.5 * half, 0.0, 2.0 * half, (0.6 * half, half, 1.4 * half))
    plays = (0.02 * size.opening, 0.1 * size.opening, 0.3 * size.opening)
    play = Parameter("play", size.unit, 0.0, 0.05 * size.opening, 0.0, size.opening, plays)
    return (
        # Below −0.5 the flow would fall as the valve opens.
        shape("flow_curve", "command", Parameter("curve", "1", 0.0, 0.2, -0.3, 3.0)),
        shape("hysteresis", "command", play),
        shape("sudden_change", "time", share("gain_step", 0.1, 0.95), moment, excludes=frozenset({"gain_drift"})),
        shape("offset_drift", "time", addition("drift")),
        shape("linkage", "position", share("geometry_1", 0.1), share("geometry_2", 0.1)),
        shape("position_load", "position", addition("offset_1"), addition("offset_2")),
        shape("speed_by_position", "position", addition("speed_1"), addition("speed_2")),
        shape("speed_law", "velocity", addition("turbulent")),
        *(() if size.at_output else (shape("drag", "direction", addition("drag")),)),
        shape("leak_curve", "effort", share("leak_curve", 0.05)),
    )
