"""Joint × regime as an HTML table whose cells are coloured by their share of the gap."""

from __future__ import annotations

import html
import re
from collections.abc import Collection, Mapping, Sequence

from hqpipe.report.diagnosis_read import Cell
from hqpipe.report.diagnosis_words import number, percent, words

# White to dark, in orange before and in blue after, for the two have scales of their own; lightness falls steadily,
# so they read without hue and on a black-and-white print.
_BEFORE = ((255, 255, 255), (251, 227, 207), (238, 154, 92), (194, 65, 12), (107, 29, 5))
_AFTER = ((255, 255, 255), (214, 230, 244), (107, 174, 214), (33, 113, 181), (8, 48, 107))
_GAMMA = 0.7  # assumption: lifts small shares off the white, since one joint's total dwarfs its regimes
_WHITE_TEXT = 0.62  # of the colour scale, from where on dark text has less contrast than white
_PRINTED = 0.01  # smaller shares are left unprinted
_REST = ("no_", "between_", "low_flow", "low_demand")  # regimes that are what their family leaves over
_ORDER = "all direction reversal speed flow demand saturation impact contact stance time_span span frequency".split()


def heat_table(
    cells: Sequence[Cell],
    joints: Sequence[str],
    *,
    named: Collection[tuple[str, str]] = (),
    after: bool = False,
) -> str:
    """One row per joint, one column per regime, families side by side.

    Args:
        cells: pooled rows of residuals.csv.
        joints: the machine's joints in their order; joints without cells are left out.
        named: (joint, regime) pairs to frame.
        after: show the share of what is left with the found effects instead of the share of the gap before.
    """
    shown = [c for c in cells if not c.regime.startswith(_REST)]
    rows = [j for j in joints if any(c.joint == j for c in shown)]
    rows += sorted({c.joint for c in shown} - set(rows))
    families = _columns(shown)
    at = {(c.joint, c.family, c.regime): c for c in shown}
    whole: dict[str, float] = {c.joint: c.samples for c in shown if c.family == "all"}
    top = max((_value(c, after) for c in shown), default=0.0) or 1.0
    lines = ['<div class="scroll"><table class="heat">', _head(families), "<tbody>"]
    for joint in rows:
        name = html.escape(joint, quote=True)
        line = [f'<tr><th scope="row" title="{name}">{name}</th>']
        for family, regimes in families.items():
            for i, regime in enumerate(regimes):
                cell = at.get((joint, family, regime))
                classes = " ".join(n for n, on in (("first", i == 0), ("named", (joint, regime) in named)) if on)
                line.append(
                    f'<td class="{classes} absent" title="no samples"></td>'
                    if cell is None
                    else _cell(cell, top, _hint(cell, whole.get(joint), after), classes, after)
                )
        lines.append("".join([*line, "</tr>"]))
    return "\n".join([*lines, "</tbody></table></div>"])


def _columns(cells: Sequence[Cell]) -> dict[str, list[str]]:
    """family → its regimes; known families first, then the others as they come."""
    found = {family: [] for family in _ORDER}
    for cell in cells:
        regimes = found.setdefault(cell.family, [])
        if cell.regime not in regimes:
            regimes.append(cell.regime)
    return {family: sorted(regimes, key=_natural) for family, regimes in found.items() if regimes}


def _natural(name: str) -> list[tuple[int, float, str]]:
    """Sort key that puts 20-100 behind 5-20."""
    parts = re.split(r"(\d+(?:\.\d+)?)", name)
    return [(0, float(p), "") if p and p[0].isdigit() else (1, 0.0, p) for p in parts if p]


def _head(families: Mapping[str, Sequence[str]]) -> str:
    groups = "".join(
        f'<th class="family first" colspan="{len(regimes)}">'
        f"{html.escape(words(family)) if len(regimes) > 1 else ''}</th>"
        for family, regimes in families.items()
    )
    names = "".join(
        f'<th class="regime{" first" if i == 0 else ""}" scope="col"><span>{html.escape(words(regime))}</span></th>'
        for regimes in families.values()
        for i, regime in enumerate(regimes)
    )
    return f"<thead><tr><th></th>{groups}</tr><tr><th></th>{names}</tr></thead>"


def _value(cell: Cell, after: bool) -> float:
    return (cell.share_after or 0.0) if after else cell.share


def _cell(cell: Cell, top: float, hint: str, classes: str, after: bool) -> str:
    value = _value(cell, after)
    level = min(1.0, max(0.0, value / top)) ** _GAMMA
    ink = "#ffffff" if level > _WHITE_TEXT else "#222222"
    text = f"{100 * value:.0f}" if value >= _PRINTED else ""
    style = f"background:{_color(level, _AFTER if after else _BEFORE)};color:{ink}"
    return f'<td class="{classes}" style="{style}" title="{html.escape(hint, quote=True)}">{text}</td>'


def _hint(cell: Cell, samples: float | None, after: bool) -> str:
    place = cell.joint if cell.regime == "all" else f"{cell.joint}, {words(cell.regime)}"
    text = f"{place}: {percent(_value(cell, after))} of {'what is left' if after else 'the gap'}"
    if not after and cell.share_low is not None and cell.share_high is not None:
        text += f" ({percent(cell.share_low)} … {percent(cell.share_high)})"
    if samples and cell.family not in ("all", "frequency"):
        text += f"; {percent(min(1.0, cell.samples / samples))} of the time"
    sizes = [number(size) for size in (cell.rmse, cell.rmse_after) if size is not None]
    return text + (f"; RMSE {' → '.join(sizes)} {cell.unit}" if sizes else "")


def _color(level: float, stops: Sequence[tuple[int, int, int]]) -> str:
    """Colour at 0…1 of the scale."""
    position = level * (len(stops) - 1)
    index = min(int(position), len(stops) - 2)
    part = position - index
    mixed = (round(a + part * (b - a)) for a, b in zip(stops[index], stops[index + 1], strict=True))
    return "#" + "".join(f"{channel:02x}" for channel in mixed)
