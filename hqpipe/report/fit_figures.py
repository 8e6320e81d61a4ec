"""Figure of a fitted actuator: measured torque, one step ahead and free-running, typical and worst."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hqpipe.errors import UsageError
from hqpipe.report.style import FAINT, MEASURED, MODEL, ONE_STEP, new_figure, save_figure, styled, title_row

_CONTEXT = 2  # windows shown on each side of the one that is picked


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
    steps = max(1, round(window_s / float(np.median(np.diff(time)))))
    figure = new_figure(0.6 + 1.75 * len(shown))
    panels = figure.subplots(len(shown), 2, squeeze=False)
    for row, joint in zip(panels, shown, strict=True):
        j = list(joints).index(joint)
        residual = measured[:, j] - free_run[:, j]
        for axes, (kind, window) in zip(row, typical_and_worst(residual, steps).items(), strict=True):
            start = max(0, (window - _CONTEXT) * steps)
            stop = min(len(time), (window + 1 + _CONTEXT) * steps + 1)
            clock = time[start:stop]
            first, last = window * steps, min((window + 1) * steps, len(time) - 1)
            axes.axvspan(time[first], time[last], color=FAINT, alpha=0.45, linewidth=0)
            axes.plot(clock, measured[start:stop, j], color=MEASURED, linewidth=1.8)
            axes.plot(clock, one_step[start:stop, j], color=ONE_STEP, linewidth=1.0, linestyle=(0, (3, 2)))
            axes.plot(clock, free_run[start:stop, j], color=MODEL)
            error = np.sqrt(np.mean(residual[first + 1 : last + 1] ** 2))
            axes.set_title(f"{joint}, {kind} window   RMSE {error:.3g} N·m")
            axes.margins(x=0.0)
        row[0].set_ylabel("torque (N·m)")
    for axes in panels[-1]:
        axes.set_xlabel("time (s)")
    names = [
        ("measured", MEASURED),
        ("one step ahead", ONE_STEP),
        ("free-running, restarted every window", MODEL),
    ]
    title_row(figure, names)
    return save_figure(figure, path)


def typical_and_worst(residual: np.ndarray, steps: int) -> dict[str, int]:
    """Numbers of the windows with the median and the largest squared residual (T,)."""
    count = (len(residual) - 1) // steps
    if count < 1:
        raise UsageError(f"{len(residual)} samples: expected at least one window of {steps}")
    energy = np.sum(residual[1 : 1 + count * steps].reshape(count, steps) ** 2, axis=1)
    order = np.argsort(energy, kind="stable")
    return {"median": int(order[count // 2]), "worst": int(order[-1])}
