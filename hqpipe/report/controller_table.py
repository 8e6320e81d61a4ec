"""Tables of the comparison of controllers; rich is imported when a table is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hqpipe.report.diagnosis_words import size_text

if TYPE_CHECKING:
    from rich.table import Table

# Columns of the plant: measure → title and unit, and the factor into it.
_MEASURES = {
    "velocity_error": ("velocity\nerror m/s", 1.0),
    "drift": ("drift\nm", 1.0),
    "foot_clearance": ("clearance\ncm", 100.0),
    "peak_force": ("impact\nweights", 1.0),
    "tracking_rmse": ("joint error\nmrad", 1000.0),
    "torque_rmse": ("torque error\nN·m", 1.0),
}
_CAPTION = (
    "dim: the gait prior alone, without the policy's corrections\n"
    "measures are means over the walks that did not fall; torque error where the machine is given torque targets"
)

_ONE_SEED = "no interval where there is one seed, or all are alike"

Rows = Sequence[Mapping[str, Any]]
Spread = Mapping[str, Mapping[str, Any] | None]
"""Measure → mean, ci95 (low and high end, or None) and seeds; see `hqpipe.stages.comparison.intervals.over_seeds`."""


def training_table(rows: Rows, speeds: Mapping[str, Mapping[str, float]]) -> Table:
    """One line per controller: reward at the end of its training, falls and score in the simulator, and what it took.

    Args:
        rows: title, reward, simulator (actor → falls, walks, score; actors are policy and zero_action) and note; None where the
            training diverged.
        speeds: title → training_s, and step_s of a step of one environment, s.
    """
    table = _table("trained with the same budget and seeds, each in its own simulator")
    table.add_column("controller")
    for title in ("reward\nper step", "falls when\npushed", "score, less\nis better", "minutes", "µs per\nstep"):
        table.add_column(title, justify="right")
    table.add_column("actuators of the robots")
    for row in rows:
        simulator, speed = _actors(row["simulator"]), speeds.get(row["title"])
        cells = ["–" if row["reward"] is None else f"{row['reward']:.4f}", _both(_falls, simulator)]
        cells.append(_both(lambda found: _number(found["score"], 1.0), simulator))
        cells += [f"{speed['training_s'] / 60:.1f}", f"{1e6 * speed['step_s']:.0f}"] if speed else ["–", "–"]
        table.add_row(row["title"], *cells, row["note"])
    table.caption = "dim: the gait prior alone"
    return table


def plant_table(rows: Rows) -> Table:
    """One line per controller: falls on the plant, and measures of the walks that did not fall.

    Args:
        rows: title and plant, actor → falls, walks and measures; None where nothing walked.
    """
    table = _table("on the plant, all scenarios together")
    table.add_column("controller")
    for title in ("falls", *(title for title, _ in _MEASURES.values())):
        table.add_column(title, justify="right")
    for row in rows:
        plant = _actors(row["plant"])
        cells = [_both(lambda a, n=n, f=f: _number(a[n], f), plant) for n, (_, f) in _MEASURES.items()]
        table.add_row(row["title"], _both(_falls, plant), *cells)
    table.caption = _CAPTION
    return table


def scenario_table(cells: Rows, titles: Mapping[str, str]) -> Table:
    """Falls and velocity error (m/s) of every policy in every scenario; the arguments as of `plant_panels`."""
    table = _table("on the plant: falls of walks, error of the mean velocity (m/s)")
    table.add_column("scenario")
    for title in titles.values():
        table.add_column(title.replace(" ", "\n"), justify="right")
    for scenario in dict.fromkeys(cell["scenario"] for cell in cells):
        same = {(c["controller"], c["actor"]): c for c in cells if c["scenario"] == scenario}
        table.add_row(
            scenario,
            *(_both(_outcome, {a: same.get((name, a)) for a in ("policy", "zero_action")}, "\n") for name in titles),
        )
    table.caption = "dim: the gait prior alone"
    return table


def seeds_table(rows: Mapping[str, Spread]) -> Table:
    """One line per controller: what its policies did on the plant, mean ± half of the 95 % interval over the training seeds."""
    return _spread_table("over the seeds of the trainings: mean ± half of the 95 % interval", rows)


def difference_table(rows: Mapping[str, Spread], other: str) -> Table:
    """The same of the differences of every controller from the one that is titled `other`."""
    table = _spread_table(f"less {other}, walk by walk: mean ± half of the 95 % interval over the seeds", rows)
    table.caption = "same training seed, scenario and walk; measures over pairs in which neither fell\n" + _ONE_SEED
    return table


def _spread_table(title: str, rows: Mapping[str, Spread]) -> Table:
    table = _table(title)
    table.add_column("controller")
    columns = {"reward": ("reward\nper step", 1.0), "falls": ("falls\n%", 100.0), **_MEASURES}
    columns = {name: c for name, c in columns.items() if any(row.get(name) for row in rows.values())}
    for head, _ in columns.values():
        table.add_column(head, justify="right")
    table.add_column("seeds", justify="right")
    for name, row in rows.items():
        seeds = max((found["seeds"] for found in row.values() if found), default=0)
        table.add_row(name, *(spread_text(row.get(n), factor) for n, (_, factor) in columns.items()), str(seeds))
    table.caption = _ONE_SEED
    return table


def spread_text(found: Mapping[str, Any] | None, factor: float = 1.0) -> str:
    """mean ± half width, in the unit that `factor` leads to; the mean alone where there is no interval."""
    if not found:
        return "–"
    mean = f"{factor * found['mean']:.3g}"
    if not found["ci95"]:
        return mean
    low, high = found["ci95"]
    return f"{mean} ± {0.5 * factor * (high - low):.2g}"


def check_lines(check: Mapping[str, Any], effects: Sequence[str], left_out: str) -> list[str]:
    """How far the models are from the plant, and what the oracle has of it.

    Args:
        check: see `hqpipe.stages.comparison.model_check.free_run_errors`. effects: of the oracle. left_out: by it, in words.
    """
    told = (f"{name} " + ("–" if error is None else f"{error:.3g}") for name, error in check["rmse"].items())
    return [
        f"free run of the models over {1000 * check['window_s']:.0f} ms on {check['seconds']:g} s of the plant in its gantry "
        f"(torque {check['effort_rms']:.3g} N·m RMS, held {check['persistence']:.3g}): {', '.join(told)} N·m RMSE",
        f"the oracle has of the plant: {', '.join(name.replace('_', ' ') for name in effects)}; left out: {left_out}",
    ]


def loop_lines(loop: Mapping[str, Any]) -> list[str]:
    """The gap as it was measured, and what policies trained with a model do better than the one without, in lines.

    Args:
        loop: see `hqpipe.stages.comparison.results.loop_closed`.
    """
    lines = []
    if gap := loop["gap"]:
        since = " since the reference" if loop["since_reference"] else ""
        lines.append(
            f"the gap{since}: {size_text(gap, 'before')} → {size_text(gap, 'after')} over a floor of "
            f"{size_text(gap, 'noise_floor')} ({gap['layer'].replace('_', ' ')}, {gap['metric'].replace('_', ' ')})"
        )
    for name, found in loop["controllers"].items():
        parts = [f"falls {found['falls'][0]} → {found['falls'][1]} of {found['walks']}"]
        for measure, (title, factor) in _MEASURES.items():
            if values := found["measures"][measure]:
                what, unit = title.replace("\n", " ").rsplit(" ", 1)
                before, after = (factor * value for value in values)
                parts.append(f"{what} {before:.3g} → {after:.3g} {unit}")
        lines.append(
            f"from {loop['against']} to {name} on the plant: {', '.join(parts)} ({found['pairs']} walks that neither fell in)"
        )
    return lines


def _actors(found: Mapping[str, Any] | None) -> dict[str, Mapping[str, Any] | None]:
    return {actor: (found or {}).get(actor) for actor in ("policy", "zero_action")}


def _both(told: Any, actors: Mapping[str, Mapping[str, Any] | None], gap: str = " ") -> str:
    """What the policy did, and dim what its prior did."""
    policy, zero = (None if actors[a] is None else told(actors[a]) for a in ("policy", "zero_action"))
    return (policy or "–") + (f"{gap}[dim]{zero}[/dim]" if zero and zero != "–" else "")


def _falls(found: Mapping[str, Any]) -> str:
    return f"{found['falls']} of {found['walks']}"


def _outcome(found: Mapping[str, Any]) -> str:
    error = found["velocity_error"]
    return f"{found['falls']}/{found['walks']}" + ("" if error is None else f" {error:.3f}")


def _number(value: float | None, factor: float) -> str:
    return "–" if value is None else f"{factor * value:.3g}"


def _table(title: str) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    return Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
