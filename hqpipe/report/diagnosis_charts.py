"""Charts of a diagnosis as plotly.js figures: plain ``{"data": …, "layout": …}`` that a page holds as JSON."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hqpipe.report.diagnosis_read import Trace
from hqpipe.report.diagnosis_words import joints_text, percent, percent_text, run_words, size_text, sizes, words
from hqpipe.report.style import BLUE, FAINT, GREY, INK, SKY, VERMILION

BEFORE, AFTER, MEASURED, CLOSED, COMMAND = VERMILION, BLUE, INK, SKY, GREY
ROW_PX, FRAME_PX, TRACE_PX = 46, 96, 270
_FAR = 1.7  # the line of persistence is drawn up to this many times the longest bar; further out it would dwarf them
_ROUNDING = 0.005  # a part of the gap below this that no cause carries is rounding
_ALIKE = 1e-9
_LABEL = 26  # characters of a place beside a bar: what a phone has room for
_DIGITS = 5  # significant ones, more than a pixel shows
_FONT = {"family": "system-ui, -apple-system, Segoe UI, Roboto, sans-serif", "size": 13, "color": INK}
# control mode → the series beneath the outputs, and their unit where the output is a torque or a force
_INPUTS = {"position": ("command", "position"), "torque": ("position",), "valve": ("command",)}
_MOTION_UNITS = {"N·m": "rad", "N": "m"}

Figure = dict[str, Any]


def waterfall(content: Mapping[str, Any]) -> Figure:
    """The gap before, what each cause closes with its interval, the gap after, and the noise floor, over the joints' spread.

    The causes' shares add up to the shrink of the gap, so that the steps lead from the first bar to the last;
    what does not add up is a step of its own.

    Args:
        content: of diagnosis.json, with a gap.
    """
    size, steps = sizes(content["gap"]), _steps(content)
    top = max([size["noise_floor"], *(max(step.start, step.end + step.up) for step in steps)]) or 1.0
    lines = [(size["noise_floor"], "noise floor", "dot")]
    if size["persistence"] <= _FAR * top:
        lines.append((size["persistence"], "holding the last value", "dash"))
    far = 1.04 * max([top, *(at for at, _, _ in lines)])
    bars = {
        "type": "bar",
        "orientation": "h",
        "y": list(range(len(steps))),
        "base": [min(step.start, step.end) for step in steps],
        "x": [abs(step.end - step.start) for step in steps],
        "marker": {"color": [step.color for step in steps], "line": {"width": 0}},
        "width": 0.62,
        "hovertext": [step.hint for step in steps],
        "hoverinfo": "text",
    }
    names = {"tickvals": list(range(len(steps))), "ticktext": [step.label for step in steps], "automargin": True}
    layout = _layout(FRAME_PX + ROW_PX * len(steps)) | {
        "xaxis": _axis(f"error of {run_words(content['gap'], 2)} over the joints' spread")
        | {"range": [0, far], "fixedrange": True, "tickformat": ".2~%"},
        "yaxis": _axis("") | names | {"range": [len(steps) - 0.5, -0.5], "fixedrange": True, "showgrid": False},
        "shapes": [_line(at, dash) for at, _, dash in lines],
        "annotations": [_line_label(at, text, far, row) for row, (at, text, _) in enumerate(lines)],
        "margin": {"l": 8, "r": 8, "t": 44, "b": 44},
    }
    return {"data": [bars, _whiskers(steps)], "layout": layout}


@dataclass(frozen=True)
class _Step:
    """A bar of the waterfall.

    Attributes:
        label, hint: HTML beside it and under the pointer.
        start, end: over the joints' spread.
        down, up: from the end to the limits of its interval, for a cause.
    """

    label: str
    hint: str
    start: float
    end: float
    color: str
    down: float = 0.0
    up: float = 0.0
    is_cause: bool = False


def _steps(content: Mapping[str, Any]) -> list[_Step]:
    """The bars from top to bottom."""
    gap, found = content["gap"], content["causes"]
    size = sizes(gap)
    level = size["before"]
    steps = [_plain("before" if found else "gap", 0.0, level, BEFORE, _in_unit(gap, "before"))]
    for cause in found:
        steps.append(_closed(cause, level, size["before"], content["logs"]["joints"]))
        level = steps[-1].end
    if found:
        if abs(level - size["after"]) > _ROUNDING * size["before"]:
            steps.append(_plain("not shared out", level, size["after"], GREY))
        steps.append(_plain("after", 0.0, size["after"], AFTER, _in_unit(gap, "after")))
    return steps


def _in_unit(gap: Mapping[str, Any], name: str) -> str:
    """The same size in the joints' unit, behind a comma; empty where they have none in common."""
    return f", {html.escape(size_text(gap, name))}" if gap["unit"] is not None else ""


def _plain(name: str, start: float, end: float, color: str, more: str = "") -> _Step:
    text = f"{percent_text(end - start)}{more}"
    return _Step(f"{name}<br><b>{text}</b>", text, start, end, color)


def _closed(cause: Mapping[str, Any], level: float, before: float, machine: Sequence[str]) -> _Step:
    """What a cause takes away from `level`."""
    (low, high), share = cause["shrink_ci95"], cause["shrink"]
    place = joints_text(cause["joints"], machine)
    place = place if len(place) <= _LABEL else f"{place[: _LABEL - 1]}…"
    change = f"{'+' if share < 0 else ''}{percent(-share)}"
    hint = f"closes {percent(share)} of the gap ({percent(low)} … {percent(high)})"
    return _Step(
        f"{html.escape(words(cause['effect']))} <b>{change}</b><br><i>{html.escape(place)}</i>",
        html.escape(hint),
        level,
        level - share * before,
        CLOSED,
        down=max(0.0, (high - share) * before),
        up=max(0.0, (share - low) * before),
        is_cause=True,
    )


def _whiskers(steps: Sequence[_Step]) -> Figure:
    """The intervals of the causes, at the ends of their bars."""
    causes = [(y, step) for y, step in enumerate(steps) if step.is_cause]
    return {
        "type": "scatter",
        "mode": "markers",
        "y": [y for y, _ in causes],
        "x": [step.end for _, step in causes],
        "marker": {"size": 1, "color": INK},
        "error_x": {
            "type": "data",
            "symmetric": False,
            "array": [step.up for _, step in causes],
            "arrayminus": [step.down for _, step in causes],
            "color": INK,
            "thickness": 1.4,
            "width": 5,
        },
        "hoverinfo": "skip",
    }


def _line_label(at: float, text: str, far: float, row: int) -> Figure:
    """Above the chart at a reference line; a row of its own for each, for on a phone they would run together."""
    return {
        "x": at,
        "xref": "x",
        "xanchor": "left" if at < 0.5 * far else "right",
        "y": 1.0,
        "yref": "paper",
        "yanchor": "bottom",
        "yshift": 16 * row,
        "text": text,
        "showarrow": False,
        "font": _FONT | {"size": 12, "color": "#555555"},
    }


def trace_chart(trace: Trace, control_mode: str | None) -> Figure:
    """Measured output against the model before and after, above what drove it; restarts as faint lines.

    Args:
        trace: one joint's stretch.
        control_mode: position, torque or valve; says what the command is compared with. None counts as position.
    """
    mode, unit = control_mode or "position", trace.unit
    upper = [("measured", MEASURED, 2.0, "solid"), ("before", BEFORE, 1.4, "solid")]
    if has_after(trace):
        upper.append(("after", AFTER, 1.4, "solid"))
    moves = unit in _MOTION_UNITS.values()  # the output is the position itself, and the command beside it
    if mode == "torque" or moves:
        upper.append(("command", COMMAND, 1.2, "dot"))
    styles = {"command": (INK, 1.2, "dot"), "position": (GREY, 1.4, "solid")}
    lower = [] if moves else [(name, *styles[name]) for name in _INPUTS[mode] if name in trace.series]
    data = [_curve(trace, *style, axis="y", unit=unit) for style in upper if style[0] in trace.series]
    data += [_curve(trace, *style, axis="y2", unit="") for style in lower]
    layout = _layout(TRACE_PX) | {
        "xaxis": _axis("time (s)") | {"anchor": "y2" if lower else "y", "showgrid": False},
        "yaxis": _axis(html.escape(unit)) | {"domain": [0.36 if lower else 0.0, 1.0], "nticks": 5},
        "shapes": [_line(at, "solid") | {"line": {"color": FAINT, "width": 1}} for at in trace.restarts],
        "margin": {"l": 56, "r": 8, "t": 6, "b": 40},
        "hovermode": "x unified",
    }
    if lower:
        title = _MOTION_UNITS.get(unit, "") if mode != "valve" else "valve"
        layout["yaxis2"] = _axis(title) | {"domain": [0.0, 0.26], "nticks": 3}
    return {"data": data, "layout": layout}


def has_after(trace: Trace) -> bool:
    """Whether the model with the found effects says something else than the base model."""
    after = trace.series.get("after")
    return after is not None and any(
        a is not None and b is not None and not math.isclose(a, b, rel_tol=_ALIKE, abs_tol=_ALIKE)
        for a, b in zip(after, trace.series["before"], strict=True)
    )


def rmse(trace: Trace, name: str) -> float | None:
    """Root of the mean squared difference between a series and what was measured, over the stretch."""
    pairs = zip(trace.series[name], trace.series["measured"], strict=True)
    squares = [(a - b) ** 2 for a, b in pairs if a is not None and b is not None]
    return math.sqrt(sum(squares) / len(squares)) if squares else None


def _curve(trace: Trace, name: str, color: str, width: float, dash: str, *, axis: str, unit: str) -> Figure:
    return {
        "type": "scatter",
        "mode": "lines",
        "name": {"before": "model before", "after": "model after"}.get(name, name),
        "x": _short(trace.time),
        "y": _short(trace.series[name]),
        "yaxis": axis,
        "line": {"color": color, "width": width, "dash": dash},
        "hovertemplate": "%{y:.4g} " + html.escape(unit) + "<extra>%{fullData.name}</extra>",
    }


def _short(values: Sequence[float | None]) -> list[float | None]:
    """Numbers with the digits that a chart shows; what is not finite is a gap in the line."""
    return [None if v is None or not math.isfinite(v) else float(f"{v:.{_DIGITS + 1}g}") for v in values]


def _layout(height: int) -> Figure:
    return {
        "height": height,
        "autosize": True,
        "showlegend": False,
        "font": _FONT,
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "dragmode": False,
        "hoverlabel": {"bgcolor": "white", "font": _FONT | {"size": 12}},
    }


def _axis(title: str) -> Figure:
    return {
        "title": {"text": title, "font": _FONT | {"size": 12, "color": "#555555"}, "standoff": 6},
        "gridcolor": "#ECECEC",
        "zeroline": False,
        "linecolor": GREY,
        "tickfont": _FONT | {"size": 12},
    }


def _line(at: float, dash: str) -> Figure:
    """An upright line at `at` through the whole chart; behind the curves if it is solid."""
    return {
        "type": "line",
        "x0": at,
        "x1": at,
        "y0": 0,
        "y1": 1,
        "yref": "paper",
        "layer": "below" if dash == "solid" else "above",
        "line": {"color": "#555555", "width": 1.2, "dash": dash},
    }
