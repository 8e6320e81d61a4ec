"""Which layers of the gap `hqpipe diagnose` can evaluate with the channels of a log set.

This says what `hqpipe.gap.intake` asks for; a test holds the two against each other.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from hqpipe.logs.columns import joint_column

COMMAND_OF = {"position": "position_command", "torque": "effort_command", "valve": "valve_command"}
_NEEDS = {
    "position": ("position_command", "effort"),
    "torque": ("effort_command", "effort"),
    "valve": ("valve_command",),
}
_FUTURE = ("rigid_body", "contact")
_FREE_BODY = ("base/", "foot/")  # columns of a machine whose base moves, where nothing else is said of it
_GIVEN_BY_THE_DRIVE = ("current", "estimate")
_ROW = "effort_source: current or estimate in logset.yaml"


@dataclass(frozen=True)
class Layer:
    """One layer and whether it can be evaluated.

    Attributes:
        layer: "actuator", "servo", "joint_motion", "sensing", "rigid_body" or "contact".
        mode: control mode of an actuator layer, else None.
        possible: whether the channels are there. evaluated: whether `hqpipe diagnose` takes it with the set as it is.
        missing: columns that it lacks. note: what else there is to know.
    """

    layer: str
    mode: str | None
    possible: bool
    evaluated: bool
    missing: tuple[str, ...] = ()
    note: str = ""


def layers(
    channels: Collection[str],
    mode: str | None,
    differentiated: bool = False,
    *,
    extra: Collection[str] = (),
    base: str | None = None,
    effort_source: str | None = None,
) -> list[Layer]:
    """Judge what can be diagnosed.

    Args:
        channels: recorded in every trial. mode: control mode, as stated or inferred. differentiated: velocity is not recorded.
        extra: other columns that every trial has. base: "fixed", "floating" or None. effort_source: as in logset.yaml.
    """
    motion = _joint_motion(channels, mode, extra, base, effort_source)
    electric = motion.evaluated and effort_source in _GIVEN_BY_THE_DRIVE
    found = []
    for name, needs in _NEEDS.items():
        missing = _columns(needs, channels)
        note = f"with control_mode: {name} in logset.yaml, in place of {mode}" if mode and mode != name else ""
        if electric and mode == name:
            note = "the torque is what an electric drive gives: joint_motion takes its place"
        asked = mode == name and not missing and not electric
        found.append(Layer("actuator", name, not missing, asked, missing, "" if missing else note))
    found += [_servo(channels, mode, extra), motion]
    lacking = () if mode == "valve" else _columns(("effort",), channels)
    found.append(Layer("sensing", None, not lacking, not lacking, lacking, _comparisons(channels, differentiated)))
    return found + [Layer(name, None, False, False, (), "hqpipe diagnose does not evaluate it") for name in _FUTURE]


def _servo(channels: Collection[str], mode: str | None, extra: Collection[str]) -> Layer:
    """Position against command, where no torque is there to be compared."""
    driven = "duty" in channels and "supply/voltage" in extra
    missing = () if driven else _columns(("position_command",), channels)
    torque = [name for name in ("effort", "current") if name in channels]
    if mode == "valve":
        return Layer("servo", None, not missing, False, missing, "not in valve mode" if not missing else "")
    note = f"not needed where {joint_column('<name>', torque[0])} is recorded" if torque and not missing else ""
    return Layer("servo", None, not missing, not missing and not torque, missing, note)


def _joint_motion(
    channels: Collection[str], mode: str | None, extra: Collection[str], base: str | None, source: str | None
) -> Layer:
    """Torque or current against motion, where the joint moves by it alone."""
    missing = () if "current" in channels else _columns(("effort",), channels)
    if base == "floating" or (base is None and any(name.startswith(_FREE_BODY) for name in extra)):
        return Layer("joint_motion", None, False, False, missing, "not for a machine whose base moves")
    commanded = mode is not None and COMMAND_OF[mode] in channels
    if missing or mode == "valve":
        return Layer("joint_motion", None, not missing, False, missing, "not in valve mode" if not missing else "")
    if "effort" not in channels or not commanded:
        return Layer("joint_motion", None, True, True)
    if mode == "torque":
        asked = base == "fixed" and source in _GIVEN_BY_THE_DRIVE
        return Layer("joint_motion", None, True, asked, (), "" if asked else f"with base: fixed and {_ROW}")
    if source is None:
        return Layer("joint_motion", None, True, True, (), "where the law from command to torque predicts nothing")
    asked = source in _GIVEN_BY_THE_DRIVE
    return Layer("joint_motion", None, True, asked, (), "" if asked else f"with {_ROW}")


def _comparisons(channels: Collection[str], differentiated: bool) -> str:
    """What the sensing layer can compare."""
    pairs = []
    if "velocity" in channels and not differentiated:
        pairs.append("velocity against position")
    if "effort" in channels:
        pairs.append("torque against motion")
        lacking = _columns(("pressure_a", "pressure_b"), channels)
        pairs.append(
            f"not torque against pressures ({', '.join(lacking)} missing)" if lacking else "torque against pressures"
        )
    return ", ".join(pairs)


def _columns(needed: Collection[str], channels: Collection[str]) -> tuple[str, ...]:
    return tuple(joint_column("<name>", name) for name in needed if name not in channels)
