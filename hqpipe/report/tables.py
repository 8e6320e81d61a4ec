"""Tables and summaries for the terminal; rich is imported when a table is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

MAX_WHERE = 10
_VERDICTS = {
    "explained": "the gap is explained",
    "partly_explained": "part of the gap is explained",
    "unknown": "there is a gap, and its cause is not known",
    "no_gap": "no gap: what is left is noise",
    "not_identifiable": "these logs cannot tell",
}


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


def where_table(diagnosis: Mapping[str, Any]) -> Table:
    """The most telling places in ten lines at most, with a bar for each share."""
    table = _table("where the gap is")
    table.caption = "share of the whole gap; regimes overlap; the most telling place first"
    table.add_column("joint")
    table.add_column("regime")
    table.add_column("share", justify="right")
    table.add_column("")
    for place in diagnosis["where"][:MAX_WHERE]:
        bar = "█" * max(1, round(20 * place["share"]))
        table.add_row(place["joint"], place["regime"].replace("_", " "), f"{place['share']:.0%}", bar)
    return table


def summary_lines(diagnosis: Mapping[str, Any]) -> list[str]:
    """A diagnosis.json in plain sentences: verdict, gap, place, causes, what it depends on, warnings."""
    lines = [_VERDICTS[diagnosis["verdict"]]]
    if gap := diagnosis["gap"]:
        unit = gap["unit"]
        lines.append(
            f"free-running error over {1e3 * gap['window_s']:.0f} ms: {_number(gap['before'])} {unit} "
            f"held out; noise floor {_number(gap['noise_floor'])}, persistence {_number(gap['persistence'])}"
        )
    if diagnosis["where"]:
        places = (f"{p['joint']} {p['regime'].replace('_', ' ')} {p['share']:.0%}" for p in diagnosis["where"][:3])
        lines.append(f"where: {', '.join(places)}")
    for cause in diagnosis["causes"]:
        lines.append(
            f"cause: {cause['effect']} in {', '.join(cause['joints'])}, closes {cause['shrink']:.0%} "
            f"(probability {cause['probability']:.0%})"
        )
    depends = diagnosis["unexplained"]["depends_on"][:3]
    if depends:
        text = ", ".join(f"{d['signal'].replace('_', ' ')} {d['share']:.0%}" for d in depends)
        lines.append(f"what is unexplained depends on: {text}")
    if diagnosis["next_experiment"]:
        lines.append(f"next: {diagnosis['next_experiment']}")
    return lines + [f"warning: {text}" for text in diagnosis["warnings"]]


def _table(title: str) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    return Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"
