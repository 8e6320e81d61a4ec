"""Figure of a fitted actuator: measured torque, one step ahead and free-running, typical and worst."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from hqpipe.errors import UsageError
from hqpipe.report.style import FAINT, MEASURED, MODEL, ONE_STEP, new_figure, save_figure, styled, title_row

_CONTEXT = 2  # windows shown on each side of the one that is picked
_NAMES = [("measured", MEASURED), ("one step ahead", ONE_STEP), ("free-running, restarted every window", MODEL)]


@styled
def actuator_fit(
    time: np.ndarray,
    measured: np.ndarray,
    one_step: np.ndarray,
    free_run: np.ndarray,
    joints: Sequence[str],
    path: Path,
    *,
    window_s: float = 0.1,
    shown: Sequence[str] | None = None,
) -> Path:
    """Median and worst window of a held-out trial for a few joints.

    Args:
        time: (T,) s. measured, one_step, free_run: (T, J) N·m.
        joints: J names.
        path: .png or .svg.
        window_s: length of the free-running windows, s.
        shown: names of the joints to draw; by default the first three, as in the paper.
    """
    shown = list(shown or joints[:3])
    figure = new_figure(0.6 + 1.75 * len(shown))
    panels = figure.subplots(len(shown), 2, squeeze=False)
    lines = _Lines(time, measured, one_step, free_run, max(1, round(window_s / float(np.median(np.diff(time))))))
    for row, joint in zip(panels, shown, strict=True):
        j = list(joints).index(joint)
        for axes, (kind, window) in zip(row, lines.typical_and_worst(j).items(), strict=True):
            error = lines.draw(axes, j, window)
            axes.set_title(f"{joint}, {kind} window   RMSE {error:.3g} N·m")
        row[0].set_ylabel("torque (N·m)")
    for axes in panels[-1]:
        axes.set_xlabel("time (s)")
    title_row(figure, _NAMES)
    return save_figure(figure, path)


@styled
def worst_windows(
    time: np.ndarray,
    measured: np.ndarray,
    one_step: np.ndarray,
    free_run: np.ndarray,
    joints: Sequence[str],
    path: Path,
    *,
    window_s: float = 0.1,
) -> Path:
    """Worst window of a held-out trial for every joint; arguments as of `actuator_fit`."""
    across = next(n for n in (3, 2, 1) if len(joints) % n == 0)
    down = len(joints) // across
    figure = new_figure(0.6 + 1.6 * down)
    panels = figure.subplots(down, across, squeeze=False)
    lines = _Lines(time, measured, one_step, free_run, max(1, round(window_s / float(np.median(np.diff(time))))))
    for j, (joint, axes) in enumerate(zip(joints, panels.flat, strict=True)):
        error = lines.draw(axes, j, lines.typical_and_worst(j)["worst"])
        axes.set_title(f"{joint}   RMSE {error:.3g} N·m")
    for row in panels:
        row[0].set_ylabel("torque (N·m)")
    for axes in panels[-1]:
        axes.set_xlabel("time (s)")
    title_row(figure, _NAMES)
    return save_figure(figure, path)


@dataclass(frozen=True, eq=False)
class _Lines:
    """Measured and predicted torque of a trial; `steps`: samples per window."""

    time: np.ndarray
    measured: np.ndarray
    one_step: np.ndarray
    free_run: np.ndarray
    steps: int

    def typical_and_worst(self, j: int) -> dict[str, int]:
        return typical_and_worst(self.measured[:, j] - self.free_run[:, j], self.steps)

    def draw(self, axes: Axes, j: int, window: int) -> float:
        """One window of one joint with what is round it; returns its RMSE, N·m."""
        steps, end = self.steps, len(self.time)
        part = slice(max(0, (window - _CONTEXT) * steps), min(end, (window + 1 + _CONTEXT) * steps + 1))
        first, last = window * steps, min((window + 1) * steps, end - 1)
        axes.axvspan(self.time[first], self.time[last], color=FAINT, alpha=0.45, linewidth=0)
        axes.plot(self.time[part], self.measured[part, j], color=MEASURED, linewidth=1.8)
        axes.plot(self.time[part], self.one_step[part, j], color=ONE_STEP, linewidth=1.0, linestyle=(0, (3, 2)))
        axes.plot(self.time[part], self.free_run[part, j], color=MODEL)
        axes.margins(x=0.0)
        residual = self.measured[first + 1 : last + 1, j] - self.free_run[first + 1 : last + 1, j]
        return float(np.sqrt(np.mean(residual**2)))


def typical_and_worst(residual: np.ndarray, steps: int) -> dict[str, int]:
    """Numbers of the windows with the median and the largest squared residual (T,)."""
    count = (len(residual) - 1) // steps
    if count < 1:
        raise UsageError(f"{len(residual)} samples: expected at least one window of {steps}")
    energy = np.sum(residual[1 : 1 + count * steps].reshape(count, steps) ** 2, axis=1)
    order = np.argsort(energy, kind="stable")
    return {"median": int(order[count // 2]), "worst": int(order[-1])}
