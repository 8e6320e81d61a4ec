"""The recording that would settle what a layer leaves open, as a sentence."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from hqpipe.layers.actuator.changes import MULTIPLIES
from hqpipe.logs.findings import listed
from hqpipe.machine import EFFECTS

_FRICTION = frozenset({"coulomb_friction", "viscous_friction", "stribeck_friction"})
_LOADED = frozenset({"load_dependent_friction"})
_LOADS = frozenset({"payload", "armature", "inertia_error", "com_error", "spring", "mount_tilt", "torque_scale"})
_OFFSETS = frozenset({"torque_bias", "position_bias", "mount_tilt", "com_error", "spring"})
_LATE = frozenset({"command_delay", "valve_delay", "valve_lag", "channel_skew", "velocity_lag"})
_SUPPLY = frozenset({"voltage_sag", "torque_limit", "supply_droop", "flow_saturation"})
_PLAY = frozenset({"backlash", "transmission_compliance"})
_GAINS = frozenset({"gain_error", "direction_asymmetry", "gain_drift"})
_WARM = frozenset({"gain_drift", "leakage_drift"})
_BETWEEN: tuple[tuple[frozenset[str], str], ...] = (
    (_FRICTION, "slow triangles to and fro over the same range at two speeds, several times each"),
    (_FRICTION | _LOADED, "slow triangles over the same range without and with a known load, several times each"),
    (_OFFSETS, "hold still at several angles over the whole range, each approached from both sides"),
    (_LOADS, "the same motion with and without a known mass at a known distance from the axis"),
    (_LATE, "steps of the command from rest, and pushes by hand while the command is held"),
    (_SUPPLY, "the same large fast motion at two supplies (voltage, pressure), with the supply logged"),
    (_PLAY, "slow reversals with the load on one side of the play and then on the other, then fast ones"),
    (
        _WARM,
        "the same motion in cold and in warm condition, with the temperature logged, holding a load still in between",
    ),
    (
        frozenset(MULTIPLIES) | {"transmission_compliance"},
        "hold a load with the command still, step it, and repeat the fast motion of the reference",
    ),
    (_GAINS, "steps of several sizes in both directions, with the gains of the drive stated in logset.yaml"),
)
"""Effects → what tells any two of them apart; the first entry that holds both counts."""
_BY_SIGNAL = {
    "position_command": "steps of several sizes from rest in both directions",
    "duty": "the same large slow and fast motions at two supply voltages, with the voltage logged",
    "position": "the same slow motion to and fro over the whole range of the joint, at two loads",
    "velocity": "strokes over the same range at five or more speeds in both directions",
    "time": "the same motion in cold and in warm condition, with the temperature logged",
    "command": "steps of several sizes from rest in both directions",
    "acceleration": "the same motion slowly and as fast as the joint can, without and with a known mass",
    "load": "the same slow motion without and with a known load",
}
_OPEN = {
    "servo": "log the motor current beside command and position",
    "joint_motion": "log a trial with a known mass at a known distance from the axis, slowly and then fast",
    "actuator": "log what lies between command and output: the valve's own command, the pressures, or the motor current",
}


def next_experiment(
    layer: str,
    causes: Sequence[Mapping[str, Any]],
    unexplained: bool,
    depends_on: Sequence[Mapping[str, Any]],
    worst: str,
    beyond: Sequence[str] = (),
) -> str | None:
    """What to record next; None where nothing is open.

    Args:
        causes, depends_on: as in diagnosis.json. unexplained: whether more is left than noise. worst: joint with most of it.
        beyond: held-out trials whose error lies where no fit trial was.
    """
    for cause in causes:
        if cause["confused_with"]:
            rival, joints = cause["confused_with"][0], ", ".join(cause["joints"])
            return f"to tell {cause['effect']} from {rival} in {joints}: {_telling({cause['effect'], rival}, layer)}"
    if not unexplained:
        return None
    if beyond:
        trials = listed(list(beyond))
        return f"add a fit trial with the same motion as {trials}: what is left lies where no fit trial was"
    head = "no effect of the library fits what is left"
    for row in depends_on:
        signal, joints = row["signal"], ", ".join(row["joints"])
        known = next((text for name, text in _BY_SIGNAL.items() if name in signal), None)
        if known is not None:
            return f"{head}, which depends on the {signal.replace('_', ' ')}: in {joints}, {known}"
    return f"{head}; {_OPEN.get(layer, _OPEN['joint_motion'])}, {worst} alone with the others held"


def _telling(pair: Collection[str], layer: str) -> str:
    for effects, text in _BETWEEN:
        if effects.issuperset(pair):
            return text
    for name in sorted(pair):
        if name in EFFECTS:
            return EFFECTS[name].experiment
    return f"excite these joints alone, slowly and then fast, and {_OPEN.get(layer, _OPEN['joint_motion'])}"
