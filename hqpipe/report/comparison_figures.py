"""Figures of the comparison table: errors of every model, and how they carry over to stress trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from hqpipe.errors import UsageError
from hqpipe.report.style import GREY, INK, VERMILION, new_figure, save_figure, styled

_PANELS = (
    ("one step ahead", "RMSE (N·m)", "one_step", "rmse"),
    ("free-running", "RMSE (N·m)", "free_run", "rmse"),
    ("free-running, loaded joints", "mean absolute error (%)", "free_run", "loaded_mape"),
)
_BEYOND = 2.0  # times persistence: longer bars are cut there and bear their number
_WORST = 4.0  # the colours of the stress figure span 1/4 … 4 times the error of persistence
_HALO = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.75}

Rows = Sequence[Mapping[str, Any]]


def _pooled(rows: Rows, logs: str) -> dict[str, Mapping[str, Any]]:
    """Model → its row over all joints and trials, the smallest free-running error first."""
    found = [row for row in rows if row["logs"] == logs and row["joint"] == row["trial"] == "all"]
    return {row["model"]: row for row in sorted(found, key=lambda row: row["free_run"]["rmse"])}


@styled
def comparison_bars(rows: Rows, baselines: Sequence[str], path: Path, persistence: str = "persistence") -> Path:
    """Held-out errors of every model as bars, the best on top; noise floor and persistence as lines.

    Args:
        rows: `ScoreRow` as mappings. baselines: names of the models that nobody would use.
        path: .png or .svg. persistence: its name among the models.
    """
    pooled = _pooled(rows, "held-out")
    if not pooled:
        raise UsageError("nothing to draw: no row over all held-out trials")
    figure = new_figure(0.9 + 0.28 * len(pooled))
    axes = figure.subplots(1, len(_PANELS), sharey=True)
    for panel, (title, label, horizon, measure) in zip(axes, _PANELS, strict=True):
        values = [row[horizon][measure] for row in pooled.values()]
        reference = pooled[persistence][horizon][measure]
        _bars(panel, values, [GREY if name in baselines else VERMILION for name in pooled], reference)
        panel.set_title(title)
        panel.set_xlabel(label)
        if measure == "rmse":
            floor = pooled[persistence]["noise_floor"]
            panel.axvline(floor, color=INK, linewidth=0.9, linestyle=(0, (1, 1.5)))
    axes[0].set_yticks(range(len(pooled)), list(pooled))
    axes[0].invert_yaxis()
    figure.supxlabel("dashed: persistence   dotted: noise floor of the torque sensor", fontsize=8.0, color=GREY)
    return save_figure(figure, path)


def _bars(panel: Axes, values: Sequence[float | None], colours: Sequence[str], reference: float | None) -> None:
    known = [value for value in values if value is not None and isfinite(value)]
    limit = max([value for value in known if reference is None or value <= _BEYOND * reference], default=1.0)
    for row, (value, colour) in enumerate(zip(values, colours, strict=True)):
        if value is None:
            continue
        panel.barh(row, min(value, 1.2 * limit), color=colour, height=0.66)
        text = f"{value:.3g}" if isfinite(value) else "diverged"
        if value > limit:
            panel.text(1.19 * limit, row, f"{text} →", va="center", ha="right", fontsize=8.0, color="white", zorder=3)
        else:
            panel.text(value + 0.02 * limit, row, text, va="center", fontsize=8.0, bbox=_HALO)
    if reference is not None:
        panel.axvline(reference, color=INK, linewidth=0.9, linestyle=(0, (4, 2)), zorder=0.5)
    panel.set_xlim(0.0, 1.2 * limit)
    panel.grid(axis="y", visible=False)
    panel.tick_params(axis="y", length=0)


@styled
def stress_chart(rows: Rows, path: Path, persistence: str = "persistence") -> Path:
    """Free-running RMSE of every model on the held-out trials, on all stress trials, and on each; blue beats persistence.

    Args:
        rows: `ScoreRow` as mappings, of held-out and stress trials. path: .png or .svg.
        persistence: its name among the models.
    """
    models = list(_pooled(rows, "held-out"))
    whole = [row for row in rows if row["joint"] == "all"]
    trials = list(dict.fromkeys(row["trial"] for row in whole if row["logs"] == "stress" and row["trial"] != "all"))
    columns = [("held-out", "all"), ("stress", "all"), *(("stress", trial) for trial in trials)]
    table = {(row["logs"], row["trial"], row["model"]): row["free_run"]["rmse"] for row in whole}
    if ("stress", "all", persistence) not in table:
        raise UsageError("nothing to draw: no row of stress trials")
    errors = np.array([[table[(*column, model)] for column in columns] for model in models])
    ratio = errors / errors[models.index(persistence)]
    figure = new_figure(0.8 + 0.3 * len(models))
    axes = figure.subplots()
    shade = np.clip(np.log(ratio), -np.log(_WORST), np.log(_WORST))
    axes.imshow(shade, cmap="RdBu_r", vmin=-np.log(_WORST), vmax=np.log(_WORST), aspect="auto")
    for i, j in np.ndindex(*errors.shape):
        text = f"{errors[i, j]:.3g}" if isfinite(errors[i, j]) else "diverged"
        colour = "white" if abs(shade[i, j]) > 0.55 * np.log(_WORST) else INK
        axes.text(j, i, text, ha="center", va="center", fontsize=8.5, color=colour)
    names = ["held-out", "all stress", *(trial.rsplit(".", 1)[0] for trial in trials)]
    axes.set_xticks(range(len(columns)), names)
    axes.set_yticks(range(len(models)), models)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.grid(visible=False)
    axes.axvline(0.5, color="white", linewidth=5.0)
    axes.axvline(1.5, color="white", linewidth=2.5)
    axes.spines[:].set_visible(False)
    figure.supxlabel("free-running RMSE (N·m); blue is better than persistence, red is worse", fontsize=8.0, color=GREY)
    return save_figure(figure, path)
