"""Figure of a diagnosis: the gap, what each cause closes of it, and what is left."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hqpipe.errors import UsageError
from hqpipe.report.diagnosis_charts import AFTER, BEFORE, CLOSED
from hqpipe.report.diagnosis_words import joints_text, percent, size_text, sizes, words
from hqpipe.report.style import INK, new_figure, plain, save_figure, styled

_ROW = 0.36  # inch


@styled
def gap_steps(content: Mapping[str, Any], path: Path) -> Path:
    """The free-running error before, the step that each cause brings it down by with its interval, and after.

    Args:
        content: of diagnosis.json. path: .png or .svg.

    Raises:
        UsageError: the diagnosis has no gap.
    """
    gap, causes = content["gap"], content["causes"]
    if gap is None:
        raise UsageError("nothing to draw: the diagnosis has no gap")
    size = sizes(gap)
    before = size["before"]
    figure = new_figure(0.9 + _ROW * (len(causes) + 2))
    axes = figure.subplots()
    names = ["before" if causes else "gap"]
    axes.barh(0, before, color=BEFORE, height=0.62)
    level, ends = before, [(before, size_text(gap, "before"))]
    for row, cause in enumerate(causes, start=1):
        step, (low, high) = cause["shrink"] * before, cause["shrink_ci95"]
        axes.barh(row, step, left=level - step, color=CLOSED, height=0.62)
        level -= step
        error = [[max(0.0, high * before - step)], [max(0.0, step - low * before)]]
        axes.errorbar(level, row, xerr=error, color=INK, capsize=2.5, elinewidth=1.0)
        ends.append((level + step, percent(-cause["shrink"])))
        names.append(f"{words(cause['effect'])} ({plain(joints_text(cause['joints'], content['logs']['joints']))})")
    if causes:
        axes.barh(len(names), size["after"], color=AFTER, height=0.62)
        ends.append((size["after"], size_text(gap, "after")))
        names.append("after")
    for row, (end, text) in enumerate(ends):
        axes.annotate(text, (end, row), (5, 0), textcoords="offset points", va="center", fontsize=8.5)
    axes.axvline(size["noise_floor"], color=INK, linewidth=0.9, linestyle=(0, (1, 1.5)))
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.12 * max([size["noise_floor"], *(end for end, _ in ends)]))
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("free-running error over the joints' spread; dotted: noise floor")
    return save_figure(figure, path)
