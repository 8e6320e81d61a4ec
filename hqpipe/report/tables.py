"""Tables for the terminal; rich is imported when a table is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite, pi
from statistics import median
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

# Columns of the comparison: title, unit, logs, horizon, measure.
_MEASURES = (
    ("one step", "N·m", "held-out", "one_step", "rmse"),
    ("free run", "N·m", "held-out", "free_run", "rmse"),
    ("loaded", "N·m", "held-out", "free_run", "loaded_rmse"),
    ("MAPE", "%", "held-out", "free_run", "loaded_mape"),
    ("stress", "N·m", "stress", "free_run", "rmse"),
)


def coefficient_table(fit: Mapping[str, Any]) -> Table:
    """One row per joint, one column per coefficient with its 95 % interval.

    Args:
        fit: `FitResult.to_dict()`.
    """
    from rich.markup import escape

    fits = fit["fits"]
    table = _table(f"{fit['model']}, {fit['scope'].replace('_', ' ')}, dt {1e3 * fit['dt']:.3g} ms")
    table.add_column("joint")
    for coefficient in fits[0]["coefficients"]:
        table.add_column(f"{coefficient['name']} ({coefficient['unit']})", justify="right")
    table.add_column("free-run RMSE, fit trials (N·m)", justify="right")
    for joint in fits:
        cells = [_coefficient(c) for c in joint["coefficients"]]
        table.add_row(escape(joint["joint"]), *cells, _number(joint["free_run_rmse"]))
    return table


def _coefficient(c: Mapping[str, Any]) -> str:
    if not c["identifiable"] or c["value"] is None:
        return "[dim]not identifiable[/dim]"
    text = _number(c["value"])
    if c["ci95"] is not None:
        text += f" [dim]{_number(c['ci95'][0])}…{_number(c['ci95'][1])}[/dim]"
    return text + (" [yellow]at bound[/yellow]" if c["at_bound"] else "")


def comparison_table(
    rows: Sequence[Mapping[str, Any]],
    fit_s: Mapping[str, float] | None = None,
    step_us: Mapping[str, float] | None = None,
) -> Table:
    """One line per model, the smallest held-out free-running error first; the best of a column bold, red is worse than
    persistence.

    Args:
        rows: `ScoreRow` as mappings; those of single joints or trials are left out.
        fit_s, step_us: model → wall time of its fit, s, and of one step of all joints, µs; columns without any are left out.
    """
    pooled = {(row["logs"], row["model"]): row for row in rows if row["joint"] == row["trial"] == "all"}
    columns = []
    for title, unit, logs, horizon, measure in _MEASURES:
        values = {name: row[horizon][measure] for (which, name), row in pooled.items() if which == logs}
        columns.append((f"{title}\n{unit}", values))
    columns += [("fit\ns", dict(fit_s or {})), ("step\nµs", dict(step_us or {}))]
    columns = [(title, values) for title, values in columns if any(v is not None for v in values.values())]
    table = _table("torque error on held-out trials")
    table.add_column("model")
    for title, _ in columns:
        table.add_column(title, justify="right")
    order = sorted(
        (row for (logs, _), row in pooled.items() if logs == "held-out"), key=lambda r: r["free_run"]["rmse"]
    )
    for name in (row["model"] for row in order):
        table.add_row(name, *(_judged(name, values) for _, values in columns))
    table.caption = _caption(rows, pooled)
    return table


def _judged(name: str, values: Mapping[str, float | None]) -> str:
    value = values.get(name)
    text = _number(value)
    if value is None:
        return text
    if value == min(v for v in values.values() if v is not None):
        return f"[bold]{text}[/bold]"
    reference = values.get("persistence")
    return f"[red]{text}[/red]" if reference is not None and value > reference else text


def _caption(rows: Sequence[Mapping[str, Any]], pooled: Mapping[tuple[str, str], Mapping[str, Any]]) -> str | None:
    floors = {logs: row["noise_floor"] for (logs, _), row in pooled.items()}
    if not floors:
        return None
    floor = f"noise floor {_number(floors['held-out'])} N·m"
    if "stress" in floors:
        floor += f", of the stress trials {_number(floors['stress'])}; nothing is fitted to those"
    limits = {_number(row["loaded_threshold"]) for row in rows if row["loaded_threshold"] is not None}
    what = f"{limits.pop()} N·m" if len(limits) == 1 else "a threshold of each joint"
    return f"{floor}\nloaded, MAPE: free run where the torque exceeds {what}"


def constants_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """One line per quantity: the median over the joints of each model, with the smallest and the largest, beside the design.

    Args:
        rows: of constants.csv: joint, model, quantity, unit, value, expected and more.
    """
    models = list(dict.fromkeys(row["model"] for row in rows))
    table = _table("what the coefficients say of the hydraulics: median of the joints, smallest…largest")
    table.add_column("quantity")
    for name in models:
        table.add_column(name, justify="right")
    if any(row["expected"] is not None for row in rows):
        table.add_column("by design", justify="right")
    for quantity, unit in dict.fromkeys((row["quantity"], row["unit"]) for row in rows):
        same = [row for row in rows if row["quantity"] == quantity]
        cells = [_spread([row["value"] for row in same if row["model"] == name]) for name in models]
        if len(table.columns) > len(cells) + 1:
            cells.append(_span([row["expected"] for row in same if row["expected"] is not None]))
        table.add_row(f"{quantity} ({unit})", *cells)
    return table


# Columns of the scenarios: title with unit, measure, factor from its SI unit, decimals.
_SCENARIO_COLUMNS = (
    ("speed\nerror\nm/s", "speed_error", 1.0, 3),
    ("turn\nerror\nrad/s", "yaw_error", 1.0, 3),
    ("drift\nm", "drift", 1.0, 2),
    ("lean\n°", "lean", 180.0 / pi, 1),
    ("foot\nlift\ncm", "foot_clearance", 100.0, 1),
    ("peak\nforce\nweight", "peak_force", 1.0, 2),
    ("joint\nerror\nmrad", "tracking_rmse", 1e3, 0),
    ("torque\nerror\nN·m", "torque_rmse", 1.0, 0),
    ("full\nvalve\n%", "valve_saturation", 100.0, 1),
    ("lowest\nsupply\nbar", "lowest_supply", 1e-5, 0),
    ("est.\nspeed\nm/s", "estimate_velocity", 1.0, 2),
    ("est.\ntilt\n°", "estimate_tilt", 180.0 / pi, 1),
    ("est.\nheight\ncm", "estimate_height", 100.0, 1),
)


def scenario_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """One line per scenario: falls, and the worst of every measure among the walks that did not fall; red is above its limit.

    Args:
        rows: each with scenario, walks, falls, worst (measure → value) and limits (measure → the largest that is allowed).
            Measures that no scenario has are left out.
    """
    table = _table("trials on the plant, the worst walk of each; est.: error of what the estimator believes")
    table.collapse_padding = True  # fifteen columns have to fit
    table.add_column("scenario", no_wrap=True)
    table.add_column("falls", justify="right", no_wrap=True)
    columns = [each for each in _SCENARIO_COLUMNS if any(row["worst"].get(each[1]) is not None for row in rows)]
    for title, *_ in columns:
        table.add_column(title, justify="right", no_wrap=True)
    for row in rows:
        falls = f"{row['falls']}/{row['walks']}"
        cells = [_limited(row["falls"], falls, row["limits"].get("falls"))]
        for _, name, scale, decimals in columns:
            value = row["worst"].get(name)
            text = "" if value is None else f"{value * scale:.{decimals}f}"
            cells.append(_limited(value, text, row["limits"].get(name)))
        table.add_row(row["scenario"], *cells)
    return table


def _limited(value: float | None, text: str, limit: float | None) -> str:
    if limit is None or (value is not None and value <= limit):
        return text
    return f"[red]{text or '–'}[/red]"


def _spread(values: Sequence[float]) -> str:
    if not values:
        return ""
    ends = f" [dim]{_short(min(values))}…{_short(max(values))}[/dim]" if len(values) > 1 else ""
    return _short(median(values)) + ends


def _span(values: Sequence[float]) -> str:
    """Both ends, where the design says different things of the joints."""
    if not values:
        return ""
    ends = dict.fromkeys((_short(min(values)), _short(max(values))))
    return "…".join(ends)


def _short(value: float) -> str:
    return f"{value:.2e}" if value and not 1e-3 <= abs(value) < 1e6 else _number(value)


def _table(title: str) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    return Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)


def _number(value: float | None) -> str:
    if value is None:
        return "–"
    if not isfinite(value):
        return "diverged"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}" if abs(value) < 1e6 else f"{value:.1e}"
