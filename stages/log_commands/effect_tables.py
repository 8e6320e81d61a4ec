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
    from hqpipe.gap.effects_shown import EffectShown, LayerEffects
    from hqpipe.identify.found import Number

_COLUMNS = ("joints", "named from", "beside base's error", "usual", "unit", "not told from")
_IMITATED = 0.9  # of what an effect does: with so much of it in the base's own numbers these are named as the reason


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
        "effects_left_out": [
            {"layer": layer.layer, "joint": joint, "why": why} for layer in layers for joint, why in layer.left.items()
        ],
        "effects_reason": reason,
    }


def _effect_json(layer: str, effect: EffectShown) -> dict[str, Any]:
    known = next((number for number in (effect.usual, effect.least, effect.beside) if number is not None), None)
    return {
        "layer": layer,
        "joint": effect.joint,
        "effect": effect.effect,
        "parameter": known and known.name,
        "unit": known and known.unit,
        "shows": effect.shows,
        "from": _value(effect.least),
        "from_beside_base_error": _value(effect.beside),
        "usual": _value(effect.usual),
        "falls": effect.falls,
        "taken_by_base": effect.taken,
        "alike": list(effect.alike),
        "experiment": effect.experiment,
    }


def _value(number: Number | None) -> float | None:
    return None if number is None else number.value


def print_effects(layers: Sequence[LayerEffects], reason: str | None) -> None:
    """Print the tables of each layer, or the reason why there are none."""
    console = Console(file=sys.stdout, width=None if sys.stdout.isatty() else WIDTH, highlight=False)
    if reason is not None:
        console.print(Text(f"effects: nothing can be said: {reason}"), soft_wrap=True)
    for layer in layers:
        first = f"effect, layer {layer.layer.replace('_', ' ')}"
        print_table(console, (first, *_COLUMNS), _effect_rows(layer), whole=(first, "unit", "not told from"))
        print_table(console, ("not told apart", "joints", "what tells them apart"), _pair_rows(layer))
        print_table(console, ("does not show", "joints", "what would show it"), _hidden_rows(layer))
        for why, rows in groups(layer.left.items(), lambda row: row[1]):
            console.print(Text(f"left out: {few([joint for joint, _ in rows])}: {why}"), soft_wrap=True)
        for why, rows in groups(layer.not_sought.items(), lambda row: row[1]):
            console.print(Text(f"not sought: {', '.join(effect for effect, _ in rows)}: {why}"), soft_wrap=True)


def _effect_rows(layer: LayerEffects) -> Iterable[tuple[str, ...]]:
    """One line per effect and verdict; joints with the same share it, and what differs is given as a range."""
    order = list(dict.fromkeys(effect.effect for effect in layer.effects))
    ordered = sorted(layer.effects, key=lambda e: order.index(e.effect))
    for (name, shows, unit, alike), members in groups(ordered, lambda e: (e.effect, e.shows, _unit(e), e.alike)):
        usual = _sizes([e.usual for e in members])
        least = _sizes([e.least for e in members]) + (" down" if members[0].falls else "")
        least, beside = (least, _sizes([e.beside for e in members])) if shows else (_why_not(members, least), "")
        yield name, _where([e.joint for e in members], layer), least, beside, usual, unit, "\n".join(alike)


def _why_not(members: Sequence[EffectShown], needed: str) -> str:
    shares = [e.taken for e in members]
    if None in shares:
        return "no: nothing by itself"
    if needed == "–":
        return "no: at no size"
    least = min(shares)
    return f"no: base does {math.floor(100.0 * least)} %" if least >= _IMITATED else f"no: {needed}"


def _unit(effect: EffectShown) -> str:
    known = [number.unit for number in (effect.usual, effect.least, effect.beside) if number is not None]
    return known[0] if known and known[0] != "1" else ""


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
    """The range of sizes; a dash stands for what no size is enough for."""
    values = sorted(abs(number.value) for number in numbers if number is not None)
    ends = [f"{value:.2g}" for value in (values[:1] + values[-1:])]
    return " … ".join(dict.fromkeys([*ends[:1], "–" if None in numbers else ends[-1]]))
