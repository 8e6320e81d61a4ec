"""Figures of a diagnosis: joint × regime, the worst second of each joint, the error's spectrum."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap

from hqpipe.report.style import (
    BLUE,
    FAINT,
    GREEN,
    GREY,
    INK,
    MEASURED,
    MODEL,
    VERMILION,
    name_line,
    new_figure,
    save_figure,
    styled,
    title_row,
)

_HEAT = LinearSegmentedColormap.from_list("heat", ["#FFFFFF", "#FBE3CF", "#EE9A5C", "#C2410C", "#6B1D05"])
_SHOWN = 0.02  # smaller shares are left unprinted
_FAMILIES = "all direction reversal speed flow saturation impact contact time_span frequency".split()
_REST = ("no_", "between_", "low_flow")  # regimes that are what their family leaves over


@styled
def gap_heat_map(rows: Iterable[Mapping[str, Any]], path: Path, *, trial: str = "all") -> Path:
    """Share of the gap by joint and regime, and how much of the time the regime took.

    Regimes that are only the rest of their family, such as "no impact", are left out.

    Args:
        rows: of residuals.csv – trial, joint, family, regime, n, share; numbers may be text.
        path: .png or .svg.
        trial: which trial's rows to show.
    """
    picked = [row for row in rows if row["trial"] == trial and not row["regime"].startswith(_REST)]
    joints = joint_order(picked)
    share = {(r["joint"], r["family"], r["regime"]): float(r["share"]) for r in picked}
    columns = _columns({(family, regime) for _, family, regime in share})
    table = np.full((len(joints), len(columns)), np.nan)
    for x, column in enumerate(columns):
        if column is not None:
            table[:, x] = [share.get((joint, *column), 0.0) for joint in joints]
    top = float(np.nanmax(table)) or 1.0
    figure = new_figure(1.75 + 0.26 * len(joints))
    axes = figure.subplots()
    image = axes.imshow(table, cmap=_HEAT, vmin=0.0, vmax=top, aspect="auto")
    _label_cells(axes, table, top)
    _label_columns(axes, columns, _time_shares(picked))
    axes.set_yticks(range(len(joints)), joints)
    bar = figure.colorbar(image, pad=0.01, aspect=25, format=lambda v, _: f"{v:.0%}")
    bar.set_label("share of the gap")
    bar.outline.set_visible(False)
    return save_figure(figure, path)


def _columns(regimes: set[tuple[str, str]]) -> list[tuple[str, str] | None]:
    """Columns family by family, with a None where one family ends and the next begins."""
    columns: list[tuple[str, str] | None] = []
    for family in _FAMILIES:
        members = sorted((r for f, r in regimes if f == family), key=_regime_order)
        if members:
            columns += [*([None] if columns else []), *((family, regime) for regime in members)]
    return columns


def _time_shares(rows: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str], float]:
    """(family, regime) → share of all samples; a frequency band takes no time."""
    count: dict[tuple[str, str], float] = {}
    for row in rows:
        key = (row["family"], row["regime"])
        count[key] = count.get(key, 0.0) + float(row["n"])
    total = count[("all", "all")]
    return {key: n / total for key, n in count.items() if key[0] not in ("all", "frequency")}


def _label_columns(axes: Axes, columns: list[tuple[str, str] | None], time: dict[tuple[str, str], float]) -> None:
    at = [x for x, column in enumerate(columns) if column is not None]
    names = [_words(columns[x][1]) + (f" ({time[columns[x]]:.0%})" if columns[x] in time else "") for x in at]
    axes.set_xticks(at, names, rotation=55)
    for tick in axes.get_xticklabels():
        tick.set(ha="right", rotation_mode="anchor", fontsize=7.5)
    for family in dict.fromkeys(column[0] for column in columns if column is not None):
        members = [x for x in at if columns[x][0] == family]
        if len(members) > 1:
            axes.text(np.mean(members), -0.75, _words(family), ha="center", fontsize=8.0, color=GREY)
    axes.set_xlabel("regime (its share of the time)")
    axes.tick_params(length=0)
    axes.grid(False)
    axes.spines[:].set_visible(False)


def joint_order(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Joints from body to foot and leg by leg if they carry the quadruped's names, else by name."""
    legs, parts = ("LF", "RF", "LH", "RH"), ("R", "P", "K")
    standard = [leg + part for leg in legs for part in parts]
    names = {row["joint"] for row in rows}
    return [j for j in standard if j in names] + sorted(names - set(standard))


def _regime_order(regime: str) -> tuple[int, str]:
    """Frequency bands by frequency, other regimes by name."""
    head = regime.split("-")[0]
    return (int(head) if head.isdigit() else 0, regime)


def _words(name: str) -> str:
    return name.replace("_hz", " Hz").replace("-", "–").replace("_", " ")


def _label_cells(axes: Axes, table: np.ndarray, top: float) -> None:
    for (row, column), value in np.ndenumerate(table):
        if value >= _SHOWN:
            color = "white" if value > 0.55 * top else INK
            axes.text(column, row, f"{100 * value:.0f}", ha="center", va="center", fontsize=7.0, color=color)


@styled
def worst_windows(
    time: np.ndarray,
    measured: np.ndarray,
    predicted: np.ndarray,
    joints: Sequence[str],
    path: Path,
    *,
    span_s: float = 1.0,
) -> Path:
    """The second of a held-out trial in which each joint's model is worst, measured against free-running.

    Args:
        time: (T,) s. measured, predicted: (T, J) N·m. joints: J names.
        path: .png or .svg.
        span_s: length of the stretch, s.
    """
    count = len(joints)
    width = min(3, count)
    depth = -(-count // width)
    figure = new_figure(0.5 + 1.45 * depth)
    panels = figure.subplots(depth, width, squeeze=False)
    for axes in panels.flat[count:]:
        axes.set_visible(False)
    for j, (axes, joint) in enumerate(zip(panels.flat, joints, strict=False)):
        start, stop = worst_stretch(time, measured[:, j] - predicted[:, j], span_s)
        clock = time[start:stop]
        error = measured[start:stop, j] - predicted[start:stop, j]
        axes.fill_between(
            clock, measured[start:stop, j], predicted[start:stop, j], color=MODEL, alpha=0.18, linewidth=0
        )
        axes.plot(clock, measured[start:stop, j], color=MEASURED)
        axes.plot(clock, predicted[start:stop, j], color=MODEL)
        axes.set_title(f"{joint}   RMSE {np.sqrt(np.mean(error**2)):.3g} N·m")
        axes.margins(x=0.0)
        if j % width == 0:
            axes.set_ylabel("torque (N·m)")
        if j >= count - width:
            axes.set_xlabel("time (s)")
    title_row(figure, [("measured", MEASURED), ("model, free-running", MODEL)])
    return save_figure(figure, path)


def worst_stretch(time: np.ndarray, residual: np.ndarray, span_s: float) -> tuple[int, int]:
    """First sample and the one after the last of the `span_s` with the largest squared residual (T,)."""
    length = min(len(time), max(2, round(span_s / float(np.median(np.diff(time))))))
    energy = np.concatenate([[0.0], np.cumsum(residual**2)])
    start = int(np.argmax(energy[length:] - energy[:-length]))
    return start, start + length


@styled
def error_spectrum(
    residual: np.ndarray,
    measured: np.ndarray,
    dt: float,
    joints: Sequence[str],
    path: Path,
    *,
    noise_floor: float | None = None,
) -> Path:
    """Spectrum of the free-running error by joint, beside the measured torque and the noise floor.

    Args:
        residual, measured: (T, J) N·m.
        dt: s.
        joints: J names; the three with the largest error are named, the others are grey.
        noise_floor: RMS that noise alone would leave, N·m, spread evenly over frequency.
    """
    frequency, error = _density(residual, dt)
    _, torque = _density(measured, dt)
    figure = new_figure(3.4)
    axes = figure.subplots()
    order = np.argsort(-np.mean(residual**2, axis=0), kind="stable")
    for j in order[3:]:
        axes.loglog(frequency, error[:, j], color=FAINT, linewidth=0.9)
    for j, color in zip(order[:3], (VERMILION, BLUE, GREEN), strict=False):
        axes.loglog(frequency, error[:, j], color=color)
    mean = torque.mean(axis=1)
    axes.loglog(frequency, mean, color=INK, linewidth=1.0, linestyle=(0, (4, 2)))
    peak = int(np.argmax(mean))
    name_line(axes, frequency[peak] * 1.15, mean[peak], "measured torque, mean of the joints", INK, va="center")
    heights = _spread_out([float(np.log10(error[-1, j])) for j in order[:3]], 0.35)
    for j, color, height in zip(order[:3], (VERMILION, BLUE, GREEN), heights, strict=False):
        name_line(axes, frequency[-1] * 1.08, 10**height, f"error {joints[j]}", color, va="center")
    if noise_floor:
        level = noise_floor * np.sqrt(2.0 * dt)
        axes.axhline(level, color=GREY, linewidth=0.9, linestyle=":")
        name_line(axes, frequency[0] * 1.1, level, "noise floor", GREY, va="bottom")
    axes.set_xlabel("frequency (Hz)")
    axes.set_ylabel("amplitude density (N·m/√Hz)")
    axes.set_xlim(frequency[0], frequency[-1])
    return save_figure(figure, path)


def _spread_out(heights: list[float], gap: float) -> list[float]:
    """Push labels apart so that neighbours differ by `gap` or more, keeping their order."""
    order = np.argsort(heights)[::-1]
    moved = list(heights)
    for upper, lower in zip(order[:-1], order[1:], strict=True):
        moved[lower] = min(moved[lower], moved[upper] - gap)
    return moved


def _density(signal: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude density (F, J), Welch's method, in bins that widen with frequency."""
    length = min(len(signal), max(64, round(2.0 / dt)))
    taper = np.hanning(length)[:, None]
    parts = [
        np.abs(np.fft.rfft(taper * (part - part.mean(axis=0)), axis=0)) ** 2
        for start in range(0, len(signal) - length + 1, length // 2)
        for part in [signal[start : start + length]]
    ]
    power = 2.0 * dt * np.mean(parts, axis=0) / np.sum(taper**2)
    frequency = np.fft.rfftfreq(length, dt)
    edges = np.unique(np.round(np.geomspace(1, len(frequency), 90)).astype(int))
    groups = list(zip(edges[:-1], edges[1:], strict=True))
    centre = np.array([frequency[a:b].mean() for a, b in groups])
    smooth = np.array([power[a:b].mean(axis=0) for a, b in groups])
    return centre, np.sqrt(smooth)
