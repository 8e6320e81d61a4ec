"""What ``hqpipe logs check --effects`` adds: which effects the logs could show, and which they do not tell apart."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.text import Text

from hqpipe.stages.log_commands.check_tables import WIDTH, few, groups, print_table

if TYPE_CHECKING:
    from hqpipe.gap.checks.left_out import LeftOut
    from hqpipe.gap.effects_shown import EffectShown, LayerEffects
    from hqpipe.identify.found import Number

_COLUMNS = ("joints", "named from", "beside base's error", "usual", "unit", "not told from")
_IMITATED = 0.9  # of what an effect does: with so much of it in the base's own numbers these are named as the reason
_NOTHING, _NO_SIZE, _BASE, _TOO_LARGE = "nothing by itself", "at no size", "base does", "too large"
"""Kinds of reason why an effect does not show."""


def effects_json(layers: Sequence[LayerEffects], reason: str | None) -> dict[str, Any]:
    """Plain data, see docs/how-to/check-logs.md.

    Args:
        reason: why nothing can be said; None where something can.
    """
    return {
        "effects": [_effect_json(layer.layer, effect) for layer in layers for effect in layer.effects],
        "pairs": [
            {
                "layer": layer.layer,
                "effects": list(pair.effects),
                "joints": list(pair.joints),
                "experiment": pair.experiment,
            }
            for layer in layers
            for pair in layer.pairs
        ],
        "not_sought": [
            {"layer": layer.layer, "effect": effect, "why": why}
            for layer in layers
            for effect, why in layer.not_sought.items()
        ],
        "effects_left_out": [row for layer in layers for item in layer.left_out for row in _left_out_json(layer, item)],
        "effects_layers": [
            {"layer": layer.layer, "joints": list(layer.joints), "reason": layer.reason} for layer in layers
        ],
        "effects_reason": reason,
    }


def _left_out_json(layer: LayerEffects, item: LeftOut) -> list[dict[str, Any]]:
    """One row for each joint; one without a joint where trials are left out whole."""
    rest = {"trials": list(item.trials), "channel": item.channel, "why": _why(item)}
    return [{"layer": layer.layer, "joint": joint, **rest} for joint in item.joints or (None,)]


def _why(item: LeftOut) -> str:
    return f"{item.reason}; {item.fix}" if item.fix else item.reason


def _effect_json(layer: str, effect: EffectShown) -> dict[str, Any]:
    known = _any_number(effect)
    return {
        "layer": layer,
        "joint": effect.joint,
        "effect": effect.effect,
        "parameter": known and known.name,
        "unit": known and known.unit,
        "shows": effect.shows,
        "from": _value(effect.least),
        "from_beside_base_error": _value(effect.least_beside_base_error),
        "usual": _value(effect.usual),
        "falls": effect.falls,
        "taken_by_base": effect.share_done_by_base,
        "alike": list(effect.alike),
        "experiment": effect.experiment,
    }


def _any_number(effect: EffectShown) -> Number | None:
    numbers = (effect.usual, effect.least, effect.least_beside_base_error)
    return next((number for number in numbers if number is not None), None)


def _value(number: Number | None) -> float | None:
    return None if number is None else number.value


def print_effects(layers: Sequence[LayerEffects], reason: str | None) -> None:
    """Print the tables of each layer, or the reason why there are none."""
    console = Console(file=sys.stdout, width=None if sys.stdout.isatty() else WIDTH, highlight=False)
    if reason is not None:
        console.print(Text(f"effects: nothing can be said: {reason}"), soft_wrap=True)
    common = [item for item in layers[0].left_out if all(item in layer.left_out for layer in layers)] if layers else []
    for layer in layers:
        first = f"effect, layer {_spaced(layer.layer)}"
        print_table(console, (first, *_COLUMNS), _effect_rows(layer), whole=(first, "unit", "not told from"))
        print_table(console, ("not told apart", "joints", "what tells them apart"), _pair_rows(layer))
        print_table(console, ("does not show", "joints", "what would show it"), _hidden_rows(layer))
        if layer.reason is not None:
            console.print(Text(f"layer {_spaced(layer.layer)}: nothing can be said: {layer.reason}"), soft_wrap=True)
        own = [item for item in layer.left_out if item not in common]
        _print_left_out(console, f"left out of layer {_spaced(layer.layer)}", own)
        for why, rows in groups(layer.not_sought.items(), lambda row: row[1]):
            console.print(Text(f"not sought: {', '.join(effect for effect, _ in rows)}: {why}"), soft_wrap=True)
    _print_left_out(console, "left out", common)


def _print_left_out(console: Console, head: str, left_out: Iterable[LeftOut]) -> None:
    for (why, channel), items in groups(left_out, lambda item: (_why(item), item.channel)):
        names = dict.fromkeys(name for item in items for name in item.joints or item.trials)
        of = f" ({channel})" if channel else ""
        console.print(Text(f"{head}: {few(list(names))}{of}: {why}"), soft_wrap=True)


def _spaced(name: str) -> str:
    return name.replace("_", " ")


def _effect_rows(layer: LayerEffects) -> Iterable[tuple[str, ...]]:
    """One line per effect and verdict; joints with the same share it, and what differs is given as a range."""
    order = list(dict.fromkeys(effect.effect for effect in layer.effects))
    ordered = sorted(layer.effects, key=lambda e: order.index(e.effect))
    for (name, hidden, unit, alike), members in groups(ordered, lambda e: (e.effect, _hidden(e), _unit(e), e.alike)):
        least = _sizes([e.least for e in members])
        if members[0].falls and any(e.least is not None for e in members):
            least += " down"
        beside = "" if hidden else _sizes([e.least_beside_base_error for e in members])
        usual = _sizes([e.usual for e in members])
        named_from = _why_hidden(hidden, members, least) if hidden else least
        yield name, _where([e.joint for e in members], layer), named_from, beside, usual, unit, "\n".join(alike)


def _hidden(effect: EffectShown) -> str | None:
    """The kind of reason why an effect does not show; None where it does."""
    if effect.shows:
        return None
    if effect.share_done_by_base is None:
        return _NOTHING
    if effect.share_done_by_base >= _IMITATED and effect.least is not None:
        return _BASE
    return _TOO_LARGE if effect.least is not None else _NO_SIZE


def _why_hidden(kind: str, members: Sequence[EffectShown], least: str) -> str:
    if kind == _BASE:
        share = min(e.share_done_by_base or 0.0 for e in members)
        return f"no: {kind} {math.floor(100.0 * share)} %"
    return f"no: {least if kind == _TOO_LARGE else kind}"


def _unit(effect: EffectShown) -> str:
    known = _any_number(effect)
    return known.unit if known and known.unit != "1" else ""


def _pair_rows(layer: LayerEffects) -> Iterable[tuple[str, ...]]:
    for (joints, experiment), members in groups(layer.pairs, lambda pair: (pair.joints, pair.experiment)):
        yield "\n".join(" – ".join(pair.effects) for pair in members), _where(joints, layer), experiment


def _hidden_rows(layer: LayerEffects) -> Iterable[tuple[str, ...]]:
    hidden = [effect for effect in layer.effects if effect.experiment]
    for (name, experiment), members in groups(hidden, lambda e: (e.effect, e.experiment)):
        yield name, _where([e.joint for e in members], layer), experiment


def _where(joints: Sequence[str], layer: LayerEffects) -> str:
    return "all" if len(joints) == len(layer.joints) > 1 else few(list(joints), 2)


def _sizes(numbers: Sequence[Number | None]) -> str:
    """The range of sizes; a dash where there is none."""
    values = sorted(abs(number.value) for number in numbers if number is not None)
    ends = [f"{value:.2g}" for value in (values[:1] + values[-1:])]
    return " … ".join(dict.fromkeys([*ends[:1], "–" if None in numbers else ends[-1]]))
