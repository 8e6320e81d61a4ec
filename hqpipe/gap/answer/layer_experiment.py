"""The recording that would settle what a layer leaves open, as a sentence."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from hqpipe.layers.actuator.changes import MULTIPLIES
from hqpipe.logs.findings import listed
from hqpipe.logs.joint_kinds import PRISMATIC, REVOLUTE
from hqpipe.machine import EFFECTS

_OTHERS: dict[str, tuple[str, ...]] = {
    "payload": ("load",),
    "armature": ("load",),
    "inertia_error": ("load",),
    "com_error": ("load", "offset"),
    "spring": ("load", "offset"),
    "mount_tilt": ("load", "offset"),
    "velocity_lag": ("late",),
    "voltage_sag": ("limit",),
    "torque_limit": ("limit",),
    "gain_error": ("gain",),
}
"""Causes of other layers → what they show as, which effects of the library say themselves."""
_BETWEEN: tuple[tuple[set[str], str], ...] = (
    ({"friction"}, "slow triangles to and fro over the same range at two speeds, several times each"),
    (
        {"friction", "load friction"},
        "slow triangles over the same range without and with a known load, several times each",
    ),
    ({"offset"}, "hold still at several angles over the whole range, each approached from both sides"),
    ({"load"}, "the same motion with and without {mass}"),
    ({"late"}, "steps of the command from rest, and pushes by hand while the command is held"),
    ({"limit"}, "the same large fast motion at two supplies (voltage, pressure), with the supply logged"),
    ({"play"}, "slow reversals with the load on one side of the play and then on the other, then fast ones"),
    (
        {"warming"},
        "the same motion in cold and in warm condition, with the temperature logged, holding a load still in between",
    ),
    ({"coefficients"}, "hold a load with the command still, step it, and repeat the fast motion of the reference"),
    ({"gain"}, "steps of several sizes in both directions, with the gains of the drive stated in logset.yaml"),
)
"""Kinds of error → what tells any two causes that show as one of them apart; the first entry that holds both counts."""
_BY_SIGNAL = {
    "last reversal": "slow motion to and fro at five or more amplitudes from the least that the encoder resolves, which lost "
    "motion and elastic presliding answer differently",
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
    "joint_motion": "log a trial with {mass}, slowly and then fast",
    "actuator": "log what lies between command and output: the valve's own command, the pressures, or the motor current",
}
_MASS = {
    REVOLUTE: "a known mass at a known distance from the axis",
    PRISMATIC: "a known mass on it",
    None: "a known mass (at a known distance from the axis of a joint that turns)",
}
"""Kind of the joint, None where nobody says → the load to record with."""


def next_experiment(
    layer: str,
    causes: Sequence[Mapping[str, Any]],
    unexplained: bool,
    depends_on: Sequence[Mapping[str, Any]],
    worst: str,
    beyond: Sequence[str] = (),
    kinds: Mapping[str, str] | None = None,
) -> str | None:
    """What to record next; None where nothing is open.

    Args:
        causes, depends_on: as in diagnosis.json. unexplained: whether more is left than noise. worst: joint with most of it.
        beyond: held-out trials whose error lies where no fit trial was. kinds: joint → revolute or prismatic, as far as known.
    """
    kinds = kinds or {}
    for cause in causes:
        if cause["confused_with"]:
            rival, joints = cause["confused_with"][0], ", ".join(cause["joints"])
            own = {kinds.get(joint) for joint in cause["joints"]}
            text = telling_apart({cause["effect"], rival}, layer, own.pop() if len(own) == 1 else None)
            return f"to tell {cause['effect']} from {rival} in {joints}: {text}"
    if not unexplained:
        return None
    if beyond:
        trials = listed(list(beyond))
        return f"add a fit trial with the same motion as {trials}: what is left lies where no fit trial was"
    head = f"no effect known to the layer {layer.replace('_', ' ')} fits what is left"
    for row in depends_on:
        signal, joints = row["signal"], ", ".join(row["joints"])
        known = next((text for name, text in _BY_SIGNAL.items() if name in signal), None)
        if known is not None:
            return f"{head}, which depends on the {signal.replace('_', ' ')}: in {joints}, {known}"
    return f"{head}; {_open(layer, kinds.get(worst))}, {worst} alone with the others held"


def telling_apart(pair: Collection[str], layer: str, kind: str | None = None) -> str:
    """What to record so that two effects of a layer can be told apart.

    Args:
        kind: of the joints, revolute or prismatic; None where nobody says.
    """
    for kinds, text in _BETWEEN:
        if all(kinds & _shows_as(name) for name in pair):
            return text.format(mass=_MASS[kind])
    for name in sorted(pair):
        if name in EFFECTS:
            return EFFECTS[name].experiment
    return f"excite these joints alone, slowly and then fast, and {_open(layer, kind)}"


def experiment_for(effect: str, layer: str, kind: str | None = None) -> str:
    """What to record so that an effect shows in a layer: what the library says, else what suits its kind of error.

    Args:
        kind: of the joint, as of `telling_apart`.
    """
    return EFFECTS[effect].experiment if effect in EFFECTS else telling_apart((effect,), layer, kind)


def _open(layer: str, kind: str | None) -> str:
    """What to record where nothing points to an effect."""
    return _OPEN.get(layer, _OPEN["joint_motion"]).format(mass=_MASS[kind])


def _shows_as(name: str) -> set[str]:
    effect = EFFECTS.get(name)
    kinds = set(effect.shows_as if effect else _OTHERS.get(name, ()))
    return kinds | {"coefficients"} if name in MULTIPLIES or (effect and effect.multiplies) else kinds
