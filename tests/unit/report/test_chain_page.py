"""The page of a whole chain: every section, what is missing with its command, foreign names, no network."""

from __future__ import annotations

import dataclasses
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from chain_cases import FIGURES, STAGES, chain

from hqpipe.errors import UsageError
from hqpipe.report.chain_page import write_report
from hqpipe.report.chain_sections import SECTIONS

VOID = {"meta", "br", "img"}


class Reader(HTMLParser):
    """Words, tags with their attributes, and whether every tag is closed in order."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[tuple[str, dict]] = []
        self.words: list[str] = []
        self.feed(page)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))


def shown(folder: Path, *given, **walk) -> Reader:
    return Reader(write_report(folder, chain(folder, *given, **walk)).read_text(encoding="utf-8"))


def test_film_numbers_and_every_section_in_the_order_of_the_chain(tmp_path):
    page = shown(tmp_path)
    first = next(attributes for tag, attributes in page.tags if tag == "img")
    assert first["src"].startswith("data:image/gif;base64,")
    titles = [section.title for section in SECTIONS]
    assert [section.artifact for section in SECTIONS] == list(STAGES)
    places = [page.text.index(title) for title in ("where 1.00 is ordered", *titles, "Where it comes from")]
    assert places == sorted(places)
    for number in ("0.99 m/s", "1 of 2", "67.4 N·m → 6.3 N·m", "104 µs", "4 min 0 s"):
        assert number in page.text
    assert "command delay" in page.text and "from 67.4 N·m down to 6.3 N·m" in page.text
    assert "latency, µs ✓ passed 104 ≤ 1,000" in page.text
    assert "speed error of the walks, m/s ✗ missed – ≤ 0.15" in page.text, "a walk that nobody finished is no pass"
    assert "after 3.2 s" in page.text


def test_every_result_says_where_it_comes_from(tmp_path):
    page = shown(tmp_path)
    for name in STAGES:
        key = f"{name}{'0' * 64}"[:12]
        assert f"artifacts/{name} · key {key} · seed 7 · profile ci · 30 s" in page.text
    assert "abcdef012345 + changes" in page.text and "numpy 2.4.6" in page.text and "scipy" not in page.text
    assert "seed 1900, plant as designed" in page.text
    for name, figures in FIGURES.items():
        assert all(f"artifacts/{name}/{figure}" in page.text for figure in figures)


def test_the_page_needs_nothing_from_outside(tmp_path):
    page = shown(tmp_path)
    links = [value for _, attributes in page.tags for key, value in attributes.items() if key in ("src", "href")]
    assert all(link.startswith("data:image/") or link == "diagnosis.html" for link in links)
    assert not re.search(r"https?:|url\(|@import|<script|<link", (tmp_path / "report.html").read_text(encoding="utf-8"))
    assert all(attributes["alt"] for tag, attributes in page.tags if tag == "img")


def test_names_are_escaped(tmp_path):
    page = shown(tmp_path)
    assert "Hyd <3>" in page.text and "wild <net>" in page.text
    assert {tag for tag, _ in page.tags}.isdisjoint({"net", "3"})


def test_what_is_missing_is_named_with_its_command(tmp_path):
    page = shown(tmp_path, ("onnx",))
    for name, stage in STAGES.items():
        wanted = f"hqpipe {stage} --profile ci makes artifacts/{name}"
        assert (wanted in page.text) == (name != "onnx")
    assert page.text.count("hqpipe validate --profile ci tells") == 2, "falls and latency"
    assert "hqpipe diagnose --profile ci tells" in page.text


def test_a_figure_that_was_not_made_is_named(tmp_path):
    given = chain(tmp_path)
    (tmp_path / "actuator" / "stress.png").unlink()
    page = Reader(write_report(tmp_path, given).read_text(encoding="utf-8"))
    assert "artifacts/actuator holds no stress.png" in page.text and "hqpipe fit-actuator writes it" in page.text


def test_folders_without_a_manifest_show_their_files(tmp_path):
    given = chain(tmp_path)
    bare = {name: dataclasses.replace(part, record=None) for name, part in given.parts.items()}
    page = Reader(write_report(tmp_path, dataclasses.replace(given, parts=bare)).read_text(encoding="utf-8"))
    assert page.text.count("a folder without a manifest") == len(STAGES)
    assert "from 67.4 N·m down to 6.3 N·m" in page.text and "no result has a manifest" in page.text


def test_a_record_of_an_earlier_version_is_told(tmp_path):
    given = chain(tmp_path)
    record = given.parts["validation"].record
    earlier = {**record, "metrics": {**record["metrics"], "latency": {"p99_us": 256.9}}}
    old = dataclasses.replace(given.parts["validation"], record=earlier)
    broken = dataclasses.replace(given, parts={**given.parts, "validation": old})
    with pytest.raises(UsageError, match=r"expected metrics\.latency\.median_us: make it again with `hqpipe validate"):
        write_report(tmp_path, broken)


def test_a_fall_comes_first_and_notes_stand_above_the_results(tmp_path):
    given = chain(tmp_path, fall_time=3.25, order=(0.6, -0.2, 0.3), play=0.5, plant={"supply": {"pressure": 1e7}})
    noted = dataclasses.replace(given, notes=["policy was made from another actuator <x>"])
    page = Reader(write_report(tmp_path, noted).read_text(encoding="utf-8"))
    assert "The exported policy fell after 3.2 s, having walked at 0.99 m/s where 0.60 is ordered." in page.text
    assert "Ordered: 0.6 m/s ahead, 0.2 m/s to the right, turning 0.3 rad/s" in page.text
    assert "shown at 0.5 times its speed" in page.text and 'plant {"supply": {"pressure": 10000000.0}}' in page.text
    assert page.text.index("another actuator <x>") < page.text.index(SECTIONS[0].title)


def test_the_same_chain_gives_the_same_bytes(tmp_path):
    pages = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        pages.append(write_report(tmp_path / name, chain(tmp_path / name)).read_bytes())
    assert pages[0] == pages[1]
