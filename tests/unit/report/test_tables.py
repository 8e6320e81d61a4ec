"""Terminal tables say what the numbers say."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from hqpipe.report.tables import coefficient_table, comparison_table, summary_lines, where_table

DIAGNOSIS = {
    "verdict": "unknown",
    "gap": {"unit": "N·m", "window_s": 0.1, "before": 67.4, "noise_floor": 2.1, "persistence": 91.0},
    "where": [{"layer": "actuator", "joint": f"J{i}", "regime": "high_speed", "share": 0.05} for i in range(14)],
    "causes": [],
    "unexplained": {"depends_on": [{"signal": "past_command", "joints": ["J1"], "share": 0.8}]},
    "next_experiment": None,
    "warnings": ["no candidate effect was tried"],
}


def text_of(table) -> str:
    console = Console(file=io.StringIO(), width=140)
    console.print(table)
    return console.file.getvalue()


def test_where_is_ten_lines():
    text = text_of(where_table(DIAGNOSIS))
    assert "J9" in text and "J10" not in text and "high speed" in text


def test_summary_states_verdict_numbers_place_and_warnings():
    lines = summary_lines(DIAGNOSIS)
    assert lines[0] == "there is a gap, and its cause is not known"
    assert "67.4 N·m" in lines[1] and "noise floor 2.1" in lines[1] and "persistence 91" in lines[1]
    assert lines[2] == "where: J0 high speed 5%, J1 high speed 5%, J2 high speed 5%"
    assert "past command 80%" in lines[3]
    assert lines[-1] == "warning: no candidate effect was tried"


def test_summary_of_logs_that_cannot_tell():
    lines = summary_lines(
        DIAGNOSIS | {"verdict": "not_identifiable", "gap": None, "where": [], "next_experiment": "record more"}
    )
    assert lines[0] == "these logs cannot tell" and "next: record more" in lines


def test_comparison_is_sorted_and_marks_what_persistence_beats():
    def row(model, rmse, skill, joint="all"):
        stats = {"rmse": rmse, "loaded_rmse": None}
        return {
            "model": model,
            "joint": joint,
            "trial": "all",
            "one_step": stats,
            "free_run": stats,
            "free_run_skill": skill,
            "noise_floor": 2.0,
        }

    text = text_of(comparison_table([row("bad", 120.0, -0.2), row("good", 7.0, 0.93), row("bad", 1.0, 0.9, "LFR")]))
    assert text.index("good") < text.index("bad")
    assert "+20%" in text and "-93%" in text and text.count("bad") == 1


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
