"""One look for every figure, and files whose bytes depend on their content alone."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

# Okabe and Ito, "Color Universal Design" (2008): told apart with every kind of colour vision.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
INK, GREY, FAINT = "#222222", "#8A8A8A", "#D9D9D9"
MEASURED, MODEL, ONE_STEP = INK, VERMILION, BLUE

P = ParamSpec("P")
T = TypeVar("T")

WIDTH = 9.0  # inch; a README shows it at about 900 pixels
DPI = 160

_RC = {
    "svg.hashsalt": "hqpipe",
    "font.family": "DejaVu Sans",  # ships with matplotlib: the same glyphs everywhere
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": FAINT,
    "grid.linewidth": 0.5,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "lines.linewidth": 1.2,
    "lines.solid_capstyle": "round",
    "text.color": INK,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Run a drawing function under this style, leaving matplotlib's own settings alone."""

    @functools.wraps(draw)
    def inner(*args: P.args, **kwargs: P.kwargs) -> T:
        with matplotlib.rc_context(matplotlib.rcParamsDefault | _RC):
            return draw(*args, **kwargs)

    return inner


def plain(text: str) -> str:
    """A name from a file, for matplotlib to draw as it is: between dollars it would be set as a formula."""
    return text.replace("$", r"\$")


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure of `width` × `height` inches that does not touch pyplot's global state."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: Path) -> Path:
    """Write PNG or SVG, by the suffix of `path`, without a date or a version in it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    metadata = {"Date": None, "Creator": None} if path.suffix == ".svg" else {"Software": None}
    figure.savefig(path, dpi=DPI, metadata=metadata)
    return path


def name_line(axes: Axes, x: float, y: float, text: str, color: str, **options: object) -> None:
    """Write the name of a line beside it; x and y in data coordinates."""
    halo = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.75}
    axes.text(x, y, text, color=color, fontsize=8.0, bbox=halo, clip_on=False, **options)


def title_row(figure: Figure, names: list[tuple[str, str]]) -> None:
    """Name the lines of all panels in one row above them; (text, color) each."""
    figure.suptitle(" ")
    renderer = figure.canvas.get_renderer()
    x = 0.008
    for text, color in names:
        label = figure.text(x, 0.99, text, color=color, fontsize=9.0, fontweight="bold", va="top")
        width = label.get_window_extent(renderer).width / figure.bbox.width
        x += width + 0.02
