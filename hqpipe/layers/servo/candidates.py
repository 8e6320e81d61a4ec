"""Base parameters and candidate effects of a servo joint: names, units, sizes of a data sheet, bounds.

Left out is what these logs cannot tell from the base; docs/theory/servo.md says which and why.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from hqpipe.identify.model import Effect, Parameter
from hqpipe.layers.servo.scale import Scale
from hqpipe.layers.servo.start import Start
from hqpipe.layers.servo.trial_settings import TrialSettings
from hqpipe.logs.joint_kinds import PRISMATIC, unit_of

POSITION_SHAPE, SPEED_SHAPE = "torque_by_position", "torque_by_speed_squared"
CONSTANT_SHAPE, COUPLING_SHAPE = "constant_torque", "other_joints"
SLOW_SHAPE, DIRECTION_SHAPE, TIME_SHAPE = "slow_share_of_torque", "torque_by_direction", "torque_by_time"
_DELAY = 0.015  # s; assumption: one or two cycles of a 50–100 Hz servo bus, or a dozen of a fieldbus
_LONGEST_DELAY = 0.2  # s; assumption: a drive that answers later than this is refused by no one, but no servo
_FRICTION = 0.1  # of the largest torque; dry friction of geared servo drives is 5–15 % of rated torque (Armstrong 1991)
_STRIBECK = 0.1  # of the largest speed; Stribeck speeds lie at a few per cent of it (Armstrong 1991)
_FALL_SEEN = 0.5  # of the largest speed; a friction that falls over more than that looks like dry friction; assumption
_EFFICIENCY = 0.2  # loss of spur and harmonic gears, 10–30 % by their data sheets
_GAP = np.pi / 180.0  # rad, backlash of spur-gear servos by their data sheets: about a degree
_GAP_SLIDE = 0.005  # of the travel
_GIVE = 0.05  # rad of give per rad of drive stiffness; assumption: a gear is 20 times as stiff as its position loop
_CUT = 0.5  # of the largest torque asked for; assumption: where it lies is not known, and most likely not far below
_SAG = 0.1  # supply resistance over that of the winding; assumption: leads are sized for less than a tenth of the loss
_GAIN = 0.1  # tolerance of motor constants by their data sheets
_BIAS = 0.02  # rad, a spline tooth of a servo horn is 0.25; assumption: a zero is set to within a tenth of it
_MOST_BIAS = 0.1  # rad; assumption: a larger one is seen at a glance, and a fit that asks for it means another law
_MOUNTING = 0.25  # rad, a spline tooth
_MOST_RATIO = 20.0  # between gains or loads of two trials; assumption
_DRIFT = 0.003  # 1/s; copper gains 0.4 % resistance per kelvin, a small motor heats by about a kelvin a second
_TOLERANCE = 0.02  # of a stated load or gain; assumption: scales, rulers and rounded gains are off by a per cent or two
_OUTSIDE = 0.05  # what is off by more is an effect, and not the tolerance of what was stated; assumption
WITHIN = 0.8
"""Of the bounds of a tolerance, within which it counts. At its end it must have no slope, or an effect in the same direction
would seem to be what the tolerance can do already."""
_SHARE = 0.1  # of the largest torque, that a generic shape may come to; assumption: as dry friction


@dataclass(frozen=True)
class Size:
    """How large things are in the fit trials: 99 % quantile of the drive torque and of the speed, travel, sample time, length
    of a window, gain with which the fit starts, known inertia, stated drag."""

    torque: float
    speed: float
    travel: float
    dt: float
    window_s: float
    gain: float
    inertia: float
    drag: float


def base_of(scale: Scale, start: Start, size: Size, settings: TrialSettings) -> tuple[Parameter, ...]:
    """Base parameters in the order inertia, gain, drag, gravity, offset, timing, settings, as far as they are free.

    What is stated may be off by its tolerance. Gravity is not larger than the largest drive torque, or the drive could not hold
    the joint. A command counts up to a sample before the row in which it was logged; later is a delay. A logged duty was set
    up to a sample before it was read, or holds for one after. Gains and loads that differ between trials are ratios to those of
    the setting of most samples. A constant torque is a number of the base where no effect stands for it, see `biased`.
    """
    torque = size.torque
    found = []
    if scale.load:
        found.append(_tolerance("inertia", scale.inertia_unit, size.inertia))
    else:
        found.append(Parameter("inertia", scale.inertia_unit, start.inertia, np.inf, start.least_inertia))
    if scale.free_gain:
        per = "V" if scale.duty else scale.angle
        found.append(Parameter("gain", f"{scale.torque}/{per}", start.gain, np.inf, 1e-3 * start.gain))
    elif scale.load:
        found.append(_tolerance("gain_tolerance", "1", 1.0))
    if scale.free_drag:
        found.append(Parameter("drag", scale.drag_unit, start.drag, np.inf, 0.0))
    else:
        found.append(_tolerance("drag_tolerance", "1", 1.0))
    if not scale.load and scale.kind != PRISMATIC:
        found.append(Parameter("gravity_sin", scale.torque, start.gravity_sin, torque, -np.inf, np.inf))
        found.append(Parameter("gravity_cos", scale.torque, start.gravity_cos, torque, -np.inf, np.inf))
    elif scale.kind != PRISMATIC:
        found.append(Parameter("mounting_rad", "rad", 0.0, _BIAS, -_MOUNTING, _MOUNTING))
    if not biased(scale):
        found.append(Parameter("offset", scale.torque, start.offset, torque))
    if not scale.duty:
        beyond = 0.25 * size.dt  # without a slope, as of tolerances
        lead = Parameter("command_lead_s", "s", 0.5 * size.dt, 0.5 * size.dt, -beyond, size.dt + beyond)
        found.append(lead)
    if scale.duty:
        found.append(Parameter("duty_delay_s", "s", 0.5 * size.dt, 0.5 * size.dt, -size.dt, size.dt))
    for k in settings.fitted:
        low, high = 1.0 / _MOST_RATIO, _MOST_RATIO
        if settings.gains:
            found.append(Parameter(f"gain_ratio_{k}", "1", float(settings.gain[k]), np.inf, low, high))
        if settings.loads:
            found.append(Parameter(f"inertia_ratio_{k}", "1", float(settings.load[k]), np.inf, low, high))
        if settings.loads and scale.kind != PRISMATIC:
            found.append(Parameter(f"gravity_ratio_{k}", "1", float(settings.load[k]), np.inf, low, high))
    return tuple(found)


def biased(scale: Scale) -> bool:
    """Whether a constant torque is read as a bias of the position: a position loop is closed, and no weight is constant."""
    return not scale.duty and scale.kind != PRISMATIC


def _tolerance(name: str, unit: str, size: float) -> Parameter:
    """Of what was stated: how far it is off; what is beyond `_OUTSIDE` does nothing, see `WITHIN`."""
    most = _OUTSIDE * size / WITHIN
    return Parameter(name, unit, 0.0, _TOLERANCE * size, -most, most)


def effects_of(scale: Scale, size: Size, gains_differ: bool, without: Collection[str]) -> tuple[Effect, ...]:
    """Candidates that these logs can tell from the base, without those that are left out by name."""
    found = [*_command(scale, size), *_friction(scale, size), *_transmission(scale, size), *_drive(scale)]
    found += _shapes(scale, size)
    if biased(scale) and gains_differ:  # at one gain a constant torque is a bias
        torque = Parameter("torque", scale.torque, 0.0, _SHARE * size.torque, -size.torque, size.torque)
        found.append(Effect(CONSTANT_SHAPE, (torque,), named=False, signal="direction"))
    return tuple(effect for effect in found if effect.name not in without)


def other_joints() -> Effect:
    """The torque from other joints, as it was fitted beside the base; what it is beside other effects is its share."""
    share = Parameter("share", "1", 0.0, 1.0, 0.0, 3.0, (1.0,))
    return Effect(COUPLING_SHAPE, (share,), named=False, signal="other_joints", context=True)


def _command(scale: Scale, size: Size) -> list[Effect]:
    if scale.duty:  # the duty is logged behind the position loop: a late command is in it already
        return []
    spread = max(_DELAY, size.dt)
    longest = max(min(_LONGEST_DELAY, 0.5 * size.window_s), 2.0 * spread)
    # Drag and inertia take most of a delay, whose own part is told from the slope of a short one alone.
    starts = tuple(min(0.5 * size.dt + share * spread, 0.9 * longest) for share in (0.2, 0.5, 3.0))
    delay = Parameter("delay_s", "s", 0.0, spread, 0.0, longest, starts)
    return [Effect("command_delay", (delay,))]


def _friction(scale: Scale, size: Size) -> list[Effect]:
    dry, speed = _FRICTION * size.torque, _STRIBECK * size.speed
    rate = unit_of("rad/s", scale.kind)
    coulomb = Parameter("friction_nm", scale.torque, 0.0, dry, 0.0, size.torque)
    static = Parameter("static_nm", scale.torque, 0.0, dry, 0.0, size.torque, (0.5 * dry, dry))
    turn = Parameter(
        "velocity_rad_s", rate, speed, speed, 0.05 * speed, _FALL_SEEN * size.speed, (speed, 3.0 * speed), shape=True
    )
    share = Parameter("coefficient", "1", 0.0, _EFFICIENCY, 0.0, 0.95)
    found = [
        Effect("coulomb_friction", (coulomb,), common=True),
        Effect("stribeck_friction", (static, turn)),
        Effect("load_dependent_friction", (share,)),
    ]
    if not scale.free_drag:
        # A start within the tolerance of the stated drag, which it takes the place of, would be less drag than that.
        start = max(dry / size.speed, 2.0 * _OUTSIDE * size.drag)
        viscous = Parameter("nm_s_per_rad", scale.drag_unit, 0.0, dry / size.speed, 0.0, np.inf, (start,))
        found.append(Effect("viscous_friction", (viscous,), common=True))
    if scale.load:
        armature = Parameter("kg_m2", scale.inertia_unit, 0.0, 0.5 * size.inertia, 0.0)
        found.append(Effect("armature", (armature,)))
    return found


def _transmission(scale: Scale, size: Size) -> list[Effect]:
    slide = scale.kind == PRISMATIC
    spread = _GAP_SLIDE * size.travel if slide else _GAP
    gap = Parameter(
        "gap", scale.angle, 0.0, spread, 0.0, 0.25 * size.travel, (0.5 * spread, 2.0 * spread, 6.0 * spread)
    )
    found = [Effect("backlash", (gap,))]
    if not scale.duty:  # behind a logged duty a spring is a lag of the torque, as is the winding
        soft = Parameter("compliance", f"{scale.angle}/({scale.torque})", 0.0, _GIVE / size.gain, 0.0, 1.0 / size.gain)
        found.append(Effect("transmission_compliance", (soft,)))
    if biased(scale):
        found.append(Effect("position_bias", (Parameter("rad", scale.angle, 0.0, _BIAS, -_MOST_BIAS, _MOST_BIAS),)))
    return found


def _drive(scale: Scale) -> list[Effect]:
    cut = Parameter("share_cut_off", "1", 0.0, _CUT, 0.0, 0.99, (0.2, 0.4, 0.6, 0.8, 0.95))
    limit = [cut]
    if not scale.duty:
        limit.append(Parameter("back_emf_share", "1", 0.0, 1.0, 0.0, 1.0, (0.0, 1.0), shape=True))
    found = [Effect("torque_limit", tuple(limit))]
    if scale.may_sag:
        ohm = scale.winding_ohm
        unit = "Ω" if ohm else "1"  # over the resistance of the winding, where that is not stated
        sag = Parameter("ohm", unit, 0.0, _SAG * (ohm or 1.0), 0.0, 10.0 * (ohm or 1.0))
        found.append(Effect("voltage_sag", (sag,)))
    if not scale.duty and not scale.free_gain and (scale.load or not scale.free_drag):
        # With an unknown load a lower gain is the same as more drag, and larger inertia, gravity and friction.
        same = frozenset() if scale.load else frozenset({"viscous_friction"})
        found.append(Effect("gain_error", (Parameter("ratio", "1", 0.0, _GAIN, -0.95, 5.0),), excludes=same))
    return found


def _shapes(scale: Scale, size: Size) -> list[Effect]:
    """Smooth terms that no effect describes."""
    torque = _SHARE * size.torque
    wide = size.torque
    position = tuple(Parameter(f"degree_{i}", scale.torque, 0.0, torque, -wide, wide) for i in (1, 2))
    square = Parameter("coefficient", scale.torque, 0.0, torque, -wide, wide)
    share = Parameter("share", "1", 0.0, _SHARE, -0.9, 0.9)
    signal = "duty" if scale.duty else "position_command"
    found = [
        Effect(POSITION_SHAPE, position, named=False, signal="position"),
        Effect(SPEED_SHAPE, (square,), named=False, signal="velocity"),
        Effect(SLOW_SHAPE, (share,), named=False, signal=signal),
        Effect(DIRECTION_SHAPE, (Parameter("ratio", "1", 0.0, _GAIN, -0.95, 0.95),), named=False, signal="direction"),
        Effect(TIME_SHAPE, (Parameter("rate_per_s", "1/s", 0.0, _DRIFT, -0.2, 0.2),), named=False, signal="time"),
    ]
    return found
