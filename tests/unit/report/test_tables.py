"""Terminal tables say what the numbers say."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from hqpipe.report.tables import coefficient_table, comparison_table, constants_table, scenario_table


def text_of(table) -> str:
    console = Console(file=io.StringIO(), width=140)
    console.print(table)
    return console.file.getvalue()


def score_row(model, rmse, joint="all", logs="held-out"):
    stats = {"rmse": rmse, "loaded_rmse": 2 * rmse, "loaded_mape": None}
    return {
        "logs": logs,
        "model": model,
        "joint": joint,
        "trial": "all",
        "one_step": stats,
        "free_run": stats,
        "noise_floor": 2.0,
        "loaded_threshold": None if joint == "all" else 50.0,
    }


ROWS = [
    score_row("bad", 120.0),
    score_row("good", 7.0),
    score_row("persistence", 80.0),
    score_row("bad", 1.0, "LFR"),
    *(score_row(model, rmse, logs="stress") for model, rmse in (("bad", 900.0), ("good", float("inf")))),
]


def test_comparison_has_one_line_per_model_the_best_first():
    text = text_of(comparison_table(ROWS, {"good": 1.25}, {"good": 3.5}))
    assert text.index("good") < text.index("persistence") < text.index("bad")
    assert text.count("bad") == text.count("good") == 1
    assert "noise floor 2 N·m" in text and "exceeds 50 N·m" in text
    good = next(line for line in text.splitlines() if "good" in line)
    assert good.split() == ["good", "7", "7", "14", "diverged", "1.25", "3.5"]
    assert "%" not in text, "a column that no row fills is left out"


def test_comparison_fits_100_columns():
    names = ["per joint, free-running", "stiff PD (fitted gains)"]
    rows = [score_row(name, 123.4, logs=logs) for name in names for logs in ("held-out", "stress")]
    for row in rows:
        row["free_run"] = row["free_run"] | {"loaded_mape": 99.9}
    console = Console(file=io.StringIO(), width=100)
    console.print(comparison_table(rows, dict.fromkeys(names, 100.0), dict.fromkeys(names, 100.0)))
    lines = console.file.getvalue().splitlines()
    assert all(sum(name in line for line in lines) == 1 for name in names), "no name is cut or wrapped"
    assert "…" not in console.file.getvalue()


def test_the_best_is_bold_and_what_persistence_beats_is_red():
    columns = {c.header: list(c.cells) for c in comparison_table(ROWS).columns}
    assert columns["free run\nN·m"] == ["[bold]7[/bold]", "80", "[red]120[/red]"]
    assert columns["stress\nN·m"] == ["diverged", "–", "[bold]900[/bold]"]


@pytest.mark.parametrize(
    "change,expected",
    [
        ({}, "537 520…550"),
        ({"identifiable": False, "value": None}, "not identifiable"),
        ({"at_bound": True}, "at bound"),
    ],
)
def test_coefficients_show_their_interval_or_why_not(change, expected):
    coefficient = {"name": "k1", "unit": "N/m", "value": 537.0, "ci95": (520.0, 550.0)}
    coefficient |= {"identifiable": True, "at_bound": False} | change
    joint = {"joint": "LFR", "coefficients": [coefficient], "free_run_rmse": 3.21}
    text = text_of(coefficient_table({"model": "hydraulic", "scope": "per_joint", "dt": 1e-3, "fits": [joint]}))
    assert expected in text and "k1 (N/m)" in text and "3.21" in text


def constant_row(joint, model, value, expected, quantity="flow gain"):
    return {"joint": joint, "model": model, "quantity": quantity, "unit": "1/s", "value": value, "expected": expected}


def test_constants_are_told_once_for_all_joints():
    rows = [constant_row(joint, "mine", value, 28.0) for joint, value in (("LFR", 20.0), ("LFP", 26.0), ("LFK", 31.0))]
    rows += [constant_row("LFR", "other", 2.5e-6, None, "leak")]
    text = text_of(constants_table(rows))
    (gain,) = [line for line in text.splitlines() if line.startswith(" flow gain") or line.startswith("flow gain")]
    assert "26 20…31" in gain and gain.rstrip().endswith("28")
    assert "2.50e-06" in text and "by design" in text


def test_constants_of_an_unknown_machine_have_no_column_for_its_design():
    assert "by design" not in text_of(constants_table([constant_row("hip", "mine", 20.0, None)]))


def test_scenarios_show_the_worst_in_readable_units_and_mark_what_is_missed():
    walked = {
        "speed_error": 0.0123,
        "drift": 2.5,
        "foot_clearance": 0.125,
        "lowest_supply": 2.06e7,
        "torque_rmse": None,
    }
    rows = [
        {"scenario": "forward_10", "walks": 4, "falls": 0, "worst": walked, "limits": {"falls": 0, "drift": 1.0}},
        {"scenario": "stand", "walks": 4, "falls": 4, "worst": {"drift": None}, "limits": {"falls": 0, "drift": 0.1}},
    ]
    table = scenario_table(rows)
    text = text_of(table)
    assert "0/4" in text and "12.5" in text and "206" in text
    assert "torque" not in text, "no scenario has it"
    cells = {column.header: list(column.cells) for column in table.columns}
    assert cells["drift\nm"] == ["[red]2.50[/red]", "[red]–[/red]"]
    assert cells["falls"] == ["0/4", "[red]4/4[/red]"]
    assert cells["speed\nerror\nm/s"] == ["0.012", ""]


def test_every_measure_of_a_scenario_fits_a_terminal_of_120_columns():
    from hqpipe.report.tables import _SCENARIO_COLUMNS

    worst = {name: 1234.0 / 10**decimals / scale for _, name, scale, decimals in _SCENARIO_COLUMNS}  # four digits each
    text = text_of(
        scenario_table([{"scenario": "push_forward", "walks": 32, "falls": 32, "worst": worst, "limits": {"falls": 0}}])
    )
    assert "push_forward" in text and "32/32" in text and "…" not in text
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 120
