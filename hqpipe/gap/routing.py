"""Which layers of the gap the logs of a machine can be asked about.

A layer compares an output with what its model makes of the inputs. Which one suits depends on what was logged, and on where the
torque comes from: what the drive itself gives (a current, an estimate) drives the motion of the joint and can be compared with
it; a load cell or the pressures in a cylinder measure what a drive makes of its command.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from hqpipe.errors import IdentificationError
from hqpipe.logs.columns import COMMAND_CHANNEL, joint_column
from hqpipe.logs.trajectory import LogSet

ACTUATOR, SERVO, JOINT_MOTION, VALVE, TORQUE = "actuator", "servo", "joint_motion", "valve", "torque"
GIVEN_BY_THE_DRIVE = ("current", "estimate")
"""Sources of a torque that moves the joint against its friction, so that it can be compared with the motion."""
FREE_BODY = ("base/", "foot/")  # columns of a machine that stands or walks: torques of its joints also carry its body


@dataclass(frozen=True)
class Route:
    """What is asked of a log set.

    Attributes:
        actuator: whether the law from command to torque is, the four coefficients of a hydraulic drive or a force loop.
        layers: of `hqpipe.layers`; the first that has what it needs answers, beside the law only where that does not hold.
    """

    actuator: bool
    layers: tuple[str, ...] = ()


def route(log_set: LogSet) -> Route:
    """The layers for a log set.

    Raises:
        IdentificationError: there is none.
    """
    mode, channels = log_set.control_mode, _channels(log_set)
    commanded = mode is not None and COMMAND_CHANNEL[mode] in channels
    if mode == "valve" and commanded:
        return Route(False, (VALVE,))
    moved = (JOINT_MOTION,) if not stands_free(log_set) else ()
    if "effort" in channels and commanded:
        fixed = mode == "position" or all((trial.base or log_set.base) == "fixed" for trial in log_set.trials)
        source = log_set.effort_source
        if moved and fixed and source in GIVEN_BY_THE_DRIVE:
            # An electric drive, whose firmware makes the torque: there is no hydraulic law to ask for.
            return Route(False, moved)
        if mode == "torque":
            return Route(False, (TORQUE,))
        return Route(True, moved if fixed and source is None else ())
    layers = moved if {"effort", "current"} & set(channels) else ()
    if "effort" not in channels and ("position_command" in channels or _has_drive(log_set, channels)):
        layers = (*layers, SERVO)
    if layers:
        return Route(False, layers)
    if "effort" in channels:  # a body that moves freely, without a command: the intake says what is missing
        return Route(True)
    raise IdentificationError(
        f"{log_set.path}: no layer can be evaluated: neither {joint_column('<name>', 'effort')} nor a command is logged",
        file=log_set.path,
        field=joint_column("<name>", "effort"),
        fix="record the joint torque, the motor current, or the command of the joints",
    )


def has_law(log_set: LogSet) -> bool:
    """Whether a command and the torque that comes of it are logged."""
    channels = _channels(log_set)
    mode = log_set.control_mode
    return "effort" in channels and mode is not None and COMMAND_CHANNEL[mode] in channels


def route_since(log_set: LogSet) -> Route:
    """The layers where the question is what changed since earlier logs.

    A closed force loop makes much the same of its command whatever its valve and its load have become, so that the motion is
    asked instead.
    """
    chosen = route(log_set)
    if has_law(log_set) and log_set.control_mode == "torque" and not stands_free(log_set):
        return Route(False, (JOINT_MOTION,))
    return chosen


def stands_free(log_set: LogSet) -> bool:
    """Whether the base moves, as far as the logs say: then a joint does not move by its own torque alone."""
    if any((trial.base or log_set.base) == "floating" for trial in log_set.trials):
        return True
    return any(name.startswith(FREE_BODY) for trial in log_set.trials for name in trial.trajectory.extra)


def _channels(log_set: LogSet) -> Collection[str]:
    """Channels that every trial has."""
    each = [trial.trajectory.channels() for trial in log_set.trials]
    return {name for name in each[0] if all(name in channels for channels in each)}


def _has_drive(log_set: LogSet, channels: Collection[str]) -> bool:
    """Whether the duty of the drive and its supply are logged."""
    return "duty" in channels and all("supply/voltage" in trial.trajectory.extra for trial in log_set.trials)
