"""Figure of a training: what its metrics CSV holds, by environment step."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hqpipe.errors import UsageError
from hqpipe.report.style import BLUE, GREEN, ORANGE, VERMILION, name_line, new_figure, save_figure, styled

STEPS = "time/total_timesteps"
# column → what the axis says; the key names are those of Stable-Baselines3 where it has them
PANELS = {
    "rollout/reward_mean": "mean reward per step",
    "rollout/ep_len_mean": "episode length (steps)",
    "eval/speed": "forward speed, evaluation (m/s)",
    "rollout/falls": "falls per iteration",
    "train/approx_kl": "approximate KL divergence",
    "train/std": "exploration (action std)",
}
COUNTS = ("rollout/falls", "rollout/ep_len_mean")
_COLORS = (VERMILION, BLUE, GREEN, ORANGE)


def read_metrics(path: Path) -> dict[str, np.ndarray]:
    """Columns of a metrics CSV as float64; empty cells are NaN.

    Raises:
        UsageError: there is no row, or no column of environment steps.
    """
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    if not rows or STEPS not in rows[0]:
        raise UsageError(f"{path}: expected rows with a column '{STEPS}'")
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0]}


@styled
def training_curves(metrics: Mapping[str, Path], path: Path) -> Path:
    """Reward, episode length, evaluated speed and more over environment steps.

    Args:
        metrics: name of a run → its metrics CSV, four at most.
        path: .png or .svg.

    Raises:
        UsageError: a file holds none of the known columns.
    """
    runs = {name: read_metrics(file) for name, file in metrics.items()}
    panels = [key for key in PANELS if any(_has(run, key) for run in runs.values())]
    if not panels:
        raise UsageError(f"none of the columns {', '.join(PANELS)} in {', '.join(map(str, metrics.values()))}")
    unit, name_of_unit = unit_of_steps(_last_step(runs))
    depth = -(-len(panels) // 3)
    figure = new_figure(0.35 + 2.0 * depth)
    axes_of = figure.subplots(depth, 3, sharex=True, squeeze=False)
    for axes in axes_of.flat[len(panels) :]:
        axes.set_visible(False)
    for index, (axes, key) in enumerate(zip(axes_of.flat, panels, strict=False)):
        for (name, run), color in zip(runs.items(), _COLORS, strict=False):
            if not _has(run, key):
                continue
            known = np.isfinite(run[key])
            x, y = run[STEPS][known] / unit, run[key][known]
            marker = "o" if key.startswith("eval/") else None
            axes.plot(x, y, color=color, marker=marker, markersize=3, clip_on=False)
            if index == 0 and len(runs) > 1:
                name_line(axes, x[-1], y[-1], name, color, ha="right", va="bottom")
        axes.set_title(PANELS[key], fontweight="normal")
        axes.set_xlim(0.0, _last_step(runs) / unit)
        if key in COUNTS:
            axes.set_ylim(0.0, max(1.0, axes.get_ylim()[1]))
        axes.tick_params(labelbottom=True)
        if index >= len(panels) - 3:
            axes.set_xlabel(f"environment steps ({name_of_unit})")
    return save_figure(figure, path)


def unit_of_steps(last: float) -> tuple[float, str]:
    """What an axis up to `last` environment steps is divided by, and its name."""
    return (1e6, "million") if last > 2e5 else (1e3, "thousand")


def _last_step(runs: Mapping[str, dict[str, np.ndarray]]) -> float:
    return max(float(run[STEPS].max()) for run in runs.values())


def _has(run: Mapping[str, np.ndarray], key: str) -> bool:
    return key in run and bool(np.isfinite(run[key]).any())
