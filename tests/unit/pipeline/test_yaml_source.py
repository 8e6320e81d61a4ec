"""Text that is no configuration ends as one error with file, line and fix, whatever it is."""

from __future__ import annotations

import codecs

import pytest

from hqpipe.errors import ConfigError
from hqpipe.pipeline.yaml_source import MAX_BYTES, parse_yaml, read_yaml

LAUGHS = "a0: &a0 [x]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12))
CHAIN = "a0: &a0 [x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}]\n" for i in range(1, 2000))


def read(tmp_path, content: bytes | str):
    path = tmp_path / "pipeline.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
    return read_yaml(path)


@pytest.mark.parametrize(
    ("content", "part"),
    [
        ("robot: x\na: " + "[" * 10_000, "pipeline.yaml:2: nested more than 50 deep"),
        ("robot: x\na: " + "{a: " * 10_000, "pipeline.yaml:2: nested more than 50 deep"),
        ("robot: x\na: " + "[" * 60 + "]" * 60, "pipeline.yaml:2: nested more than 50 deep"),
        ("".join(f"{'  ' * i}a:\n" for i in range(300)), "nested more than 50 deep"),
        (LAUGHS, "more than 100000 values"),
        (CHAIN, "nested more than 50 deep"),
        ("a: &a [*a]", "pipeline.yaml:1: not valid YAML: an alias of what it stands in"),
        ("a: &a {b: *a}", "an alias of what it stands in"),
        ('a: "\\udc80"', "pipeline.yaml:1: text that holds half of a character"),
        ('"\\udc80": 1', "pipeline.yaml:1: text that holds half of a character"),
        ("a: *b", "pipeline.yaml:1: not valid YAML: found undefined alias"),
        ("robot: x\nseed: " + "9" * 400, "pipeline.yaml:2: a whole number of 400 digits"),
        ("seed: " + "9" * 5000, "a whole number of 5000 digits"),
        ("seed: -" + "9" * 400, "a whole number of 401 digits"),
        ("robot: x\n1: y", "pipeline.yaml:2: a field must be text, got '1'"),
        ("a:\n  null: y", "pipeline.yaml:2: a field must be text, got 'null'"),
        ("true: y", "a field must be text, got 'true'"),
        ("yes: y", "a field must be text, got 'yes'"),
        ("1.5: y", "a field must be text"),
        ("? [a, b]\n: c", "a field must be text, got a list or mapping"),
        ("a: {[b]: c}", "a field must be text, got a list or mapping"),
        ("2020-01-01: x", "a value of the type 'timestamp'"),
        ("a: 2020-99-99", "a value of the type 'timestamp'"),
        ("a: !!binary aGk=", "a value of the type 'binary'"),
        ("a: !!set {b}", "a value of the type 'set'"),
        ("a: !!python/object/apply:os.getcwd []", "not valid YAML here: a value of the type 'python/object/apply"),
        ("a: !!int x", "not valid YAML"),
        ("a:\n\t- b", "pipeline.yaml:2: not valid YAML"),
        ("a: b\n  c: d", "pipeline.yaml:2: not valid YAML"),
        ("a: 1\nb: 'x\nc: 2\n", "not valid YAML"),
        ('a: 1\nb: "x\nc: 2\n', "line 2"),
        ("a: [1,\nb: 2", "not valid YAML"),
        ("a: 1\n---\nb: 2", "expected a single document"),
        ("a: \x00", "not valid YAML"),
        ("<<: 3", "not valid YAML"),
        ("a: 1\na: 2", "'a' stands twice (lines 1 and 2)"),
        ("- a", "expected fields such as 'robot:'"),
        ("x", "expected fields such as 'robot:'"),
        ("%", "not valid YAML"),
        ("a: " + "x" * MAX_BYTES, f"expected at most {MAX_BYTES}"),
        (b"robot: x\nseed: \xff\n", "pipeline.yaml:2: not UTF-8 text"),
        ("robot: x".encode("utf-16"), "not UTF-8 text"),
        (b"\x89PNG\r\n\x1a\n\x00\x00", "not UTF-8 text"),
    ],
)
def test_one_error_with_file_line_and_fix(tmp_path, content, part):
    with pytest.raises(ConfigError) as caught:
        read(tmp_path, content)
    error = caught.value
    assert part in str(error) and str(error).startswith("pipeline.yaml") and len(str(error)) < 400
    assert error.file == str(tmp_path / "pipeline.yaml") and error.fix


def test_no_file_to_read(tmp_path):
    (tmp_path / "folder").mkdir()
    for name in ("folder", "absent", "x" * 300):
        with pytest.raises(ConfigError, match="cannot be read") as caught:
            read_yaml(tmp_path / name)
        assert caught.value.file == str(tmp_path / name) and caught.value.fix


def test_what_is_still_read(tmp_path):
    source = read(tmp_path, codecs.BOM_UTF8 + b"robot: x\r\nb: &b {c: 1}\r\nd: {<<: *b, e: 2}\r\nf: *b\r\n")
    assert source.data == {"robot": "x", "b": {"c": 1}, "d": {"c": 1, "e": 2}, "f": {"c": 1}}
    assert source.lines[("d", "e")] == 3 and source.where(("d", "c")) == "pipeline.yaml:3"
    assert read(tmp_path, "").data == {} and read(tmp_path, "# nothing\n").data == {}
    assert read(tmp_path, "'1': x").data == {"1": "x"}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1e9", 1e9),
        ("-2.5E+3", -2500.0),
        ("1.e2", 100.0),
        ("e9", "e9"),
        ("0x10", 16),
        ("1e999", float("inf")),
        ("1:30", "1:30"),
        ("1:30.5", "1:30.5"),
    ],
)
def test_numbers_are_those_of_yaml_1_2(text, value):
    assert parse_yaml(text)[0] == value
