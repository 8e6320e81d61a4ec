"""Terminal tables say what the numbers say."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from hqpipe.report.tables import coefficient_table, comparison_table


def text_of(table) -> str:
    console = Console(file=io.StringIO(), width=140)
    console.print(table)
    return console.file.getvalue()


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
