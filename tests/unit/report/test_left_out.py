"""What was left out of an answer is told in the terminal and on the page."""

from __future__ import annotations

import io

from diagnosis_cases import explained, write_case
from rich.console import Console

from hqpipe.report.diagnosis_page import write_page
from hqpipe.report.diagnosis_table import MAX_LINES, diagnosis_table
from hqpipe.report.diagnosis_words import left_out_words

ENTRIES = [
    {
        "trials": ["a.parquet"],
        "joints": [],
        "channel": None,
        "kind": "rows_out_of_order",
        "reason": "<b>rows",
        "fix": "restore",
    },
    {
        "trials": ["b.parquet"],
        "joints": ["LFK"],
        "channel": None,
        "kind": "sign_flipped",
        "reason": "sign",
        "fix": "multiply",
    },
    {
        "trials": ["b.parquet"],
        "joints": ["RFK"],
        "channel": "velocity",
        "kind": "velocity_mismatch",
        "reason": "v",
        "fix": "f",
    },
]


def lines_of(content):
    console = Console(file=io.StringIO(), width=120)
    console.print(diagnosis_table(content), highlight=False)
    return console.file.getvalue().rstrip("\n").split("\n")


def test_one_line_in_the_terminal():
    (line,) = [text for text in lines_of(explained() | {"left_out": ENTRIES}) if text.startswith("without")]
    assert line.split(None, 1)[1].strip() == (
        "a.parquet (rows out of order); LFK (sign flipped); velocity of RFK (velocity mismatch)"
    )
    assert not any(text.startswith("without") for text in lines_of(explained() | {"left_out": []}))


def test_ten_lines_are_enough_also_then():
    case = explained() | {"left_out": ENTRIES, "warnings": ["w"]}
    case["causes"] = case["causes"] * 9
    assert len(lines_of(case)) <= MAX_LINES


def test_many_trials_are_counted():
    entry = ENTRIES[0] | {"trials": [f"{i}.parquet" for i in range(9)]}
    assert left_out_words(entry) == "9 trials"


def test_the_page_gives_reason_and_fix_as_text(tmp_path):
    page = write_page(write_case(tmp_path, explained() | {"left_out": ENTRIES})).read_text()
    assert "Left out of the answer" in page and "&lt;b&gt;rows; restore" in page
    other = write_page(write_case(tmp_path / "none", explained())).read_text()
    assert "Left out of the answer" not in other
