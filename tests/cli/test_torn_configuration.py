"""Configurations and options that nobody would write on purpose: exit 2, one line, no traceback."""

from __future__ import annotations

import json

import pytest

DEEP, DIGITS, LONG = "[" * 10_000, "9" * 400, "x" * 5000
KEY = "y" * 500  # YAML itself takes keys of up to 1024 characters


def told(answer) -> dict:
    assert answer.code == 2 and answer.err.count("error: ") + answer.err.count("Error: ") == 1, answer.err
    assert "Traceback" not in answer.err and "site-packages" not in answer.err and len(answer.err) < 1000
    return json.loads(answer.out)["error"]


@pytest.mark.parametrize(
    ("value", "part"),
    [
        (DEEP, "nested more than"),
        (DIGITS, "a whole number of 400 digits"),
        ("{1: 2}", "a field must be text"),
        ("&a [*a]", "an alias of what it stands in"),
        ("'x", "not valid YAML"),
        ("[1", "not valid YAML"),
        ("2020-01-01", "timestamp"),
        (LONG, "expected a whole number"),
        ("true", "expected a whole number, got True"),
        ("1.5", "expected a whole number"),
        ("1e3", "expected a whole number, got 1000.0"),
        (".nan", "expected a"),
        ("", "expected a whole number, got None"),
    ],
)
def test_values_of_set(toy, value, part):
    error = told(toy("run", "all", "--set", f"numbers.count={value}", "--json"))
    assert part in error["message"] and error["field"] == "numbers.count" and error["fix"]


@pytest.mark.parametrize(
    "text", ["." * 10_000, "numbers" + ".a" * 10_000 + "=1", LONG, "=", "numbers.=1", LONG + ".a=1"]
)
def test_forms_of_set(toy, text):
    error = told(toy("run", "all", "--set", text, "--json"))
    assert error["field"] == "--set" and error["fix"]


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("robot: toy", f"robot: {LONG}", "robot"),
        ("robot: toy", f"robot: a/{LONG}", "robot"),
        ("robot: toy", "robot: ''", "robot"),
        ("robot: toy", 'robot: "a/\\0"', "robot"),
        ("robot: toy", "robot: nobody", "robot"),
        ("seed: 1", f"seed: 1\nartifacts: {LONG}", "artifacts"),
        ("seed: 1", "seed: 1\nartifacts: ''", "artifacts"),
        ("seed: 1", "seed: true", "seed"),
        ("seed: 1", "seed: 1.5", "seed"),
        ("workers: 2", "workers: true", "workers"),
        ("workers: 2", "workers: 1000000000", "workers"),
        ("workers: 2", "workers: 1.5", "workers"),
        ("profile: default", "profile: 3", "profile"),
        ("profile: default", f"profile: {LONG}", "profile"),
        ("profile: default", "profile: nope", "profile"),
        ("  default: {}", "  default: 3", "profiles.default"),
        ("  default: {}", "  default: {numbers: 3}", "profiles.default.numbers"),
        ("count: 4", f"{KEY}: 4", f"stages.numbers.{KEY}"),
        ("  report: {}", f"  {KEY}: {{}}", f"stages.{KEY}"),
        ("seed: 1", f"seed: 1\n{KEY}: 4", KEY),
    ],
)
def test_values_in_the_file(toy, old, new, field):
    toy.edit(old, new)
    error = told(toy("status", "--json"))
    assert error["field"] == field and error["fix"] and error["file"].endswith("pipeline.yaml")


def test_a_folder_in_place_of_the_file(toy):
    (toy.root / "pipeline.yaml").unlink()
    (toy.root / "pipeline.yaml").mkdir()
    error = told(toy("status", "--json"))
    assert error["file"] == str(toy.root / "pipeline.yaml") and "is no file" in error["message"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("status", "--profile", LONG),
        ("run", "all", "--from", LONG),
        ("run", LONG),
        (LONG,),
        ("square-up", "--numbers", LONG),
        ("square-up", "--numbers", "a\tb/" + LONG),
        ("init", LONG),
        ("diff", LONG, "numbers"),
        ("blind", "make", "--out", LONG),
        ("blind", "score", LONG),
        ("run", "all", "--seed", DIGITS),
        ("run", "all", "--seed", "9" * 5000),
    ],
)
def test_long_names_on_the_command_line(toy, arguments):
    assert told(toy(*arguments, "--json"))["message"]
