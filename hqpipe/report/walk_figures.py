"""Figure of a walk: speed, feet, torques against their limits, supply pressure, height and tilt of the body."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from hqpipe.errors import UsageError
from hqpipe.logs.trajectory import Trajectory
from hqpipe.report.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    VERMILION,
    name_line,
    new_figure,
    save_figure,
    styled,
)

_SMOOTH_S = 0.5  # about one stride
_ORIENTATION = tuple(f"base/orientation/{axis}" for axis in "xyzw")
_MAX_POINTS = 4000  # more than the pixels of a figure


@styled
def walk_summary(
    trial: Trajectory,
    path: Path,
    *,
    effort_limit: np.ndarray | None = None,
    posture: bool = False,
    filmed: tuple[float, float] | None = None,
    fall_time: float | None = None,
) -> Path:
    """What a walk looked like; a panel appears if its channels were recorded.

    Args:
        trial: one trial.
        path: .png or .svg.
        effort_limit: (J,) N·m, drawn as 100 % of each joint's torque.
        posture: whether height and tilt of the body are shown, too.
        filmed: s, first and last moment of a film of this walk; marked by a bar.
        fall_time: s, marked by a line.

    Raises:
        UsageError: the trial has neither base speed, contacts, effort nor supply pressure.
    """
    draw: list[tuple[float, Callable[[Axes, Trajectory], None]]] = []
    if "base/linear_velocity/x" in trial.extra:
        draw.append((1.3, _speed))
    if contact_feet(trial):
        draw.append((1.0, _contacts))
    if trial.effort is not None:
        draw.append((1.3, lambda axes, t: _torques(axes, t, effort_limit)))
    if "supply/pressure" in trial.extra:
        draw.append((1.0, _pressure))
    if posture and all(name in trial.extra for name in ("base/position/z", *_ORIENTATION)):
        draw += [(0.8, _height), (0.8, _tilt)]
    if not draw:
        raise UsageError("nothing to draw: expected base/linear_velocity/x, foot/…/contact, effort or supply/pressure")
    heights = [height for height, _ in draw]
    figure = new_figure(0.5 + 1.35 * sum(heights))
    panels = figure.subplots(len(draw), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    for axes, (_, panel) in zip(panels, draw, strict=True):
        panel(axes, trial)
        if fall_time is not None:
            axes.axvline(fall_time, color=VERMILION, linewidth=1.0)
    if fall_time is not None:
        name_line(panels[0], fall_time, panels[0].get_ylim()[0], " fallen", VERMILION, va="bottom")
    panels[-1].set_xlabel("time (s)")
    panels[-1].set_xlim(trial.time[0], trial.time[-1])
    if filmed is not None:
        _mark_film(panels[0], filmed)
    return save_figure(figure, path)


def _mark_film(axes: Axes, filmed: tuple[float, float]) -> None:
    """A bar above the panel over the part that a film shows."""
    style = {"color": GREY, "linewidth": 3.0, "solid_capstyle": "butt", "clip_on": False}
    axes.plot(filmed, [1.03, 1.03], transform=axes.get_xaxis_transform(), **style)
    axes.annotate("filmed", (1.005, 1.03), xycoords="axes fraction", color=GREY, fontsize=8.0, va="center")


def _thin(trial: Trajectory) -> slice:
    return slice(None, None, max(1, trial.samples // _MAX_POINTS))


def _end(axes: Axes, y: float, text: str, color: str) -> None:
    """Name a line at the right edge of the panel."""
    axes.annotate(text, (1.005, y), xycoords=axes.get_yaxis_transform(), color=color, fontsize=8.0, va="center")


def forward_speed(trial: Trajectory) -> np.ndarray:
    """(T,) speed along the heading, m/s; along the world's x axis if the orientation was not recorded."""
    x = trial.extra["base/linear_velocity/x"]
    if "base/linear_velocity/y" not in trial.extra or not all(name in trial.extra for name in _ORIENTATION):
        return x
    qx, qy, qz, qw = (trial.extra[name] for name in _ORIENTATION)
    yaw = np.arctan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy**2 + qz**2))
    return np.cos(yaw) * x + np.sin(yaw) * trial.extra["base/linear_velocity/y"]


def mean_speed(trial: Trajectory) -> np.ndarray:
    """(T,) forward speed, m/s, as a moving mean over half a second, which is about one stride."""
    length = max(1, min(trial.samples, round(_SMOOTH_S / trial.dt)))
    kernel = np.full(length, 1.0 / length)
    weight = np.convolve(np.ones(trial.samples), kernel, mode="same")
    return np.convolve(forward_speed(trial), kernel, mode="same") / weight


def _speed(axes: Axes, trial: Trajectory) -> None:
    speed, smooth, part = forward_speed(trial), mean_speed(trial), _thin(trial)
    axes.plot(trial.time[part], speed[part], color=BLUE, linewidth=0.6, alpha=0.4)
    axes.plot(trial.time[part], smooth[part], color=BLUE)
    _end(axes, smooth[-1], "actual", BLUE)
    if "command/vx" in trial.extra:
        command = trial.extra["command/vx"]
        axes.plot(trial.time[part], command[part], color=INK, linestyle=(0, (4, 2)), linewidth=1.0)
        apart = abs(command[-1] - smooth[-1]) > 0.12 * np.ptp([*speed, *command])
        _end(axes, command[-1] if apart else command[-1] + 0.14 * np.ptp([*speed, *command]), "commanded", INK)
    axes.set_ylabel("m/s")
    axes.set_title("forward speed")


def contact_feet(trial: Trajectory) -> list[str]:
    """Names of the feet whose contact was recorded."""
    names = (name.split("/") for name in trial.extra)
    return [parts[1] for parts in names if len(parts) == 3 and parts[0] == "foot" and parts[2] == "contact"]


def _contacts(axes: Axes, trial: Trajectory) -> None:
    feet = contact_feet(trial)
    for row, foot in enumerate(feet):
        on = trial.extra[f"foot/{foot}/contact"] > 0.5
        change = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
        last = trial.samples - 1
        spans = [
            (trial.time[a], trial.time[min(b, last)] - trial.time[a])
            for a, b in zip(change[::2], change[1::2], strict=True)
        ]
        axes.broken_barh(spans, (row - 0.36, 0.72), color=INK if foot.startswith("L") else GREY, linewidth=0)
        _end(axes, row, f"{on.mean():.0%} of the time", GREY)
    axes.set_yticks(range(len(feet)), feet)
    axes.set_ylim(len(feet) - 0.5, -0.5)
    axes.grid(False, axis="y")
    axes.set_title("foot contact")


def _torques(axes: Axes, trial: Trajectory, limit: np.ndarray | None) -> None:
    """Largest torque of each kind of joint, as a share of the limit where there is one."""
    kinds = {"R": ("roll", GREEN), "P": ("pitch", BLUE), "K": ("knee", VERMILION)}
    groups = {kind: [j for j, name in enumerate(trial.joints) if name[-1] == kind] for kind in kinds}
    if sum(len(members) for members in groups.values()) < len(trial.joints):
        groups, kinds = {"": list(range(len(trial.joints)))}, {"": ("largest joint", ORANGE)}
    scale = np.ones(len(trial.joints)) if limit is None else 0.01 * np.asarray(limit)
    part, heights = _thin(trial), []
    step = part.step
    for kind, members in groups.items():
        load = np.max(np.abs(trial.effort[:, members] / scale[members]), axis=1)
        used = len(load) // step * step
        peak = load[:used].reshape(-1, step).max(axis=1)  # thinning must not hide a peak
        axes.plot(trial.time[:used:step], peak, color=kinds[kind][1], linewidth=0.7)
        heights.append((float(np.percentile(load, 90)), kinds[kind]))
    axes.set_ylim(bottom=0.0)
    top = axes.get_ylim()[1]
    if limit is not None:
        axes.axhline(100.0, color=INK, linewidth=1.0, linestyle=(0, (4, 2)))
        axes.set_ylim(top=(top := max(top, 112.0)))
        _end(axes, 100.0, "limit", INK)
    height = np.inf
    for value, (name, color) in sorted(heights, reverse=True):
        height = min(value, height - 0.13 * top)
        _end(axes, height, name, color)
    axes.set_ylabel("N·m" if limit is None else "% of limit")
    axes.set_title("largest joint torque")


def _pressure(axes: Axes, trial: Trajectory) -> None:
    pressure, part = trial.extra["supply/pressure"] / 1e5, _thin(trial)
    axes.plot(trial.time[part], pressure[part], color=BLUE, linewidth=0.8)
    low = int(np.argmin(pressure))
    axes.plot(trial.time[low], pressure[low], "o", color=VERMILION, markersize=4)
    side = "right" if trial.time[low] > 0.5 * trial.time[-1] else "left"
    axes.margins(y=0.15)
    name_line(
        axes,
        trial.time[low],
        pressure[low],
        f"  lowest {pressure[low]:.0f} bar  ",
        VERMILION,
        ha=side,
        va="top",
    )
    axes.set_ylabel("bar")
    axes.set_title("supply pressure")


def _height(axes: Axes, trial: Trajectory) -> None:
    part = _thin(trial)
    axes.plot(trial.time[part], trial.extra["base/position/z"][part], color=BLUE, linewidth=0.8)
    axes.margins(y=0.2)
    axes.set_ylabel("m")
    axes.set_title("height of the body")


def _tilt(axes: Axes, trial: Trajectory) -> None:
    """Angle between the body's vertical and the world's."""
    part = _thin(trial)
    x, y = (trial.extra[name] for name in _ORIENTATION[:2])
    tilt = np.degrees(np.arccos(np.clip(1.0 - 2.0 * (x**2 + y**2), -1.0, 1.0)))
    axes.plot(trial.time[part], tilt[part], color=BLUE, linewidth=0.8)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("°")
    axes.set_title("tilt of the body")
