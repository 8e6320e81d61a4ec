"""Base parameters and effects of a valve-controlled joint, with what a data sheet would say of their size."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.identify.model import Effect, Parameter

NEVER = 1.2
"""Of the command's largest distance from rest: a valve that is fully open only there never is."""
MOST_DELAY_S, MOST_LAG_S = 0.5, 0.5
"""assumption: pilot-operated valves of mobile machines take 0.05 to 0.2 s in all (Jelali & Kroll 2003, ch. 4)."""
BEYOND = 0.25  # of a sample, by which the offset of a row may lie beyond either convention; assumption
FAST = 5.0  # of the usual speed: a speed limit that is never reached
LOADED = 20.0  # of the usual effort: an effort at which the flow would stop, so large that nobody notices
CREEP = 0.02  # of the usual speed; assumption: what seals and lands let a loaded joint sink
PILOTED = 0.8
"""Share of the pull of a load that a counterbalance valve takes away from the motion: R/(R + B/A) for a pilot ratio R of 3, a
common one, and areas A, B of the cylinder (M. Ashmore, "Demystifying pilot ratios in overcenter valves", Fluid Power
Journal)."""
UNEQUAL = 2.0  # ratio of piston areas; those of differential cylinders are 1.3 to 2 (Jelali & Kroll 2003)


@dataclass(frozen=True)
class Sizes:
    """Sizes in the fit trials that bounds and priors are multiples of.

    Attributes:
        dt: s. command: largest distance from rest. gain, neutral: of a straight line through the logs.
        speed: usual where the joint moves. effort: usual, 0 where it is not logged; most_effort: largest. effort_unit: of it.
        demand: usual total speed of the joints. supply: whether its pressure is logged. alone: whether no other joint is.
        kinds: whether there are joints of both kinds, which turn and slide.
        edge: command from rest at which the joint seems to start; full: from neutral, beyond which it moves no faster.
        delay_s: for which the command precedes the motion most.
        creeps: whether the joint is seen to creep at rest, within the deadband.
        slower: direction of motion that flattens off at large commands, +1 or −1; 0 where the other one was not driven as far.
        longest_s: of the trials. speed_unit: of the joint.
    """

    dt: float
    command: float
    gain: float
    neutral: float
    speed: float
    effort: float
    most_effort: float
    effort_unit: str
    demand: float
    supply: bool
    alone: bool
    kinds: bool
    edge: float
    full: float
    delay_s: float
    creeps: bool
    slower: int
    longest_s: float
    speed_unit: str


def base_parameters(size: Sizes) -> tuple[Parameter, ...]:
    """Gain, neutral point, and the row that the command belongs to.

    A log does not say whether a row holds the command sent before or after its measurement: up to one sample of offset is the
    log's, not the machine's. The bounds lie a quarter of a sample beyond, so that neither convention is on a bound.
    """
    return (
        Parameter("gain", f"{size.speed_unit} per command", size.gain, np.inf),
        Parameter("neutral", "command", size.neutral, np.inf),
        Parameter("row_offset_s", "s", 0.5 * size.dt, 0.5 * size.dt, -BEYOND * size.dt, (1.0 + BEYOND) * size.dt),
    )


def offset_before(offset: Parameter, first_s: float, dt: float) -> Parameter:
    """The row that the command belongs to, which is the same for all joints of a log: none of them moves before it.

    Args:
        first_s: for which the command precedes the motion of the joint that answers first.
    """
    high = float(np.clip(first_s + BEYOND * dt, offset.low + BEYOND * dt, offset.high))
    return replace(offset, neutral=min(offset.neutral, high), high=high)


def effects(size: Sizes, without: Collection[str] = ()) -> tuple[Effect, ...]:
    """Every effect that these logs can show, but those in `without`."""
    found = (*_command_side(size), *_flow_side(size), *_generic(size))
    return tuple(effect for effect in found if effect.name not in without)


def _command_side(size: Sizes) -> tuple[Effect, ...]:
    command = size.command
    never = NEVER * command
    # Overlap of 3 to 20 % of the stroke is usual for proportional valves, 0 to 3 % for servo valves (Jelali & Kroll 2003).
    deadband = Parameter("half_width", "command", 0.0, 0.05 * command, 0.0, command, (0.05 * command, size.edge))
    # Of the speed at the full command; a driver that compensates the overlap, or lands without notches; assumption of the size.
    jump = Parameter("jump", "1", 0.0, 0.2, 0.0, 1.0, (0.1, 0.5))
    delays = tuple(dict.fromkeys((max(size.delay_s, size.dt), 0.3 * max(size.delay_s, size.dt))))
    # Each solenoid of a pilot-operated valve fills a chamber of its own: apart by no more than the whole takes.
    apart = Parameter(
        "difference_s", "s", 0.0, 0.02, -MOST_DELAY_S, MOST_DELAY_S, (-max(0.02, size.dt), max(0.02, size.dt))
    )
    lag = Parameter("time_constant_s", "s", 0.0, 0.02, 0.0, MOST_LAG_S, (0.01, 0.05))
    # Lands lie behind the spool; the dead zone and limit of a driver or pilot before it, and hoses and load behind all.
    behind = Parameter("behind_edges", "1", 0.0, 0.5, 0.0, 1.0, (0.0, 1.0), shape=True)
    limits = (size.full, 0.9 * command, 0.7 * command, 0.4 * command)
    return (
        Effect("valve_deadband", (deadband,)),
        Effect("opening_jump", (jump,)),
        Effect("command_delay", (Parameter("delay_s", "s", 0.0, 0.02, 0.0, MOST_DELAY_S, delays),)),
        Effect("dead_time_asymmetry", (apart,)),
        # Servo valves 2 to 10 ms, proportional ones 10 to 50 ms (Jelali & Kroll 2003).
        Effect("valve_lag", (lag, behind)),
        Effect("flow_saturation", (Parameter("limit", "command", never, command, 0.02 * command, never, limits),)),
    )


def _flow_side(size: Sizes) -> tuple[Effect, ...]:
    # Piston areas of differential cylinders are 1.3 to 2 times as large on one side: a ratio of 0.13 to 0.33.
    found = [
        Effect("direction_asymmetry", (Parameter("ratio", "1", 0.0, 0.15, -0.95, 0.95),)),
        # Viscosity halves over 15 to 20 K of oil temperature; a tenth of the flow over some minutes.
        Effect("gain_drift", (Parameter("rate_per_s", "1/s", 0.0, 0.003, -0.2, 0.2),)),
    ]
    if size.effort > 0.0:
        found += _load_effects(size)
    if size.creeps:
        found.append(Effect("leakage", _leak(size)))
    if size.slower:
        found.append(Effect("one_way_speed_limit", (_limit(size, "speed_limit", size.slower),)))
    if size.supply:
        found.append(Effect("supply_droop", (Parameter("droop", "1", 0.0, 0.5, 0.0, 3.0, (1.0,)),)))
    elif size.demand > 0.0:
        # A pump that loses a tenth of its pressure at the usual demand.
        droop = Parameter("droop", f"1/({size.speed_unit})", 0.0, 0.1 / size.demand, 0.0, 3.0 / size.demand)
        recovery = Parameter("recovery_s", "s", 0.1, 0.2, 0.003, 5.0, (0.05, 0.5), shape=True)
        # The side of the rod takes less oil for the same speed.
        drawn = Parameter("drawn_ratio", "1", 1.0, 0.3, 1.0 / UNEQUAL, UNEQUAL, shape=True)
        # What a joint draws at a speed of another unit is unknown, and it may have a pump of its own.
        kinds = (Parameter("other_kinds", "1", 1.0, 0.5, 0.0, 3.0, shape=True),) if size.kinds else ()
        found.append(Effect("supply_droop", (droop, recovery, drawn, *kinds)))
    return tuple(found)


def _load_effects(size: Sizes) -> list[Effect]:
    """What a logged load does to the flow."""
    name = "pressure_max_pa" if size.effort_unit == "Pa" else "effort_max_nm"
    never = LOADED * size.most_effort
    starts = (1.5 * size.most_effort, 4.0 * size.most_effort)
    limit = Parameter(name, size.effort_unit, never, 0.5 * never, 1.02 * size.most_effort, never, starts)
    areas = Parameter("area_ratio", "1", 1.0, 0.3, 1.0 / UNEQUAL, UNEQUAL, (0.75, 1.3), shape=True)
    relief = Parameter("load_relief", "1", 0.0, PILOTED, 0.0, 1.5, (PILOTED,), shape=True)
    return [Effect("orifice_flow", (limit, areas)), Effect("counterbalance", (relief,))]


def _leak(size: Sizes) -> tuple[Parameter, ...]:
    """Speed that a closed valve lets through: in proportion to the load where that is logged."""
    leak = CREEP * size.speed
    if size.effort > 0.0:
        unit = f"{size.speed_unit} per {size.effort_unit}"
        return (Parameter("speed_per_effort", unit, 0.0, leak / size.effort, 0.0),)
    return (Parameter("creep_speed", size.speed_unit, 0.0, leak),)


def _limit(size: Sizes, name: str, sign: int) -> Parameter:
    """A speed that one direction does not exceed; negative for the negative direction."""
    never, starts = FAST * size.speed, (1.2 * size.speed, 0.7 * size.speed)
    ends = sorted((sign * 0.02 * size.speed, sign * never))
    return Parameter(name, size.speed_unit, sign * never, size.speed, *ends, tuple(sign * start for start in starts))


def _generic(size: Sizes) -> tuple[Effect, ...]:
    def shape(name: str, signal: str, *parameters: Parameter, excludes: frozenset[str] = frozenset()) -> Effect:
        return Effect(name, parameters, named=False, signal=signal, excludes=excludes)

    def share(name: str, spread: float, most: float = 3.0, starts: tuple[float, ...] = ()) -> Parameter:
        return Parameter(name, "1", 0.0, spread, -most, most, starts)

    creep, half = CREEP * size.speed, 0.5 * size.longest_s
    step = share("gain_step", 0.1, 0.95)
    moment = Parameter("moment_s", "s", half, 0.5 * half, 0.0, 2.0 * half, (0.6 * half, half, 1.4 * half))
    by_position = Parameter("creep_position", size.speed_unit, 0.0, creep)
    found = [
        # Below −0.5 the flow would fall as the valve opens.
        shape("flow_curve", "command", Parameter("curve", "1", 0.0, 0.2, -0.5, 3.0)),
        # Proportional valves without a position loop for the spool: 3 to 8 % (Jelali & Kroll 2003).
        shape("hysteresis", "command", Parameter("play", "command", 0.0, 0.02 * size.command, 0.0, 0.3 * size.command)),
        shape("sudden_change", "time", step, moment, excludes=frozenset({"gain_drift"})),
        shape("linkage", "position", share("geometry_1", 0.1), share("geometry_2", 0.1)),
        shape("position_load", "position", share("load_sin", 0.1), share("load_cos", 0.1)),
        shape(
            "oscillation",
            "velocity",
            Parameter("period_s", "s", 0.0, 0.02, 0.0, 2.0, (max(0.02, 2.0 * size.dt), 0.2)),
            Parameter("damping_ratio", "1", 0.4, 0.3, 0.05, 1.0),
        ),
    ]
    if size.creeps and size.effort == 0.0:
        found.append(shape("creep_by_position", "position", by_position))
    else:
        found.append(shape("creep", "position", Parameter("creep_speed", size.speed_unit, 0.0, creep), by_position))
    if size.effort > 0.0 and not size.creeps:
        found.append(shape("creep_under_load", "effort", *_leak(size)))
    forwards, backwards = "speed_limit_forwards", "speed_limit_backwards"  # both together are flow_saturation
    for name, parameter, side, other in (
        (forwards, "upper_speed", 1, backwards),
        (backwards, "lower_speed", -1, forwards),
    ):
        if side != size.slower:
            limit = _limit(size, parameter, 1)
            found.append(shape(name, "direction", limit, excludes=frozenset({other, "one_way_speed_limit"})))
    if not size.alone:
        found.append(shape("shared_flow", "other joints", share("others", 0.1, 1.0)))
    return tuple(found)
