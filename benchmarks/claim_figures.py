"""Draw docs/figures/claim_*.png, a figure for each claim of docs/theory/actuator-claims.md, from what other commands wrote.

    python benchmarks/claim_figures.py [--actuator artifacts/actuator] [--rollouts artifacts/rollouts]
        [--coverage build/interval_coverage.csv] [--speed build/actuator_speed.csv] [--out docs/figures]

`--actuator` is what `hqpipe fit-actuator` wrote (with `data_seconds` for the error against data), `--rollouts` what
`hqpipe collect` wrote, `--coverage` and `--speed` what interval_coverage.py and actuator_speed.py wrote with `--csv`.
What is not named is not drawn.
"""

from __future__ import annotations

import argparse
import csv
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from hqpipe.report.comparison_figures import comparison_bars, stress_chart
from hqpipe.report.constants_figures import constants_chart
from hqpipe.report.data_curve_figures import data_curve_chart
from hqpipe.report.style import (
    BLUE,
    FAINT,
    GREEN,
    GREY,
    INK,
    PURPLE,
    VERMILION,
    new_figure,
    save_figure,
    styled,
    title_row,
)

BASELINES = (
    "persistence",
    "mean torque",
    "stiff PD (fitted gains)",
    "ideal actuator",
)  # names of hqpipe.identify.rivals.baselines
AIM = (93.0, 97.0)  # %, in which an interval of 95 % is to lie
COEFFICIENTS = {"k1": VERMILION, "k2": BLUE, "k3": GREEN, "k4": PURPLE}
SEED_MARKERS = "os^"
LEVELS = {50.0: "50 ns", 150.0: "150 ns", 1000.0: "1 µs (the paper)"}  # aims of the two models, and the paper's claim
OURS, PEER = VERMILION, GREY

Row = dict[str, Any]


def read_csv(path: Path) -> list[Row]:
    """Rows with numbers where there are numbers, and None where a cell is empty."""
    with path.open(newline="", encoding="utf-8") as stream:
        return [{name: _cell(text) for name, text in row.items()} for row in csv.DictReader(stream)]


def _cell(text: str) -> float | str | None:
    try:
        return float(text) if text else None
    except ValueError:
        return text


def score_rows(long: list[Row]) -> list[Row]:
    """comparison.csv in the form that the drawing functions take: one row per logs, trial, joint and model."""
    found: dict[tuple[str, ...], Row] = {}
    floors: dict[tuple[str, ...], float] = {}
    for row in long:
        place = (row["logs"], row["trial"], row["joint"])
        if row["horizon"] == "any":
            floors[place] = row["value"]
            continue
        scores = {"one_step": {"loaded_mape": None}, "free_run": {"loaded_mape": None}, "noise_floor": floors[place]}
        head = dict(zip(("logs", "trial", "joint", "model"), (*place, row["model"]), strict=True))
        found.setdefault((*place, row["model"]), head | scores)[row["horizon"]][row["measure"]] = row["value"]
    return list(found.values())


def draw_actuator(folder: Path, out: Path) -> None:
    """Everything that fit-actuator has numbers for."""
    rows = score_rows(read_csv(folder / "comparison.csv"))
    comparison_bars(rows, BASELINES, out / "claim_comparison.png")
    stress_chart(rows, out / "claim_stress.png")
    constants_chart(read_csv(folder / "constants.csv"), out / "claim_constants.png")
    shutil.copyfile(folder / "fit.png", out / "claim_torque.png")
    if (folder / "data_curve.json").exists():
        curve = json.loads((folder / "data_curve.json").read_text(encoding="utf-8"))
        lines: dict[str, list[tuple[float, float | None]]] = {}
        for point in curve["points"]:
            lines.setdefault(point["model"], []).append((point["seconds"], point["free_run"]))
        data_curve_chart(lines, curve["persistence"], curve["noise_floor"], out / "claim_data.png")


@styled
def draw_coverage(rows: list[Row], path: Path) -> None:
    """Coverage of every coefficient, of all together beside intervals for independent residuals, and the errors."""
    times, seeds = sorted({row["correlated_s"] for row in rows}), sorted({row["seed"] for row in rows})
    figure = new_figure(3.5)
    single, pooled, error = figure.subplots(1, 3)
    for axes in (single, pooled):
        axes.axhspan(*AIM, color=FAINT, alpha=0.7, linewidth=0.0)
    for marker, seed in zip(SEED_MARKERS, seeds, strict=False):
        own = sorted((row for row in rows if row["seed"] == seed), key=lambda row: row["correlated_s"])
        at = [times.index(row["correlated_s"]) for row in own]
        style = {"marker": marker, "markersize": 4.0, "linewidth": 0.9}
        for name, colour in COEFFICIENTS.items():
            single.plot(at, [row[f"covered_{name}"] for row in own], color=colour, **style)
            error.plot(at, [row[f"error_{name}"] for row in own], color=colour, **style)
        pooled.plot(at, [row["covered"] for row in own], color=INK, **style)
        pooled.plot(at, [row["independent"] for row in own], color=GREY, linestyle=(0, (3, 2)), **style)
    single.set(title="Each coefficient", ylim=(80.0, 100.0), ylabel="intervals that hold the truth (%)")
    single.yaxis.set_major_formatter("{x:g}")
    pooled.set(title="All four together", ylim=(0.0, 100.0))
    pooled.text(0.97, 0.84, "as hqpipe gives them", color=INK, fontsize=8.0, ha="right", transform=pooled.transAxes)
    pooled.text(
        0.97, 0.12, "for independent residuals", color=GREY, fontsize=8.0, ha="right", transform=pooled.transAxes
    )
    error.set(title="RMS error of the estimates", ylabel="%", yscale="log")
    error.yaxis.set_major_formatter("{x:g}")
    for axes in (single, pooled, error):
        axes.set_xticks(range(len(times)), ["none" if time == 0.0 else f"{time:g}" for time in times])
        axes.set_xlabel("disturbance correlated over (s)")
    fits = f"{rows[0]['fits']:.0f} fits a point; grey band: {AIM[0]:.0f}–{AIM[1]:.0f} %"
    named = [(f"seed {seed:.0f} {'●■▲'[i]}", INK) for i, seed in enumerate(seeds)]
    title_row(figure, [*COEFFICIENTS.items(), *named, (fits, GREY)])
    save_figure(figure, path)


@styled
def draw_speed(rows: list[Row], path: Path) -> None:
    """Bars on a logarithmic axis; grey are numpy, torch and ONNX Runtime doing the same."""
    names = [row["model"] for row in rows]
    order = np.argsort([row["ns_per_robot"] for row in rows])
    figure = new_figure(0.9 + 0.27 * len(rows))
    axes: Axes = figure.subplots()
    for place, index in enumerate(order):
        value = rows[index]["ns_per_robot"]
        peer = any(word in names[index] for word in ("numpy", "torch", "ONNX"))
        axes.barh(place, value, color=PEER if peer else OURS, height=0.66)
        axes.text(
            1.04 * value,
            place,
            f"{value:.0f}",
            va="center",
            fontsize=8.0,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6},
        )
    for level, text in LEVELS.items():
        axes.axvline(level, color=INK, linewidth=0.9, linestyle=(0, (4, 2)), zorder=0.5)
        axes.text(level, -0.75, text, fontsize=8.0, ha="center", va="bottom")
    axes.set_xscale("log")
    axes.set_xlim(10.0, 2.0 * max(row["ns_per_robot"] for row in rows))
    axes.set_ylim(len(rows) - 0.4, -0.75)
    axes.set_yticks(range(len(rows)), [names[index] for index in order])
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xlabel("one sample of 12 joints (ns), 400 robots in a call, one core")
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    title_row(figure, [("hqpipe", OURS), ("the same in numpy, torch, ONNX Runtime", PEER)])
    save_figure(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("actuator", "rollouts", "coverage", "speed"):
        parser.add_argument(f"--{name}", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    if options.actuator:
        draw_actuator(options.actuator, options.out)
    if options.rollouts:
        shutil.copyfile(options.rollouts / "distribution.png", options.out / "claim_distribution.png")
    if options.coverage:
        draw_coverage(read_csv(options.coverage), options.out / "claim_intervals.png")
    if options.speed:
        draw_speed(read_csv(options.speed), options.out / "claim_step_time.png")


if __name__ == "__main__":
    main()
