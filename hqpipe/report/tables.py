"""Tables for the terminal; rich is imported when a table is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table


def coefficient_table(fit: Mapping[str, Any]) -> Table:
    """One row per joint, one column per coefficient with its 95 % interval.

    Args:
        fit: `FitResult.to_dict()`.
    """
    fits = fit["fits"]
    table = _table(f"{fit['model']}, {fit['scope'].replace('_', ' ')}, dt {1e3 * fit['dt']:.3g} ms")
    table.add_column("joint")
    for coefficient in fits[0]["coefficients"]:
        table.add_column(f"{coefficient['name']} ({coefficient['unit']})", justify="right")
    table.add_column("free-run RMSE, fit trials (N·m)", justify="right")
    for joint in fits:
        cells = [_coefficient(c) for c in joint["coefficients"]]
        table.add_row(joint["joint"], *cells, _number(joint["free_run_rmse"]))
    return table


def _coefficient(c: Mapping[str, Any]) -> str:
    if not c["identifiable"] or c["value"] is None:
        return "[dim]not identifiable[/dim]"
    text = _number(c["value"])
    if c["ci95"] is not None:
        text += f" [dim]{_number(c['ci95'][0])}…{_number(c['ci95'][1])}[/dim]"
    return text + (" [yellow]at bound[/yellow]" if c["at_bound"] else "")


def comparison_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Models by held-out free-running error, all joints and trials pooled; the best first.

    Args:
        rows: `ScoreRow` as mappings; those of single joints or trials are left out.
    """
    pooled = [row for row in rows if row["joint"] == row["trial"] == "all"]
    table = _table("held-out torque error (N·m)")
    table.add_column("model")
    for name in ("one step", "free run", "free run, loaded", "against persistence"):
        table.add_column(name, justify="right")
    for row in sorted(pooled, key=lambda r: r["free_run"]["rmse"]):
        skill = row["free_run_skill"]
        color = "red" if skill < 0 else "default"
        table.add_row(
            row["model"],
            _number(row["one_step"]["rmse"]),
            _number(row["free_run"]["rmse"]),
            _number(row["free_run"]["loaded_rmse"]),
            f"[{color}]{-round(100 * skill) or 0:+d}%[/{color}]" if row["model"] != "persistence" else "",
        )
    if pooled:
        table.caption = f"noise floor of the torque {_number(pooled[0]['noise_floor'])} N·m"
    return table


def _table(title: str) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    return Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"
