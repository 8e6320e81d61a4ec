"""A diagnosis in words: the verdict as a sentence, names and numbers as a person writes them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

VERDICTS = {
    "explained": "explained",
    "partly_explained": "partly explained",
    "unknown": "cause unknown",
    "no_gap": "no gap",
    "not_identifiable": "cannot tell",
}
SINCE = {
    "explained": "changed",
    "partly_explained": "changed, partly explained",
    "unknown": "changed, cause unknown",
    "no_gap": "nothing changed",
    "not_identifiable": "cannot tell",
}
"""The verdict where logs were compared with an earlier record of the machine."""
MARKS = {"explained": "✓", "partly_explained": "◐", "unknown": "?", "no_gap": "=", "not_identifiable": "–"}
# unit → what is compared; the first two are the output of a rotary and of a linear drive
_QUANTITIES = {"N·m": "torque", "N": "force", "rad/s": "speed", "m/s": "speed", "rad": "position", "m": "position"}
_RUN = ("free-running over", "model running free, over {} windows", "the model running free")
_POSITION = "position of the model running free, over {} windows"
_TORQUE = "torque that the motion asks for beside the measured one, filtered over {}"
_LAYER_RUNS = {
    "servo": ("free-running over", _POSITION, "the free-running position"),
    "joint_motion": ("filtered over", _TORQUE, "the torque from motion"),
}
"""Layer → how the error was made: in the head of the terminal, as a note with the window, and in a heading."""
_MILLI = {"s": "ms", "rad": "mrad", "m": "mm"}
_NAMED = 4  # joints or trials in a line
_MILLI_BELOW = 0.1  # of the unit: below it thousandths are easier to read
_UNIT_SUFFIX = re.compile(r"(?:^|_)(?:nm_s_per_rad|nm_per_rad|n_per_m|per_rad|per_s|per_m|rad_s|kg_m2|nm|rad|kg|s|m)$")


def verdict_sentence(content: Mapping[str, Any]) -> str:
    """The verdict in one plain sentence with the numbers that carry it."""
    gap, verdict = content["gap"], content["verdict"]
    if gap is None:
        return "These logs cannot tell how far the simulator is from the machine."
    quantity = _QUANTITIES.get(gap["unit"], "output")
    before, after, floor = (size_text(gap, key) for key in ("before", "after", "noise_floor"))
    if since := reference_name(content):
        return _since_sentence(content, since, quantity)
    if verdict == "no_gap":
        return f"No gap: {_a(quantity)} error of {before} is no more than noise would leave ({floor})."
    if verdict == "unknown":
        tried = len({item["effect"] for item in content["effects_considered"]})
        blame = f"none of the {tried} effects tried accounts for it" if tried > 1 else "no cause was found"
        return f"The simulator misses the machine's {quantity} by {before} (noise: {floor}), and {blame}."
    names = listed([words(cause["effect"]) for cause in content["causes"]])
    verb = "bring" if len(content["causes"]) > 1 else "brings"
    fall = f"from {before} down to {after} (noise: {floor})"
    if verdict == "explained":
        return f"The {quantity} error is explained: {names} {verb} it {fall}."
    if verdict == "partly_explained":
        return f"Part of the {quantity} error is explained: {names} {verb} it {fall}; something else is left."
    return f"The {quantity} error is {before} (noise: {floor}), but these logs cannot tell its cause."


def _since_sentence(content: Mapping[str, Any], since: str, quantity: str) -> str:
    """What changed since an earlier record, in one sentence."""
    before, after, floor = (size_text(content["gap"], key) for key in ("before", "after", "noise_floor"))
    missed = f"the model of then misses the {quantity} by {before} (noise: {floor})"
    if content["verdict"] == "no_gap":
        return f"Nothing changed since {since}: {missed}, no more than it does on an unchanged machine."
    if not content["causes"]:
        return f"Something changed since {since}: {missed}, and no known change accounts for it."
    names = listed([words(cause["effect"]) for cause in content["causes"]])
    verb = "bring" if len(content["causes"]) > 1 else "brings"
    rest = "; something else is left" if content["verdict"] == "partly_explained" else ""
    return f"Changed since {since}: {missed}; {names} {verb} it down to {after}{rest}."


def run_words(gap: Mapping[str, Any], place: int) -> str:
    """How the error of a layer was made, see `_LAYER_RUNS`; in the note the window is named."""
    window = f"{1e3 * gap['window_s']:.0f} ms"
    return _LAYER_RUNS.get(gap["layer"], _RUN)[place].format(window)


def _a(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def sizes(gap: Mapping[str, Any]) -> dict[str, float]:
    """before, after, noise_floor and persistence without a unit, over the joints' spread; of a file of the first format, which
    has no such numbers, over the error before."""
    if known := gap.get("normalised"):
        return dict(known)
    return {name: gap[name] / (gap["before"] or 1.0) for name in ("before", "after", "noise_floor", "persistence")}


def left_share(gap: Mapping[str, Any]) -> float:
    """What is left of the gap, noise included: with the shares of the causes, root mean squares too, it makes the whole."""
    return min(1.0, max(0.0, 1.0 - gap["shrink"]))


def size_text(gap: Mapping[str, Any], name: str) -> str:
    """One of the sizes of a gap with its unit: ``67.4 N·m``; of joints without a common one, ``31% of the spread``."""
    if gap["unit"] is not None:
        return f"{number(gap[name])} {gap['unit']}"
    return f"{percent_text(sizes(gap)[name])} of the spread"


def percent_text(value: float) -> str:
    """Per cent with two significant digits below ten."""
    return f"{number(float(f'{100 * value:.2g}'))}%" if abs(value) < 0.1 else percent(value)


def reference_name(content: Mapping[str, Any]) -> str | None:
    """The last part of the path of the earlier record that the logs were compared with; None without one."""
    if "reference" not in content:
        return None
    return re.split(r"[/\\]", content["reference"]["path"].rstrip("/\\"))[-1] or "the reference"


def verdict_words(content: Mapping[str, Any]) -> str:
    """The verdict in two or three words."""
    return (SINCE if "reference" in content else VERDICTS)[content["verdict"]]


def words(name: str) -> str:
    """A name of the file format as a person writes it: ``5-20_hz`` → ``5–20 Hz``."""
    return re.sub(r"(?<=\d)-(?=\d)", "–", name.replace("_hz", " Hz")).replace("_", " ")


def listed(items: Sequence[str], last: str = "and") -> str:
    """``a``, ``a and b``, ``a, b and c``; a name that comes twice is counted."""
    counted = [item if (n := items.count(item)) == 1 else f"{item} ({n} times)" for item in dict.fromkeys(items)]
    return counted[0] if len(counted) == 1 else f"{', '.join(counted[:-1])} {last} {counted[-1]}" if counted else ""


def joints_text(joints: Sequence[str], machine: Sequence[str], most: int = 3) -> str:
    """Joints in few words: all of them, up to `most` names, or some and how many more."""
    if len(joints) > 1 and set(joints) == set(machine):
        return f"all {len(joints)} joints"
    if len(joints) <= most:
        return ", ".join(joints)
    return f"{', '.join(joints[: most - 1])} and {len(joints) - most + 1} more"


def confusions(cause: Mapping[str, Any]) -> list[str]:
    """What else would explain the same error; a set of effects is one entry."""
    return [
        words(item) if isinstance(item, str) else " with ".join(words(name) for name in item)
        for item in cause["confused_with"]
    ]


def number(value: float | None) -> str:
    """Three significant digits, or a dash."""
    if value is None or not math.isfinite(value):
        return "–"
    return (f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}").replace("-", "−")


def percent(value: float) -> str:
    """Whole per cent; what is above zero never reads as zero."""
    if 0 < abs(value) < 0.005:
        return "<1%"
    return f"{100 * value:.0f}%".replace("-0%", "0%").replace("-", "−")


def parameter_name(name: str) -> str:
    """A parameter's name without the unit at its end, which stands beside the value: ``delay_s`` → ``delay``, and
    ``natural_hz`` → ``natural frequency``."""
    return words(_UNIT_SUFFIX.sub("", re.sub(r"_hz$", "_frequency", name))) or "value"


def then_text(parameter: Mapping[str, Any]) -> str:
    """What a parameter was in the earlier record: ``was 4.00 mrad``, ``was absent``, or nothing without one."""
    if "reference" not in parameter:
        return ""
    then = parameter["reference"]
    return "was absent" if then is None else f"was {parameter_text(parameter | {'value': then})[0]}"


def parameter_text(parameter: Mapping[str, Any]) -> tuple[str, str]:
    """A parameter and its 95 % interval with as many digits as the interval carries.

    Returns:
        ``("6.20 mrad", "6.00 … 6.50 mrad")``; seconds, radians and metres below 0.1 are given in thousandths.
    """
    value, unit, (low, high) = parameter["value"], parameter["unit"], parameter["ci95"]
    if unit in _MILLI and max(abs(value), abs(low), abs(high)) < _MILLI_BELOW:
        value, low, high, unit = 1e3 * value, 1e3 * low, 1e3 * high, _MILLI[unit]
    unit = "command units" if unit == "command" else unit
    tail = f" {unit}" if unit not in ("", "1", "-", "–") else ""
    width = max(high - low, 1e-4 * max(abs(low), abs(high), 1e-9))
    places = min(9, max(0, 1 - math.floor(math.log10(width))))
    text = [f"{x:.{places}f}".replace("-", "−") for x in (value, low, high)]
    return f"{text[0]}{tail}", f"{text[1]} … {text[2]}{tail}"


def left_out_words(item: Mapping[str, Any]) -> str:
    """What of the logs an entry of `left_out` says was not used: a channel of joints, joints, or trials."""
    joints, trials = item["joints"], item["trials"]
    if not joints:
        return listed(trials) if len(trials) <= _NAMED else f"{len(trials)} trials"
    names = listed(joints) if len(joints) <= _NAMED else f"{len(joints)} joints"
    return f"{item['channel']} of {names}" if item["channel"] else names
