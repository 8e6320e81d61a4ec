"""The limit of detection in the page of the blind score: diagnosis and oracle over the size of the effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from hqpipe.report.blind_parts import inline_svg, plain_table
from hqpipe.report.blind_table import ratio_text, span_text
from hqpipe.report.style import BLUE, GREY, VERMILION, name_line, new_figure, styled

_NEEDED = 0.9  # named nine times in ten
_WHO = {"diagnosis": VERMILION, "oracle": BLUE}
_BESIDE = {"diagnosis": 0.97, "oracle": 1.03}  # so that the bars of a bin stand side by side


def limit_section(limit: Mapping[str, Any] | None) -> str:
    """HTML of the section; empty without faint cases.

    Args:
        limit: `limit` of score.json.
    """
    if limit is None:
        return ""
    false = limit["false_names"]
    parts = [
        "<h2>Limit of detection</h2>",
        f"<p>{limit['cases']} machines with one faint effect in all joints, diagnosed twice: with the whole library, "
        "and by an oracle whose library holds the true effect alone. It knows which effect it is, has to estimate "
        "everything else, and accepts by the same rules. The ratio of the two limits is the price of not knowing. The "
        "aim is judged on the first axis, where effects are compared by the error that they add (in squares) to the "
        "machine's own; a size of 1 is the small one of the effect. Something false was named in "
        f"{false['right']} of {false['of']}.</p>",
        '<div class="pair">' + "".join(_figure(limit["axes"][name]) for name in limit["axes"]) + "</div>",
        _limits(limit["axes"]),
        '<p class="soft">By effect: how many were named, and where there are cases enough the limits, in sizes over the '
        "small one.</p>",
        _effects(limit["effects"]),
    ]
    return "\n".join(parts)


def _figure(axis: Mapping[str, Any]) -> str:
    caption = (
        f"Share named over the {axis['text']}: diagnosis and oracle, in bins with 95 % intervals (Wilson), and the "
        "likeliest logistic curves. Dotted: nine times in ten; ticks below: the limits."
    )
    return f"<figure>{_draw(axis)}<figcaption>{escape(caption)}</figcaption></figure>"


@styled
def _draw(axis: Mapping[str, Any]) -> str:
    figure = new_figure(4.0, 5.2)
    axes = figure.subplots()
    axes.axhline(_NEEDED, color=GREY, linewidth=0.8, linestyle=":")
    for number, (who, color) in enumerate(_WHO.items()):
        _draw_bins(axes, axis["bins"], who, color)
        _draw_curve(axes, axis[who], color)
        name_line(axes, 0.02, 0.96 - 0.06 * number, who, color, transform=axes.transAxes)
    axes.set(xscale="log", ylim=(0, 1.03), xlabel=axis["text"], ylabel="share named")
    ticks = _ticks([edge for entry in axis["bins"] for edge in (entry["low"], entry["high"])])
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    return inline_svg(figure)


def _draw_bins(axes: Any, bins: Sequence[Mapping[str, Any]], who: str, color: str) -> None:
    for entry in bins:
        if entry[who]["of"]:
            x = (entry["low"] * entry["high"]) ** 0.5 * _BESIDE[who]
            axes.plot([x, x], entry[who]["ci95"], color=color, linewidth=1.2)
            axes.plot([x], [entry[who]["share"]], "o", color=color, markersize=5)


def _draw_curve(axes: Any, curve: Mapping[str, Any], color: str) -> None:
    if curve["slope"] is None:
        return
    x = np.geomspace(curve["low"], curve["high"], 200)
    # P = 1/(1 + exp(−slope·ln(x/middle))), written so that nothing overflows.
    share = 0.5 * (1.0 + np.tanh(0.5 * curve["slope"] * (np.log(x) - np.log(curve["middle"]))))
    axes.plot(x, share, color=color, linewidth=1.6)
    if curve["limit"] is not None:
        axes.plot([curve["limit"]] * 2, [0.0, 0.06], color=color, linewidth=2.0)


def _ticks(edges: Sequence[float]) -> list[float]:
    """Powers of two within the edges."""
    if not edges:
        return []
    low, high = np.log2(min(edges)), np.log2(max(edges))
    return [float(2.0**power) for power in range(int(np.ceil(low - 1e-9)), int(np.floor(high + 1e-9)) + 1)]


def _limits(axes: Mapping[str, Mapping[str, Any]]) -> str:
    rows = []
    for axis in axes.values():
        for who in _WHO:
            curve = axis[who]
            named = f"{curve['named']} of {curve['cases']}"
            rows.append((axis["text"], who, named, *_limit_cells(curve["limit"], curve["limit_ci95"], curve["reason"])))
        ratio = ratio_text(axis)
        rows.append((axis["text"], "ratio", "", ratio, span_text(axis["ratio_ci95"]), ""))
    head = ("axis", "", "named", "nine in ten from", "95 % interval", "")
    return plain_table(head, rows, (2, 3, 4))


def _limit_cells(limit: float | None, ci95: Sequence[float | None] | None, reason: str) -> tuple[str, str, str]:
    return ("–" if limit is None else f"{limit:.2f}", span_text(ci95), reason)


def _effects(rows: Sequence[Mapping[str, Any]]) -> str:
    def number(value: float | None) -> str:
        return "–" if value is None else f"{value:.2f}"

    cells = (
        (
            row["effect"],
            *(f"{row[who]} of {row['cases']}" for who in ("named", "oracle")),
            number(row["limit"]),
            number(row["oracle_limit"]),
            number(row["ratio"]),
        )
        for row in rows
    )
    head = ("effect", "named", "by the oracle", "limit", "the oracle's", "ratio")
    return plain_table(head, cells, (1, 2, 3, 4, 5))
