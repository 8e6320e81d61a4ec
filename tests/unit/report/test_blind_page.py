"""The page and the tables of the blind score say what score.json says."""

from __future__ import annotations

import io
import re
from html.parser import HTMLParser

import pytest
from rich.console import Console

from hqpipe.report.blind_page import page, write_page
from hqpipe.report.blind_table import MAX_MISSES, interval_text, reached_text, score_tables, share_text


def share(right: int, of: int) -> dict:
    return {"right": right, "of": of, "share": right / of if of else None, "ci95": [0.62, 0.91] if of else [0.0, 1.0]}


@pytest.fixture
def score() -> dict:
    bins = [{"low": 0.2 * i, "high": 0.2 * i + 0.2, "mean_probability": None, **share(0, 0)} for i in range(4)]
    bins.append({"low": 0.8, "high": 1.0, "mean_probability": 0.93, **share(9, 10)})
    row = {"measure": "exact set of causes", "aim": "≥ 90 %", "met": False, **share(16, 20), "strict": share(15, 20)}
    idle = {"measure": "nothing tried", "aim": "≥ 98 %", "met": None, **share(0, 0), "strict": share(0, 0)}
    miss = {"case": "case_007", "kind": "single", "truth": "backlash & <b>", "answer": "[unknown]", "missed": "top"}
    return {
        "cases": 20,
        "without": [],
        "aims": [row, idle],
        "more": [{"measure": "precision", **share(9, 10)}],
        "calibration": {"brier": 0.081, "causes": 10, "bins": bins},
        "detection": [{"effect": name, "size": "small", **share(1, 2)} for name in ("any", "backlash")],
        "confusion": {"truth": ["backlash"], "named": ["backlash", "(no name)"], "counts": [[3, 1]]},
        "shrink": [{"case": "case_003", "true": 0.5, "claimed": 0.6, "ci95": [0.55, 0.65], "covered": False}],
        "misses": [miss],
    }


def text_of(score: dict) -> str:
    console = Console(file=io.StringIO(), width=200)
    for part in score_tables(score):
        console.print(part, highlight=False)
    return console.file.getvalue()


class Reader(HTMLParser):
    """Collects text, and fails on anything that the page would have to load."""

    def __init__(self) -> None:
        super().__init__()
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list) -> None:
        given = dict(attrs)
        assert tag not in ("script", "link", "img", "iframe"), f"the page loads a <{tag}>"
        assert "src" not in given and not str(given.get("href", "#")).startswith("http")

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def read(text: str) -> str:
    reader = Reader()
    reader.feed(text)
    return " ".join(reader.text)


def test_page_is_one_file_and_names_every_number(score, tmp_path):
    said = read(write_page(tmp_path / "score.html", score).read_text(encoding="utf-8"))
    for expected in ("80.0 % (16 of 20)", "62–91", "75.0 % (15 of 20)", "missed", "0 of 1 aims", "case_007", "0.081"):
        assert expected in said
    assert "backlash & <b>" in said  # escaped, not markup
    assert "0.550 … 0.650" in said


def test_page_is_the_same_every_time(score):
    assert page(score) == page(score)


def test_page_draws_two_figures_without_a_date(score):
    text = page(score)
    assert text.count("<svg") == 2
    assert not re.search(r"<dc:date>", text)


def test_page_without_any_cause(score):
    score["calibration"] = {"brier": None, "causes": 0, "bins": score["calibration"]["bins"][:4]}
    score["detection"], score["shrink"], score["misses"] = [], [], []
    said = read(page(score))
    assert "No cause was named" in said
    assert "No case with the exact set" in said


def test_page_says_what_the_library_lacked(score):
    assert "library without backlash" in read(page(score | {"without": ["backlash"]}))


def test_terminal_shows_aims_and_misses(score):
    text = text_of(score)
    for expected in (
        "80.0 % (16 of 20)",
        "75.0 % (15 of 20)",
        "no",
        "precision",
        "0.081",
        "[unknown]",
        "backlash & <b>",
    ):
        assert expected in text


def test_terminal_shows_the_first_misses_only(score):
    score["misses"] = [score["misses"][0] | {"case": f"case_{i:03d}"} for i in range(MAX_MISSES + 5)]
    text = text_of(score)
    assert f"case_{MAX_MISSES - 1:03d}" in text
    assert f"case_{MAX_MISSES:03d}" not in text


def test_a_share_of_nothing_is_a_dash():
    assert (share_text(share(0, 0)), interval_text(share(0, 0))) == ("– (none)", "–")


def limit(ratio: float | None, **changes) -> dict:
    curve = {"cases": 60, "named": 30, "low": 0.0625, "high": 2.0, "slope": 3.0, "middle": 0.3, "reason": ""}
    curve |= {"limit": 0.66, "limit_ci95": [0.5, None]}
    bare = curve | {"slope": None, "middle": None, "limit": None, "limit_ci95": None, "reason": "named at <no> size"}
    entry = {"low": 0.0625, "high": 2.0, "diagnosis": share(30, 60), "oracle": share(40, 60)}
    axis = {"text": "size", "diagnosis": curve, "oracle": curve if ratio else bare, "ratio": ratio, "least_ratio": None}
    axis |= {"reason": "" if ratio else "oracle: named at <no> size", "ratio_ci95": [1.1, 1.8], "bins": [entry]}
    effect = {"effect": "backlash", "cases": 60, "named": 30, "oracle": 40, "limit": 0.66, "oracle_limit": None}
    row = {"measure": "smallest effect", "aim": "≤ 1.5 ×", "met": True, "ratio": ratio, "ci95": [1.1, 1.8], "of": 60}
    row |= {"least_ratio": None, "limits": [0.66, 0.5], "reason": axis["reason"], "strict": {"ratio": 1.7}}
    false = share(2, 60)
    return {
        "cases": 60,
        "aim": row | changes,
        "axes": {"factor": axis},
        "effects": [effect | {"ratio": None, "reason": ["", "named at no size"]}],
        "false_names": false,
    }


def test_limit_of_detection_is_a_row_and_a_section(score):
    found = limit(1.32)
    score |= {"aims": [*score["aims"], found["aim"]], "limit": found}
    said = read(page(score))
    for expected in ("1.32 × (0.66 against 0.50)", "1.10–1.80", "1.70 ×", "Limit of detection", "from 0.50", "2 of 60"):
        assert expected in said
    assert page(score).count("<svg") == 3
    assert "1.32 ×" in text_of(score)


def test_limit_that_is_not_known_says_why(score):
    found = limit(None, met=None)
    score |= {"aims": [*score["aims"], found["aim"]], "limit": found}
    said = read(page(score))
    assert "– (oracle: named at <no> size)" in said
    assert "0 of 1 aims" in said
    assert "named at" in text_of(score)


def test_no_section_without_faint_cases(score):
    assert "Limit of detection" not in page(score)
    assert "Limit of detection" not in page(score | {"limit": None})


@pytest.mark.parametrize(
    ("row", "text"),
    [
        ({"ratio": 1.25}, "1.25 ×"),
        ({"ratio": None, "least_ratio": 2.0, "reason": "diagnosis: why"}, "> 2.00 × (diagnosis: why)"),
        ({"ratio": None}, "–"),
    ],
)
def test_ratio_as_text(row, text):
    assert reached_text(row) == text
