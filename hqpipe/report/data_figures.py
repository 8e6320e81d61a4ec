"""Where in the plane of position error and torque a machine has been: the paper's Fig. 5."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm, to_rgb

from hqpipe.report.style import BLUE, GREY, VERMILION, new_figure, save_figure, styled, title_row

_CELLS = 60  # hexagons across a panel
_LOADED = 50.0  # N·m; below it the share that opposes the command is one of noise (the paper's threshold, section IV-A)
_COLOURS = (BLUE, VERMILION)


@dataclass(frozen=True)
class Cloud:
    """Samples of some joints in some logs: (N,) position error rad, and (N,) torque N·m."""

    error: np.ndarray
    torque: np.ndarray

    @property
    def against(self) -> float:
        """Share of the loaded samples whose torque opposes the position error."""
        loaded = np.abs(self.torque) > _LOADED
        return float(np.mean((self.error * self.torque < 0.0)[loaded])) if loaded.any() else 0.0


@styled
def data_distribution(panels: Mapping[str, Mapping[str, Cloud]], path: Path) -> Path:
    """One panel per kind of joint, its logs over each other; in the shaded quadrants torque opposes the position error.

    Args:
        panels: kind of joint → name of the logs → samples; the widest logs last, they are drawn at the bottom.
        path: .png or .svg.
    """
    figure = new_figure(3.4)
    axes = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    names: Sequence[str] = next(iter(panels.values())).keys()
    height = 1.05 * max(np.abs(cloud.torque).max() for clouds in panels.values() for cloud in clouds.values())
    for panel, (kind, clouds) in zip(axes, panels.items(), strict=True):
        _panel(panel, clouds, height)
        panel.set_title(kind)
        for row, (cloud, colour) in enumerate(zip(clouds.values(), _COLOURS, strict=False)):
            text = f"{100.0 * cloud.against:.0f} %"
            panel.text(0.98, 0.02 + 0.07 * row, text, color=colour, ha="right", va="bottom", transform=panel.transAxes)
        panel.set_xlabel("position error (rad)")
    axes[0].set_ylabel("torque (N·m)")
    title_row(
        figure,
        [
            *((name, colour) for name, colour in zip(names, _COLOURS, strict=False)),
            (f"shaded: torque against the position error, in % of the samples beyond {_LOADED:g} N·m", GREY),
        ],
    )
    return save_figure(figure, path)


def _panel(panel: Axes, clouds: Mapping[str, Cloud], height: float) -> None:
    width = 1.05 * max(np.abs(cloud.error).max() for cloud in clouds.values())
    for left, bottom in ((-1.0, 0.0), (0.0, -1.0)):
        panel.fill_between(
            [left * width, (left + 1.0) * width], bottom * height, (bottom + 1.0) * height, color="#F0F0F0"
        )
    layers = list(zip(clouds.values(), _COLOURS, strict=False))
    for cloud, colour in reversed(layers):
        shades = LinearSegmentedColormap.from_list("layer", [(*to_rgb(colour), 0.25), (*to_rgb(colour), 1.0)])
        panel.hexbin(
            cloud.error,
            cloud.torque,
            gridsize=(_CELLS, _CELLS // 2),
            extent=(-width, width, -height, height),
            mincnt=1,
            norm=LogNorm(),
            cmap=shades,
            linewidths=0.1,
        )
    panel.axhline(0.0, color=GREY, linewidth=0.6)
    panel.axvline(0.0, color=GREY, linewidth=0.6)
    panel.set_xlim(-width, width)
    panel.set_ylim(-height, height)
