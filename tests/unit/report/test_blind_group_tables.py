"""Tables of the blind score by family, by effect and beside answers that look at no logs."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from hqpipe.report.blind_groups import baseline_rows, effect_rows, family_rows, group_sections, group_tables


def share(right: int, of: int) -> dict:
    return {"right": right, "of": of, "share": right / of if of else None, "ci95": [0.0, 1.0]}


def measure(name: str, right: int, of: int, strict: int) -> dict:
    return {"measure": name, "aim": "", "met": None, **share(right, of), "strict": share(strict, of)}


@pytest.fixture
def score() -> dict:
    figures = {
        "cases": 8,
        "hidden": 3,
        "not_asked": 2,
        "measures": [measure("exact set", 6, 8, 5), measure("never tried", 0, 0, 0)],
        "probability": 0.815,
        "utility": 0.9375,
    }
    numbers = {"median_error": 0.042, "close": share(3, 4), "covered": share(4, 4)}
    idle = {"median_error": None, "close": share(0, 0), "covered": share(0, 0)}
    backlash = {"effect": "backlash", "family": "arm", "cases": 4, "outside": False, "named": share(4, 4)}
    hidden = {"effect": "hysteresis", "family": "arm", "cases": 2, "outside": True, "named": share(1, 2)}
    return {
        "families": [{"family": "arm", **figures, "parameters": numbers}],
        "effects": [
            backlash | {"strict": share(3, 4), "probability": 0.8, "falsely": 1, "parameters": numbers},
            hidden | {"strict": share(1, 2), "probability": None, "falsely": 0, "parameters": idle},
        ],
        "baselines": [{"answers": name, **figures} for name in ("diagnosis", "null", "random")],
    }


def test_families_say_what_counts_strictly(score):
    head, rows = family_rows(score["families"])
    assert head == ("measure", "arm (8 cases)")
    said = dict(rows)
    assert said["exact set"] == "75.0 % (6 of 8) [5]"
    assert "never tried" not in said
    assert (said["m_utl"], said["mean probability of the true causes"]) == ("0.938", "0.81")
    assert (said["effects that make no gap in their case"], said["effects that make one and are not asked for"]) == (
        "3",
        "2",
    )
    assert said["median error of the parameters"] == "4.2 %"


def test_effects_say_how_they_were_answered(score):
    _, rows = effect_rows(score["effects"])
    assert rows[0][1:8] == ("backlash", "4", "100.0 % of 4", "75.0 % of 4", "0.80", "1", "4.2 %")
    assert rows[1][1] == "hysteresis (outside the library)" and rows[1][5] == "–"


def test_baselines_stand_beside_the_diagnosis(score):
    head, rows = baseline_rows(score["baselines"])
    assert head == ("measure", "diagnosis", "Null", "Random")
    assert rows[0] == ("exact set", "75.0 % of 8", "75.0 % of 8", "75.0 % of 8")


def test_page_and_terminal_show_the_same_tables(score):
    console = Console(file=io.StringIO(), width=240)
    for table in group_tables(score):
        console.print(table, highlight=False)
    for text in (console.file.getvalue(), group_sections(score)):
        for expected in ("Null", "75.0 % (6 of 8) [5]", "hysteresis (outside the library)", "0.938"):
            assert expected in text


def test_a_score_without_families_has_no_tables():
    assert group_tables({}) == [] and group_sections({"families": []}) == ""
