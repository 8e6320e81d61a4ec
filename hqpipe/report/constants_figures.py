"""Physical constants of the fits, joint by joint, beside what the machine is by design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from hqpipe.errors import UsageError
from hqpipe.report.style import BLUE, GREY, INK, VERMILION, new_figure, plain, save_figure, styled, title_row

SHOWN = ("hydraulic stiffness", "bulk modulus", "flow gain", "leakage", "loop stiffness", "full torque")
_COLOURS, _MARKERS = (VERMILION, BLUE), ("o", "s")
_COLUMNS = 3
_APART = 0.22  # of a joint's row, between the models

Rows = Sequence[Mapping[str, Any]]


@styled
def constants_chart(rows: Rows, path: Path) -> Path:
    """One panel per quantity, one line per joint: estimates with 95 % intervals, and the design as a short black line.

    Args:
        rows: of constants.csv: joint, model, quantity, unit, value, and low, high, expected that may be None.
        path: .png or .svg.
    """
    names = [name for name in SHOWN if any(row["quantity"] == name for row in rows)]
    if not names:
        raise UsageError(f"nothing to draw: no row of {', '.join(SHOWN)}")
    joints = list(dict.fromkeys(row["joint"] for row in rows))
    models = list(dict.fromkeys(row["model"] for row in rows))
    lines = -(-len(names) // _COLUMNS)
    figure = new_figure(0.5 + lines * (0.75 + 0.17 * len(joints)))
    panels = figure.subplots(lines, min(_COLUMNS, len(names)), squeeze=False, sharey=True).ravel()
    for panel, name in zip(panels, names, strict=False):
        _panel(panel, [row for row in rows if row["quantity"] == name], joints, models)
    for panel in panels[len(names) :]:
        panel.set_visible(False)
    panels[0].set_yticks(range(len(joints)), [plain(joint) for joint in joints])
    panels[0].set_ylim(len(joints) - 0.4, -0.6)
    shown = [(f"{m} {name}", c) for m, name, c in zip("●■", models, _COLOURS, strict=False)]
    designed = [("| by design", INK)] if any(row["expected"] is not None for row in rows) else []
    title_row(figure, [*shown, *designed, ("lines: 95 % intervals", GREY)])
    return save_figure(figure, path)


def _panel(panel: Axes, rows: Rows, joints: Sequence[str], models: Sequence[str]) -> None:
    for row in rows:
        which = models.index(row["model"])
        at = joints.index(row["joint"]) + _APART * (2 * which - 1) * (len(models) > 1)
        colour = _COLOURS[which % len(_COLOURS)]
        if row["low"] is not None:
            panel.plot([row["low"], row["high"]], [at, at], color=colour, linewidth=1.4)
        panel.plot(row["value"], at, color=colour, marker=_MARKERS[which % len(_MARKERS)], markersize=3.2)
        if row["expected"] is not None:
            panel.plot([row["expected"]] * 2, [at - _APART, at + _APART], color=INK, linewidth=1.6)
    known = [row[key] for row in rows for key in ("value", "expected") if row[key] is not None]
    panel.set_xlim(
        0.0, 1.15 * max(known)
    )  # from 0, so that lengths can be compared; a wide interval runs out of the panel
    panel.set_title(rows[0]["quantity"])
    panel.set_xlabel(rows[0]["unit"])
    panel.ticklabel_format(axis="x", style="sci", scilimits=(-3, 4))
    panel.grid(axis="y", visible=False)
