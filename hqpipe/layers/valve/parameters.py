"""Base parameters and effects of a valve-controlled joint, with what a data sheet would say of their size."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from hqpipe.identify.model import Effect, Parameter

NEVER = 2.0
"""Of the command's largest distance from rest: a valve that is fully open only there never is."""
MOST_DELAY_S, MOST_LAG_S = 0.5, 0.5
"""assumption: pilot-operated valves of mobile machines take 0.05 to 0.2 s in all (Jelali & Kroll 2003, ch. 4)."""
FAST = 5.0  # of the usual speed: a speed limit that is never reached
LOADED = 20.0  # of the usual effort: an effort at which the flow would stop, so large that nobody notices


@dataclass(frozen=True)
class Sizes:
    """Sizes in the fit trials that bounds and priors are multiples of.

    Attributes:
        dt: s. command: largest distance from rest. gain, neutral: of a straight line through the logs.
        speed: usual where the joint moves. effort: usual, 0 where it is not logged; most_effort: largest. effort_unit: of it.
        demand: usual total speed of the joints. supply: whether its pressure is logged. alone: whether no other joint is.
        edge: command from rest at which the joint seems to start. delay_s: for which the command precedes the motion most.
        speed_unit: of the joint.
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
    edge: float
    delay_s: float
    speed_unit: str


def base_parameters(size: Sizes) -> tuple[Parameter, ...]:
    """Gain, neutral point, and the row that the command belongs to.

    A log does not say whether a row holds the command sent before or after its measurement: up to one sample of offset is the
    log's, not the machine's. The bounds lie a quarter of a sample beyond, so that neither convention is on a bound.
    """
    return (
        Parameter("gain", f"{size.speed_unit} per command", size.gain, np.inf),
        Parameter("neutral", "command", size.neutral, np.inf),
        Parameter("row_offset_s", "s", 0.5 * size.dt, 0.5 * size.dt, -0.25 * size.dt, 1.25 * size.dt),
    )


def effects(size: Sizes, without: Collection[str] = ()) -> tuple[Effect, ...]:
    """Every effect that these logs can show, but those in `without`."""
    found = (*_command_side(size), *_flow_side(size), *_generic(size))
    return tuple(effect for effect in found if effect.name not in without)


def _command_side(size: Sizes) -> tuple[Effect, ...]:
    command = size.command
    never = NEVER * command
    # Overlap of 3 to 20 % of the stroke is usual for proportional valves, 0 to 3 % for servo valves (Jelali & Kroll 2003).
    deadband = Parameter("half_width", "command", 0.0, 0.05 * command, 0.0, command, (0.05 * command, size.edge))
    delays = tuple(dict.fromkeys((max(size.delay_s, size.dt), 0.3 * max(size.delay_s, size.dt))))
    limits = (0.9 * command, 0.7 * command, 0.4 * command)
    return (
        Effect("valve_deadband", (deadband,)),
        Effect("command_delay", (Parameter("delay_s", "s", 0.0, 0.02, 0.0, MOST_DELAY_S, delays),)),
        # Servo valves 2 to 10 ms, proportional ones 10 to 50 ms (Jelali & Kroll 2003).
        Effect("valve_lag", (Parameter("time_constant_s", "s", 0.0, 0.02, 0.0, MOST_LAG_S, (0.01, 0.05)),)),
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
        name = "pressure_max_pa" if size.effort_unit == "Pa" else "effort_max_nm"
        never = LOADED * size.most_effort
        starts = (1.5 * size.most_effort, 4.0 * size.most_effort)
        low = 1.02 * size.most_effort
        limit = Parameter(name, size.effort_unit, never, 0.5 * never, low, never, starts)
        found.append(Effect("orifice_flow", (limit,)))
    if size.supply:
        found.append(Effect("supply_droop", (Parameter("droop", "1", 0.0, 0.5, 0.0, 3.0, (1.0,)),)))
    elif size.demand > 0.0:
        # A pump that loses a tenth of its pressure at the usual demand.
        droop = Parameter("droop", f"1/({size.speed_unit})", 0.0, 0.1 / size.demand, 0.0, 3.0 / size.demand)
        recovery = Parameter("recovery_s", "s", 0.1, 0.2, 0.003, 5.0, (0.05, 0.5))
        found.append(Effect("supply_droop", (droop, recovery)))
    return tuple(found)


def _generic(size: Sizes) -> tuple[Effect, ...]:
    def shape(name: str, signal: str, *parameters: Parameter, excludes: frozenset[str] = frozenset()) -> Effect:
        return Effect(name, parameters, named=False, signal=signal, excludes=excludes)

    def one_way(name: str, parameter: str, other: str) -> Effect:
        """A speed limit of one direction, as a counterbalance valve sets it; both together are flow_saturation."""
        limit = Parameter(parameter, speed, never, size.speed, **limits)
        return shape(name, "direction", limit, excludes=frozenset({other}))

    def share(name: str, spread: float, most: float = 3.0, starts: tuple[float, ...] = ()) -> Parameter:
        return Parameter(name, "1", 0.0, spread, -most, most, starts)

    speed, leak = size.speed_unit, 0.02 * size.speed
    never = FAST * size.speed
    limits = {"low": 0.02 * size.speed, "high": never, "starts": (1.2 * size.speed, 0.7 * size.speed)}
    found = [
        # Below −0.5 the flow would fall as the valve opens.
        shape("flow_curve", "command", Parameter("curve", "1", 0.0, 0.2, -0.5, 3.0)),
        shape("linkage", "position", share("geometry_1", 0.1), share("geometry_2", 0.1)),
        shape("position_load", "position", share("load_sin", 0.1), share("load_cos", 0.1)),
        shape("dead_time_by_direction", "direction", Parameter("direction_delay_s", "s", 0.0, 0.01, -0.2, 0.2)),
        one_way("lowering_speed", "lower_speed", "lifting_speed"),
        one_way("lifting_speed", "upper_speed", "lowering_speed"),
        shape(
            "leakage",
            "position",
            Parameter("leak", speed, 0.0, leak),
            Parameter("leak_position", speed, 0.0, leak),
        ),
        shape(
            "oscillation",
            "velocity",
            Parameter("period_s", "s", 0.0, 0.02, 0.0, 2.0, (max(0.02, 2.0 * size.dt), 0.2)),
            Parameter("damping_ratio", "1", 0.4, 0.3, 0.05, 1.0),
        ),
    ]
    if size.effort > 0.0:
        slope = Parameter("leak_effort", f"{speed} per {size.effort_unit}", 0.0, leak / size.effort)
        found.append(shape("leakage_under_load", "effort", slope))
    if not size.alone:
        found.append(shape("shared_flow", "other joints", share("others", 0.1, 1.0)))
    return tuple(found)
