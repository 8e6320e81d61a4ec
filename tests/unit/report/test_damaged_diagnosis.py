"""The files of a diagnosis under every damage, as a report reads them."""

from __future__ import annotations

import json

import pytest
from damage import ANY_FILE, JSON_FILE, TEXT_FILE, refuses_every, survives_fields, survives_flips, write_json
from diagnosis_cases import explained, write_case

from hqpipe.gap.answer.schema import read_diagnosis
from hqpipe.report.diagnosis_read import read_files


@pytest.fixture
def folder(tmp_path):
    return write_case(tmp_path, explained())


@pytest.mark.parametrize("damages", [ANY_FILE, JSON_FILE], ids=["any file", "json"])
@pytest.mark.parametrize("name", ["diagnosis.json", "traces.json"])
def test_a_damaged_json_is_refused(folder, name, damages):
    optional = ("missing", "a link to itself") if name == "traces.json" else ()  # a diagnosis may have no traces
    there = {what: damage for what, damage in damages.items() if what not in optional}
    refuses_every(there, lambda: read_files(folder), folder / name)


@pytest.mark.parametrize("damages", [ANY_FILE, TEXT_FILE], ids=["any file", "text"])
def test_a_damaged_table_is_refused(folder, damages):
    optional = ("missing", "a link to itself")  # a diagnosis may have none; cut behind a row it is a whole table
    refuses_every(
        {what: damage for what, damage in damages.items() if what not in optional and not what.startswith("cut")},
        lambda: read_files(folder),
        folder / "residuals.csv",
    )


@pytest.mark.parametrize("name", ["diagnosis.json", "traces.json", "residuals.csv"])
def test_a_flipped_bit_is_refused_or_another_value(folder, name):
    survives_flips(lambda: read_files(folder), folder / name)


@pytest.mark.parametrize("damages", [ANY_FILE, JSON_FILE], ids=["any file", "json"])
def test_a_damaged_diagnosis_is_refused_by_the_checker(folder, damages):
    refuses_every(damages, lambda: read_diagnosis(folder / "diagnosis.json"), folder / "diagnosis.json")


def test_every_wrong_field_is_refused_by_the_checker(folder):
    path = folder / "diagnosis.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    passed = survives_fields(content, write_json, lambda: read_diagnosis(path), path)
    optional = {"reference", "gaps", "causes.0.parameters", "where.0", "causes.0", "logs.joints.0"}
    gone = {name.removesuffix(" missing") for name in passed if name.endswith(" missing")}
    assert all(name in optional or name[-1] == "0" or ".parameters." in name for name in gone), gone
