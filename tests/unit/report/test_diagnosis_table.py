"""The diagnosis in the terminal: at most ten lines that say the same."""

from __future__ import annotations

import io
import subprocess
import sys

import pytest
from diagnosis_cases import CASES, QUADRUPED, cause, explained, mixed_units, not_identifiable, unknown
from rich.console import Console

from hqpipe.report.diagnosis_table import MAX_LINES, bar, diagnosis_table


def lines_of(content, width=120) -> list[str]:
    console = Console(file=io.StringIO(), width=width)
    console.print(diagnosis_table(content), highlight=False)
    return console.file.getvalue().rstrip("\n").split("\n")


def crowded():
    case = explained()
    case["causes"] = [cause(f"effect_{i}", list(QUADRUPED), 0.1, ("ratio", 0.1, 0.01, "1")) for i in range(9)]
    case["unexplained"] = unknown()["unexplained"]
    case["next_experiment"] = "record " + "a very long trial " * 40
    case["warnings"] = ["something that takes more than a line of an ordinary terminal " * 4] * 7
    return case


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize("case", [*CASES.values(), crowded])
def test_ten_lines_at_most_and_none_too_wide(case, width):
    lines = lines_of(case(), width)
    assert len(lines) <= MAX_LINES and max(map(len, lines)) <= width


def test_an_explained_gap():
    text = lines_of(explained())
    assert text[0].startswith("✓ explained")
    assert (
        "34% → 3.1% of spread, 91% smaller" in text[1]
        and "noise floor 1.1%" in text[1]
        and "persistence 46%" in text[1]
    )
    assert "67.4 → 6.3 N·m" in text[2] and "noise floor 2.1" in text[2] and "persistence 91" in text[2]
    assert "47%  command delay · all 12 joints · delay 4.80 ms · or channel skew" in text[3]
    assert "27%  valve deadband · LFK · half width 6.20 mrad" in text[4]
    assert text[3].count("█") > text[4].count("█") > text[5].count("█")
    assert any(line.startswith("next") and "`" not in line for line in text)


def test_joints_in_different_units_share_no_size_in_a_unit():
    text = lines_of(mixed_units())
    assert "34% → 3.1% of spread, 91% smaller" in text[1] and text[2].startswith("cause")
    assert not any("N·m" in line for line in text[:3])


def test_an_unknown_cause_says_where_and_on_what_it_depends():
    text = "\n".join(lines_of(unknown()))
    assert "? cause unknown" in text and "→" not in text
    assert "100% of the gap, most at RFP, depends on past torque, velocity of neighbours and time" in text


def test_what_is_unknown_is_told_in_the_measure_of_the_causes():
    case = explained()
    case["unexplained"] |= {"share_of_gap": 0.1, "above_noise": True}
    case["gap"]["shrink"] = 0.68
    assert "unknown 32% of the gap" in "\n".join(lines_of(case))


def test_logs_that_cannot_tell_say_why():
    text = "\n".join(lines_of(not_identifiable()))
    assert "– cannot tell" in text and "joint/<name>/position_command" in text and "record the missing" in text


def test_more_causes_than_lines_are_summed():
    text = lines_of(crowded())
    assert any("5 more causes" in line and "50%" in line for line in text)
    assert sum("·  " in line or "effect" in line for line in text) == 4


def test_names_are_not_markup():
    case = explained()
    case["warnings"] = ["[red]LFK[/red] [/] odd"]
    assert any("[red]LFK[/red] [/] odd" in line for line in lines_of(case))


@pytest.mark.parametrize(
    "share,expected", [(0.0, ""), (1.0, "█" * 12), (2.0, "█" * 12), (-1.0, ""), (1e-6, "▏"), (0.5, "█" * 6)]
)
def test_bars(share, expected):
    assert bar(share) == expected.ljust(12)


def test_the_module_imports_neither_rich_nor_plotting():
    heavy = "{'rich', 'matplotlib', 'plotly'}"
    code = f"import hqpipe.report.diagnosis_table, sys; sys.exit(bool({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
