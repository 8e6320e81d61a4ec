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


@dataclass(frozen=True)
class Layer:
    """One layer and whether it can be evaluated.

    Attributes:
        layer: "actuator", "sensing", "rigid_body" or "contact". mode: control mode of an actuator layer, else None.
        possible: whether the channels are there. evaluated: whether `hqpipe diagnose` takes it with the set as it is.
        missing: columns that it lacks. note: what else there is to know.
    """

    layer: str
    mode: str | None
    possible: bool
    evaluated: bool
    missing: tuple[str, ...] = ()
    note: str = ""


def layers(channels: Collection[str], mode: str | None, differentiated: bool = False) -> list[Layer]:
    """Judge what can be diagnosed.

    Args:
        channels: recorded in every trial. mode: control mode, as stated or inferred. differentiated: velocity is not recorded.
    """
    found = []
    for name, needs in _NEEDS.items():
        missing = _columns(needs, channels)
        note = f"with control_mode: {name} in logset.yaml, in place of {mode}" if mode and mode != name else ""
        found.append(
            Layer("actuator", name, not missing, mode == name and not missing, missing, "" if missing else note)
        )
    lacking = () if mode == "valve" else _columns(("effort",), channels)
    found.append(Layer("sensing", None, not lacking, not lacking, lacking, _comparisons(channels, differentiated)))
    return found + [Layer(name, None, False, False, (), "hqpipe diagnose does not evaluate it") for name in _FUTURE]


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
