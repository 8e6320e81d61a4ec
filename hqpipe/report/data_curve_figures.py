"""Held-out error against seconds of fit data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path

from hqpipe.errors import UsageError
from hqpipe.report.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    name_line,
    new_figure,
    save_figure,
    styled,
)

_COLOURS = (VERMILION, BLUE, GREEN, PURPLE, ORANGE, SKY, BLACK, GREY)
_MARKERS = "osD^v<>P"
_LINES = ("-", (0, (3, 2)))  # the second once all colours are taken
_ROOM = 4.0  # times persistence: errors beyond are not followed


@styled
def data_curve_chart(
    curves: Mapping[str, Sequence[tuple[float, float | None]]], persistence: float, noise_floor: float, path: Path
) -> Path:
    """One line per model on logarithmic axes, between persistence and the noise floor.

    Args:
        curves: model → (seconds of fit data, free-running RMSE in N·m or None where the fit refused).
        persistence, noise_floor: N·m.
        path: .png or .svg.
    """
    drawn = {name: [(x, y) for x, y in points if y is not None and isfinite(y)] for name, points in curves.items()}
    seconds = sorted({x for points in drawn.values() for x, _ in points})
    if not seconds:
        raise UsageError("nothing to draw: no model could be fitted")
    figure = new_figure(3.6)
    axes = figure.subplots()
    for index, (name, points) in enumerate(drawn.items()):
        if points:
            colour, marker = _COLOURS[index % len(_COLOURS)], _MARKERS[index % len(_MARKERS)]
            style = _LINES[index // len(_COLOURS) % len(_LINES)]
            axes.plot(
                *zip(*points, strict=True), color=colour, marker=marker, linestyle=style, markersize=4.5, label=name
            )
    axes.set_xscale("log")
    axes.set_yscale("log")
    lowest = min(noise_floor, *(y for points in drawn.values() for _, y in points))
    axes.set_ylim(0.7 * lowest, _ROOM * persistence)
    for level, text, style in ((persistence, "persistence", (0, (4, 2))), (noise_floor, "noise floor", (0, (1, 1.5)))):
        axes.axhline(level, color=INK, linewidth=0.9, linestyle=style)
        name_line(
            axes, (seconds[0] * seconds[min(1, len(seconds) - 1)]) ** 0.5, level, text, INK, va="bottom", ha="center"
        )
    axes.set_xticks(seconds, [f"{x:.3g}" for x in seconds])
    axes.minorticks_off()
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_xlabel("fit data (s)")
    axes.set_ylabel("held-out free-running RMSE (N·m)")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return save_figure(figure, path)
