"""Figure of a fitted actuator: measured torque, one step ahead and free-running, typical and worst."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hqpipe.errors import UsageError
from hqpipe.report.style import FAINT, MEASURED, MODEL, ONE_STEP, new_figure, plain, save_figure, styled, title_row

_CONTEXT = 2  # windows shown on each side of the one that is picked
_NAMES = [("measured", MEASURED), ("one step ahead", ONE_STEP), ("free-running, restarted every window", MODEL)]


@dataclass(frozen=True, eq=False)
class PredictedTrial:
    """A held-out trial and what a model makes of it.

    Attributes:
        time: (T,) s. measured, one_step, free_run: (T, J) N·m.
        joints: J names. window_s: length of the free-running windows, s.
    """

    time: np.ndarray
    measured: np.ndarray
    one_step: np.ndarray
    free_run: np.ndarray
    joints: Sequence[str]
    window_s: float = 0.1

    @property
    def steps(self) -> int:
        """Samples per window."""
        return max(1, round(self.window_s / float(np.median(np.diff(self.time)))))

    def windows(self, j: int) -> dict[str, int]:
        """Numbers of the median and the worst window of joint `j`."""
        return typical_and_worst(self.measured[:, j] - self.free_run[:, j], self.steps)


@styled
def actuator_fit(trial: PredictedTrial, path: Path) -> Path:
    """Median and worst window of the first three joints, a leg as in the paper; `path`: .png or .svg."""
    shown = trial.joints[:3]
    figure = new_figure(0.6 + 1.75 * len(shown))
    panels = figure.subplots(len(shown), 2, squeeze=False)
    for j, (joint, row) in enumerate(zip(shown, panels, strict=True)):
        for axes, (kind, window) in zip(row, trial.windows(j).items(), strict=True):
            _draw(axes, trial, j, window, f"{plain(joint)}, {kind} window")
    return _finished(figure, panels, path)


@styled
def worst_windows(trial: PredictedTrial, path: Path) -> Path:
    """The worst window of every joint, three in a row where that comes out even; `path`: .png or .svg."""
    across = next(n for n in (3, 2, 1) if len(trial.joints) % n == 0)
    down = len(trial.joints) // across
    figure = new_figure(0.6 + 1.6 * down)
    panels = figure.subplots(down, across, squeeze=False)
    for j, (joint, axes) in enumerate(zip(trial.joints, panels.flat, strict=True)):
        _draw(axes, trial, j, trial.windows(j)["worst"], plain(joint))
    return _finished(figure, panels, path)


def _draw(axes: Axes, trial: PredictedTrial, j: int, window: int, title: str) -> None:
    """One window of one joint with what is round it."""
    time, steps, end = trial.time, trial.steps, len(trial.time)
    part = slice(max(0, (window - _CONTEXT) * steps), min(end, (window + 1 + _CONTEXT) * steps + 1))
    first, last = window * steps, min((window + 1) * steps, end - 1)
    axes.axvspan(time[first], time[last], color=FAINT, alpha=0.45, linewidth=0)
    axes.plot(time[part], trial.measured[part, j], color=MEASURED, linewidth=1.8)
    axes.plot(time[part], trial.one_step[part, j], color=ONE_STEP, linewidth=1.0, linestyle=(0, (3, 2)))
    axes.plot(time[part], trial.free_run[part, j], color=MODEL)
    error = np.sqrt(np.mean((trial.measured - trial.free_run)[first + 1 : last + 1, j] ** 2))
    axes.set_title(f"{title}   RMSE {error:.3g} N·m")
    axes.margins(x=0.0)


def _finished(figure: Figure, panels: np.ndarray, path: Path) -> Path:
    for axes in panels[:, 0]:
        axes.set_ylabel("torque (N·m)")
    for axes in panels[-1]:
        axes.set_xlabel("time (s)")
    title_row(figure, _NAMES)
    return save_figure(figure, path)


def typical_and_worst(residual: np.ndarray, steps: int) -> dict[str, int]:
    """Numbers of the windows with the median and the largest squared residual (T,)."""
    count = (len(residual) - 1) // steps
    if count < 1:
        raise UsageError(f"{len(residual)} samples: expected at least one window of {steps}")
    energy = np.sum(residual[1 : 1 + count * steps].reshape(count, steps) ** 2, axis=1)
    order = np.argsort(energy, kind="stable")
    return {"median": int(order[count // 2]), "worst": int(order[-1])}
