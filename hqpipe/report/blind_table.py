"""The score of a diagnosis on withheld-effect cases, for the terminal; rich is imported when a table is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

MAX_MISSES = 15
_MET = {True: "[green]yes[/green]", False: "[red]no[/red]", None: "–"}


def score_tables(score: Mapping[str, Any]) -> list[Any]:
    """Aims, other measures, and the first misses.

    Args:
        score: content of score.json.
    """
    calibration = score["calibration"]
    parts: list[Any] = [_aims(score), _more(score)]
    if calibration["brier"] is not None:
        parts.append(f"Brier score of {calibration['causes']} named causes: {calibration['brier']:.3f}")
    if score["misses"]:
        parts.append(_misses(score))
    return parts


def share_text(row: Mapping[str, Any]) -> str:
    """e.g. "97.5 % (117 of 120)"."""
    if row["share"] is None:
        return "– (none)"
    return f"{100 * row['share']:.1f} % ({row['right']} of {row['of']})"


def reached_text(row: Mapping[str, Any]) -> str:
    """What an aim's row reached: a share, or the ratio of two limits."""
    return ratio_text(row) if "ratio" in row else share_text(row)


def ratio_text(row: Mapping[str, Any]) -> str:
    """e.g. "1.32 × (0.66 against 0.50)", "> 2.1 ×", or a dash with the reason."""
    if row["ratio"] is not None:
        limits = row.get("limits")
        beside = f" ({limits[0]:.2f} against {limits[1]:.2f})" if limits else ""
        return f"{row['ratio']:.2f} ×{beside}"
    reason = f" ({row['reason']})" if row.get("reason") else ""
    return f"> {row['least_ratio']:.2f} ×{reason}" if row.get("least_ratio") is not None else f"–{reason}"


def span_text(ends: Sequence[float | None] | None) -> str:
    """e.g. "1.1–1.6", "from 1.1" without an upper end; a dash without an interval."""
    if ends is None:
        return "–"
    return f"from {ends[0]:.2f}" if ends[1] is None else f"{ends[0]:.2f}–{ends[1]:.2f}"


def interval_text(row: Mapping[str, Any]) -> str:
    """e.g. "93–99", for a ratio "1.10–1.62"; a dash if nothing was tried."""
    if "ratio" in row:
        return span_text(row["ci95"])
    return f"{100 * row['ci95'][0]:.0f}–{100 * row['ci95'][1]:.0f}" if row["of"] else "–"


def title_text(score: Mapping[str, Any]) -> str:
    """e.g. "300 cases, library without valve_lag"."""
    left_out = f", library without {', '.join(score['without'])}" if score.get("without") else ""
    return f"{score['cases']} cases{left_out}"


def _aims(score: Mapping[str, Any]) -> Table:
    from rich.table import Table

    table = Table(title=f"Diagnosis of {title_text(score)}", title_justify="left")
    table.add_column("measure")
    for name in ("aim", "reached", "95 % interval", "strictly", "met"):
        table.add_column(name, justify="right")
    for row in score["aims"]:
        cells = (row["aim"], reached_text(row), interval_text(row), reached_text(row["strict"]), _MET[row["met"]])
        table.add_row(row["measure"], *cells)
    return table


def _more(score: Mapping[str, Any]) -> Table:
    from rich.table import Table

    table = Table(title="Without an aim", title_justify="left")
    table.add_column("measure")
    table.add_column("reached", justify="right")
    table.add_column("95 % interval", justify="right")
    for row in score["more"]:
        if row["of"]:
            table.add_row(row["measure"], share_text(row), interval_text(row))
    for row in score["detection"]:
        if row["effect"] == "any":
            table.add_row(f"single effect named, {row['size']} size", share_text(row), interval_text(row))
    return table


def _misses(score: Mapping[str, Any]) -> Table:
    from rich.markup import escape
    from rich.table import Table

    count = len(score["misses"])
    shown = f", the first {MAX_MISSES} (all in score.html)" if count > MAX_MISSES else ""
    table = Table(title=f"{count} misses{shown}", title_justify="left")
    for name in ("case", "truth", "answer", "missed"):
        table.add_column(name, overflow="fold")
    for row in score["misses"][:MAX_MISSES]:
        table.add_row(*(escape(row[name]) for name in ("case", "truth", "answer", "missed")))
    return table
