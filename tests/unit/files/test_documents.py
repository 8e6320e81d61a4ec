"""Reading JSON, YAML and CSV: what a message says, and the bounds."""

from __future__ import annotations

import os

import pytest
from damage import ANY_FILE, JSON_FILE, YAML_FILE, refused, refuses_every

from hqpipe.errors import ConfigError, LogError
from hqpipe.files import documents
from hqpipe.files.documents import check_plain, read_json, read_table, read_yaml_mapping
from hqpipe.files.entries import Entry

FIX = "make it again"


def written(tmp_path, text, name="a.json"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    ("text", "field", "words"),
    [
        ('{\n"a": [1,\n}', None, "a.json:3: not JSON (Expecting value at column 1): make it again"),
        ('{"a": {"b": 1, "b": 2}}', "b", "'b' stands twice in one object"),
        ('{"a": [0, 1e999]}', "a[1]", "a[1]: is inf, expected a finite number"),
        ('{"a": {"b": 9223372036854775808}}', "a.b", "a.b: a whole number of 64 bits, expected at most 63"),
        ('{"a": "\\ud800"}', "a", "a: holds half of a character"),
        ('{"a": NaN}', None, "holds NaN, expected a finite number"),
        (b'{\n"a": "\xff"}', None, "a.json:2: not UTF-8 text (invalid start byte at byte 8)"),
        ('{"a": ' + "[" * 70 + "]" * 70 + "}", "a" + "[0]" * 63, "nested more than 64 levels deep"),
    ],
)
def test_json_is_refused_with_place(tmp_path, text, field, words):
    path = written(tmp_path, text)
    error = refused(lambda: read_json(path, FIX), path)
    assert words in str(error) and error.field == field, (str(error), error.field)


@pytest.mark.parametrize(
    ("text", "field", "words"),
    [
        ("a: [1\n", None, "a.yaml:2: not valid YAML (expected ',' or ']'"),
        ("b: 1\na: {c: 1, c: 2}\n", "a.c", "'a.c' stands twice (lines 2 and 2)"),
        ("a: {1: 2}\n", "a", "a: the name 1 is no text, expected it in quotes"),
        ("a: {b: .inf}\n", "a.b", "a.b: is inf, expected a finite number"),
        ("a: 2001-01-01\n", "a", "a: is a date, expected text or a number"),
        ("- 1\n", None, "expected a mapping of fields, got a list"),
    ],
)
def test_yaml_is_refused_with_place(tmp_path, text, field, words):
    path = written(tmp_path, text, "a.yaml")
    error = refused(lambda: read_yaml_mapping(path, FIX), path)
    assert words in str(error) and error.field == field, (str(error), error.field)


def test_every_damage_but_other_fields_is_refused(tmp_path):
    sound = ("a number", "null", "text", "a list", "an empty object", "an unknown field", "an empty mapping")
    for read, damages, name in ((read_json, JSON_FILE, "a.json"), (read_yaml_mapping, YAML_FILE, "a.yaml")):
        path = written(tmp_path, '{"field": ["value", "value", "value", "value", "value", "value"]}', name)
        checked = {what: damage for what, damage in (ANY_FILE | damages).items() if what not in sound}
        refuses_every(checked, lambda read=read, path=path: read(path, FIX), path)


def test_anchors_and_merges_of_a_sane_size_are_read(tmp_path):
    path = written(tmp_path, "a: &x {k: 1.5}\nb: {<<: *x, l: [*x, *x]}\n", "a.yaml")
    assert read_yaml_mapping(path, FIX) == {"a": {"k": 1.5}, "b": {"k": 1.5, "l": [{"k": 1.5}, {"k": 1.5}]}}


def test_a_byte_order_mark_is_no_damage(tmp_path):
    assert read_json(written(tmp_path, b"\xef\xbb\xbf{}"), FIX) == {}


def test_sizes_are_bounded_before_a_file_is_read(tmp_path, monkeypatch):
    path = written(tmp_path, "{}")
    monkeypatch.setattr(documents, "LARGEST_JSON", 1)
    assert "has 2 bytes, expected at most 1" in str(refused(lambda: read_json(path, FIX), path))


def test_a_pipe_is_refused_without_waiting_for_a_writer(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    assert "is no regular file" in str(refused(lambda: read_json(tmp_path / "pipe", FIX), tmp_path / "pipe"))


def test_a_name_that_is_too_long_is_refused(tmp_path):
    path = tmp_path / ("a" * 300)
    assert "File name too long" in str(pytest.raises(ConfigError, read_json, path, FIX).value)


def test_the_kind_of_error_is_the_caller_s(tmp_path):
    path = written(tmp_path, "[")
    refused(lambda: read_json(path, FIX, LogError), path, exit_code=1)


def test_values_are_counted(monkeypatch):
    monkeypatch.setattr(documents, "MOST_VALUES", 10)
    with pytest.raises(Exception, match="holds more than 10 values"):
        check_plain([[None] * 11])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a\n1\n", "no column 'b'"),
        ("a,b\n1\n", "a.csv:2: expected 2 cells as in the head"),
        ("a,b\n1,2,3\n", "a.csv:2: expected 2 cells as in the head"),
        ('a,b\n"1,2\n', "not CSV"),
        ("a,b\n" + "1" * 200_000 + ",2\n", "not CSV (field larger than field limit"),
    ],
)
def test_a_table_is_refused_with_its_line(tmp_path, text, words):
    path = written(tmp_path, text, "a.csv")
    assert words in str(refused(lambda: read_table(path, ("a", "b"), FIX), path))


def test_an_entry_names_the_field_that_it_is(tmp_path):
    top = Entry({"a": {"b": [1.0, "x"]}}, tmp_path / "f.json", FIX)
    for read, field in (
        (lambda: top.mapping(("a", "c")), "c"),
        (lambda: top.mapping(("b",)), "a"),
        (lambda: top.inner("a").mapping(("b",))["b"].numbers(2), "a.b[1]"),
        (lambda: top.inner("a").mapping(("b",))["b"].numbers(3), "a.b"),
        (lambda: top.inner("a").number(), "a"),
    ):
        assert refused(read, tmp_path / "f.json").field == field
