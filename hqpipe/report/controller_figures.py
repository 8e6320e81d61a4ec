"""Figures of the comparison of controllers: their rewards in training, and what they did on the plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from hqpipe.errors import UsageError
from hqpipe.report.style import (
    BLUE,
    FAINT,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    new_figure,
    save_figure,
    styled,
    title_row,
)
from hqpipe.report.training_figures import STEPS, read_metrics, unit_of_steps

REWARD, ERROR = "rollout/reward_mean", "eval/velocity_error"
# column of the metrics → what the axis says
CURVES = {REWARD: "mean reward per step in training", ERROR: "mean speed error in evaluations (m/s)"}
_COLOURS = (ORANGE, SKY, VERMILION, BLUE, INK, GREEN, PURPLE, GREY)
# measure → what the axis says, and the factor into that unit
PANELS = {
    "falls": ("walks that fell (%)", 100.0),
    "velocity_error": ("error of the mean velocity (m/s)", 1.0),
    "yaw_error": ("error of the turning rate (rad/s)", 1.0),
    "drift": ("drift from the course (m)", 1.0),
    "foot_clearance": ("foot clearance (cm)", 100.0),
    "peak_force": ("hardest impact of a foot (weights)", 1.0),
    "tracking_rmse": ("error of the joint targets (mrad)", 1000.0),
    "torque_rmse": ("error of the torque targets (N·m)", 1.0),
    "torque_saturation": ("joint samples at the torque limit (%)", 100.0),
}
_SLOT = 0.8  # of a scenario's width is taken by its dots

Cells = Sequence[Mapping[str, Any]]


@styled
def learning_curves(runs: Mapping[str, Sequence[Path]], path: Path) -> Path:
    """Mean reward per step, and mean speed error of the evaluations, over environment steps: a colour per controller, a thin
    line per seed, and where there are several a thick one for their mean.

    Args:
        runs: title → metrics CSV of every seed, none where a training had no iteration. path: .png or .svg.

    Raises:
        UsageError: there is no run.
    """
    if not any(runs.values()):
        raise UsageError("nothing to draw: no training has a metrics table")
    tables = {title: [read_metrics(file) for file in files] for title, files in runs.items()}
    last = max(float(table[STEPS][-1]) for each in tables.values() for table in each)
    unit, name_of_unit = unit_of_steps(last)
    columns = [name for name in CURVES if any(_has(table, name) for each in tables.values() for table in each)]
    figure = new_figure(3.4)
    panels = figure.subplots(1, len(columns), squeeze=False)[0]
    colours = dict(zip(runs, _COLOURS, strict=False))
    for axes, column in zip(panels, columns, strict=True):
        for title, each in tables.items():
            curves = [(t[STEPS], t[column]) for t in each if _has(t, column)]
            curves = [(steps[np.isfinite(y)] / unit, y[np.isfinite(y)]) for steps, y in curves]
            _curves(axes, curves, colours[title], marked=column == ERROR)
        axes.set_title(CURVES[column], fontweight="normal")
        axes.set_xlim(0.0, last / unit)
        if column == ERROR:
            axes.set_ylim(bottom=0.0)
        axes.set_xlabel(f"environment steps ({name_of_unit})")
    title_row(figure, list(colours.items()))
    return save_figure(figure, path)


def _has(table: Mapping[str, np.ndarray], column: str) -> bool:
    return column in table and bool(np.isfinite(table[column]).any())


def _curves(axes: Axes, curves: Sequence[tuple[np.ndarray, np.ndarray]], colour: str, marked: bool) -> None:
    """Curves of one controller, a seed each; their mean ends where the first of them does. marked: whether points are shown."""
    several = len(curves) > 1
    thin, thick = (0.6 if several else 1.3), 1.8
    look: dict[str, Any] = {"color": colour, "clip_on": False}
    for x, y in curves:
        dot = 2.0 if marked or len(x) == 1 else 0.0
        axes.plot(x, y, linewidth=thin, alpha=0.55 if several else 1.0, marker="o", markersize=dot, **look)
    if several:
        shortest = min((x for x, _ in curves), key=len)
        mean = np.mean([y[: len(shortest)] for _, y in curves], axis=0)
        axes.plot(
            shortest, mean, linewidth=thick, marker="o", markersize=3.5 if marked or len(shortest) == 1 else 0.0, **look
        )


@styled
def plant_panels(cells: Cells, titles: Mapping[str, str], path: Path) -> Path:
    """One panel per measure, a dot per controller and scenario: filled the policy, hollow its gait prior alone.

    Args:
        cells: controller, actor (policy or zero_action), scenario, walks, falls (counts) and the mean of every measure over
            the walks that did not fall, None where all did or none tells it.
        titles: controller → what it is called. path: .png or .svg.

    Raises:
        UsageError: nothing walked.
    """
    if not cells:
        raise UsageError("nothing to draw: no controller walked")
    scenarios = list(dict.fromkeys(cell["scenario"] for cell in cells))
    shown = [
        name for name in PANELS if name == "falls" or any(_value(cell, name) for cell in cells)
    ]  # some value above 0
    across = 3 if len(scenarios) < 3 else 2 if len(scenarios) < 6 else 1
    depth = -(-len(shown) // across)
    figure = new_figure(0.5 + 1.55 * depth)
    figure.get_layout_engine().set(h_pad=0.08)
    panels = figure.subplots(depth, across, squeeze=False, sharex=True)
    for axes in panels.flat[len(shown) :]:
        axes.set_visible(False)
    colours = dict(zip(titles, _COLOURS, strict=False))
    for axes, name in zip(panels.flat, shown, strict=False):
        _panel(axes, name, cells, scenarios, colours)
    figure.supxlabel(
        "filled: policy   hollow: its gait prior alone   ×: every walk fell, so that there is nothing to measure",
        fontsize=8.0,
        color=GREY,
    )
    title_row(figure, [(titles[name], colour) for name, colour in colours.items()])
    return save_figure(figure, path)


def _panel(axes: Axes, name: str, cells: Cells, scenarios: Sequence[str], colours: Mapping[str, str]) -> None:
    place = {controller: _SLOT * ((i + 0.5) / len(colours) - 0.5) for i, controller in enumerate(colours)}
    for cell in cells:
        x, colour = scenarios.index(cell["scenario"]) + place[cell["controller"]], colours[cell["controller"]]
        value, policy = _value(cell, name), cell["actor"] == "policy"
        if value is not None:
            inside, size, order = (colour, 5.0, 3) if policy else ("none", 7.5, 2)
            axes.plot(x, value, "o", color=colour, markerfacecolor=inside, markersize=size, zorder=order, clip_on=False)
        elif policy and cell["falls"] == cell["walks"]:
            axes.plot(x, 0.06, "x", markersize=5.0, color=colour, transform=axes.get_xaxis_transform(), zorder=3)
    for edge in range(len(scenarios) - 1):
        axes.axvline(edge + 0.5, color=FAINT, linewidth=0.7)
    axes.set_title(PANELS[name][0], fontweight="normal")
    axes.set_xticks(range(len(scenarios)), scenarios)
    axes.set_xlim(-0.5, len(scenarios) - 0.5)
    axes.set_ylim(0.0, 105.0 if name == "falls" else max(1.15 * axes.get_ylim()[1], 1e-9))
    axes.grid(axis="x", visible=False)
    axes.tick_params(axis="x", length=0, pad=7.0, labelbottom=True)  # below the dots at zero


def _value(cell: Mapping[str, Any], name: str) -> float | None:
    """In the unit of its panel."""
    value = cell["falls"] / cell["walks"] if name == "falls" else cell[name]
    return None if value is None else PANELS[name][1] * value
