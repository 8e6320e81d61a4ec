"""What the name of a field means: joint and channel, by the habits of the field."""

from __future__ import annotations

import re
from dataclasses import dataclass

from hqpipe.logs.imports.units import UNITS

# Channels of a joint as programs call them, as words in lower case; longer phrases are looked for first.
_PHRASES: dict[str, tuple[str, ...]] = {
    "position_command": (
        *("position command", "position cmd", "pos cmd", "pos command", "pos des", "position desired", "position des"),
        *(
            "desired position",
            "des pos",
            "position target",
            "target position",
            "pos target",
            "target pos",
            "position ref",
        ),
        *(
            "pos ref",
            "ref pos",
            "position setpoint",
            "position sp",
            "pos sp",
            "command position",
            "cmd pos",
            "goal pos",
        ),
        *(
            "goal position",
            "present goal",
            "q des",
            "q ref",
            "q cmd",
            "q d",
            "q target",
            "q star",
            "qdes",
            "qref",
            "qcmd",
        ),
        *("angle cmd", "angle des", "angle ref", "reference position", "setpoint", "set point", "target", "reference"),
        *("desired", "goal", "ref", "des", "qg"),
    ),
    "effort_command": (
        *(
            "torque command",
            "torque cmd",
            "torque des",
            "torque ref",
            "desired torque",
            "torque desired",
            "torque target",
        ),
        *(
            "target torque",
            "tau des",
            "tau cmd",
            "tau ref",
            "tau command",
            "tau d",
            "effort command",
            "effort cmd",
            "force command",
        ),
        *("force cmd", "force ref", "cmd torque", "cmd effort", "feedforward torque", "tau ff"),
    ),
    "valve_command": (
        *("valve command", "valve cmd", "valve ref", "valve input", "valve signal", "valve position command", "valve"),
        *("spool command", "spool cmd", "spool ref", "spool", "servovalve", "u valve"),
    ),
    "command": ("command", "cmd", "control", "ctrl", "input", "output", "u", "action", "blended"),
    "error": ("position error", "pos error", "tracking error", "control error", "error", "err", "e"),
    "velocity": (
        *(
            "velocity",
            "vel",
            "speed",
            "omega",
            "qdot",
            "q dot",
            "qd",
            "dq",
            "dqdt",
            "dtheta",
            "theta dot",
            "angular velocity",
        ),
        *("joint velocity", "angle rate", "rate"),
    ),
    "effort": (
        *(
            "torque",
            "tau",
            "trq",
            "effort",
            "force",
            "load cell",
            "loadcell",
            "joint torque",
            "measured torque",
            "tau est",
        ),
        *("torque measured", "tau measured", "moment"),
    ),
    "position": (
        *(
            "position",
            "pos",
            "q",
            "angle",
            "theta",
            "ms",
            "meas",
            "measurement",
            "measured",
            "displacement",
            "disp",
            "stroke",
        ),
        *("encoder", "enc", "qm", "joint position", "joint angle", "cylinder position", "present position", "x"),
    ),
    "current": ("motor current", "present current", "current", "cur", "curr", "amps", "i", "iq", "i q"),
    "duty": ("duty cycle", "duty", "pwm", "present pwm"),
    "voltage": ("motor voltage", "voltage", "volt", "volts"),
    "pressure_a": (
        "pressure a",
        "press a",
        "p a",
        "pa",
        "p 1",
        "pressure 1",
        "pressure head",
        "head pressure",
        "p head",
        "p cap",
    ),
    "pressure_b": ("pressure b", "press b", "p b", "pb", "p 2", "pressure 2", "pressure rod", "rod pressure", "p rod"),
    "temperature": ("motor temperature", "temperature", "temp"),
}
_SHARED: dict[str, tuple[str, ...]] = {
    "supply/pressure": (
        *(
            "supply pressure",
            "pressure supply",
            "p supply",
            "p sup",
            "ps",
            "p s",
            "pump pressure",
            "p pump",
            "system pressure",
        ),
        *("pressure system", "p sys"),
    ),
    "supply/oil_temperature": (
        "oil temperature",
        "oil temp",
        "temp oil",
        "temperature oil",
        "t oil",
        "fluid temperature",
    ),
    "supply/voltage": ("supply voltage", "bus voltage", "vbus", "v bus", "battery voltage", "vbat", "v bat", "battery"),
}
_CLOCKS = (
    "time",
    "t",
    "timestamp",
    "time stamp",
    "stamp",
    "times",
    "elapsed",
    "elapsed time",
    "seconds",
    "sec",
    "secs",
    "clock",
)
_CLOCKS += (
    "total time",
    "sim time",
    "time since start",
    "date",
    "datetime",
    "date time",
    "tick",
    "ticks",
    "sample",
    "samples",
    "index",
)
_NOISE = {
    "joint",
    "joints",
    "jointstate",
    "state",
    "states",
    "actual",
    "act",
    "fb",
    "feedback",
    "obs",
    "observation",
    "sensor",
}
_NOISE |= {"raw", "present", "data", "signals", "values", "log"}
_UNIT_WORDS = {
    "deg": "deg",
    "degs": "deg",
    "degrees": "deg",
    "rad": "rad",
    "mm": "mm",
    "cm": "cm",
    "bar": "bar",
    "mbar": "mbar",
}
_UNIT_WORDS |= {
    "psi": "psi",
    "mpa": "MPa",
    "kpa": "kPa",
    "nm": "Nm",
    "us": "us",
    "ms": "ms",
    "ns": "ns",
    "sec": "s",
    "s": "s",
}
_UNIT_WORDS |= {
    "rpm": "rpm",
    "ma": "mA",
    "mv": "mV",
    "degc": "degC",
    "percent": "%",
    "pct": "%",
    "counts": "counts",
    "a": "A",
}
_UNIT_WORDS |= {"volts": "V", "n": "N", "m": "m", "rads": "rad/s", "radps": "rad/s", "dps": "deg/s"}
_ONLY_TIME = {"us", "ms", "ns", "sec", "s"}
_WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")
_BRACKET = re.compile(r"[\[(]\s*([^\[\]()]*?)\s*[\])]\s*$")


@dataclass(frozen=True)
class Meaning:
    """What a name says.

    Attributes:
        channel: of a joint, or "command" or "error"; "clock"; or the name of a shared column. joint: "" for a lone one.
        unit: as the name states it, "" if it does not.
    """

    channel: str
    joint: str = ""
    unit: str = ""


def meaning_of(name: str) -> Meaning | None:
    """What a field's name means; None for one that no habit explains."""
    bare, unit = _without_unit(name)
    words = _WORD.findall(bare)
    low = [word.casefold() for word in words]
    if len(low) > 1 and not unit and low[-1] in _UNIT_WORDS:
        rest = _read(words[:-1], low[:-1])
        if rest and (rest.channel == "clock") == (low[-1] in _ONLY_TIME) and low[-1] not in ("a", "m", "n", "s", "ms"):
            return Meaning(rest.channel, rest.joint, _UNIT_WORDS[low[-1]])
        if rest and rest.channel == "clock" and low[-1] in _ONLY_TIME:
            return Meaning("clock", "", _UNIT_WORDS[low[-1]])
        if rest is None and words[-1] == "ms":  # `latency_ms` is a time; `Boom Ms` is measured: units know no capital M
            return None
    found = _read(words, low)
    if found is None or (unit in UNITS and UNITS[unit].kind == "time" and found.channel != "clock"):
        return None
    return Meaning(found.channel, found.joint, unit)


def _without_unit(name: str) -> tuple[str, str]:
    """A name without its unit in brackets, and that unit."""
    match = _BRACKET.search(name)
    if match and not match[1].isdigit():
        unit = match[1] if match[1] in UNITS else _UNIT_WORDS.get(match[1].casefold(), match[1])
        return name[: match.start()], unit
    return name, ""


def _read(words: list[str], low: list[str]) -> Meaning | None:
    text = " ".join(low)
    if text in _CLOCKS:
        return Meaning("clock")
    for column, phrases in _SHARED.items():
        if text in phrases:
            return Meaning(column)
    best: tuple[int, int, str, int] | None = None
    for rank, (channel, phrases) in enumerate(_PHRASES.items()):
        for phrase in phrases:
            parts = phrase.split()
            for at in range(len(low) - len(parts) + 1):
                if low[at : at + len(parts)] == parts:
                    score = (len(phrase) if len(parts) == 1 else 100 * len(parts), -rank)
                    if best is None or score > best[:2]:
                        best = (*score, channel, at * 100 + len(parts))
    if best is None:
        return None
    at, count = divmod(best[3], 100)
    return Meaning(best[2], _joint_name(words[:at] + words[at + count :]))


def _joint_name(words: list[str]) -> str:
    """The name of a joint from what is left of a field's name; digits belong to the word before them."""
    kept = [word for word in words if word.casefold() not in _NOISE]
    if all(word.isdigit() for word in kept):
        return "".join(["joint", *kept]) if kept else ""
    joined = ""
    for word in kept:
        joined += word if not joined or word.isdigit() and not joined[-1].isdigit() else f"_{word}"
    return joined
