"""Whatever logset.yaml holds: a LogError with file, field and fix, short enough to be read."""

from __future__ import annotations

import pytest

from hqpipe.errors import LogError
from hqpipe.logs.log_set import read_log_set

HEAD = "format: hqpipe-log/1\n"
TRIALS = "trials:\n  - {file: a.parquet, split: fit}\n  - {file: b.parquet, split: heldout}\n"
LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join(['*' + chr(97 + i)] * 9)}]\n" for i in range(12)
)


def refusal(logs, content):
    (logs / "logset.yaml").write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(LogError) as info:
        read_log_set(logs)
    error = info.value
    assert error.file == str(logs / "logset.yaml") and error.fix
    assert len(str(error)) < 600 + len(str(logs))
    return error


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("[" * 10_000, "nested too deep"),
        ("{a: " * 10_000, "nested too deep"),
        (HEAD + "trials: &t [*t]\n", "nested more than"),
        (LAUGHS, "its aliases spell more values"),
        (LAUGHS.replace("a: &a", "trials: &a").replace("\nb:", "\nformat:"), "its aliases spell more values"),
        (HEAD + LAUGHS.replace("\n", "\n  ").join(["robot:\n  ", "\n"]) + TRIALS, "its aliases spell more values"),
        (b"\xff\xfe\x00format", "not UTF-8"),
        (b"format: \xe9t\xe9\n", "not UTF-8"),
        ("", "is empty"),
        ("- 1\n- 2\n", "got a list"),
        ("just text", "got one value"),
        (HEAD + "1: 2\n" + TRIALS, "the name 1 is no text"),
        (HEAD + "? [a, b]\n: 2\n" + TRIALS, "logset.yaml:2: not valid YAML"),
        (HEAD + "rate_hz: 1\nrate_hz: 2\n" + TRIALS, "'rate_hz' stands twice (lines 2 and 3)"),
        (HEAD + "trials:\n  - {file: a.parquet, split: heldout, split: fit}\n", "'trials[0].split' stands twice"),
        (HEAD + "rate_hz: 2024-99-99\n" + TRIALS, "a value that YAML cannot read"),
        ("trials: \0", "not valid YAML"),
        ("x" * (1 << 23), "expected at most"),
    ],
)
def test_what_is_no_manifest(logs, content, words):
    assert words in str(refusal(logs, content))


@pytest.mark.parametrize(
    "rate",
    [".nan", ".inf", "-.inf", "1.0e+300", "1e300", "true", "0", "-5", "9" * 400, "0x" + "f" * 5000, "[]", "{}", "''"],
)
def test_rate(logs, rate):
    error = refusal(logs, HEAD + f"rate_hz: {rate}\n" + TRIALS)
    assert error.field == "rate_hz" and "rate_hz" in str(error)


@pytest.mark.parametrize("value", ["7", "[]", "{}", "true", ".nan", "''", "2024-01-01", "'" + "x" * 5000 + "'"])
@pytest.mark.parametrize("field", ["format", "base", "control_mode", "effort_source", "trials"])
def test_wrong_types(logs, field, value):
    fields = {"format": "hqpipe-log/1", "trials": "[{file: a.parquet, split: fit}]"} | {field: value}
    assert refusal(logs, "".join(f"{k}: {v}\n" for k, v in fields.items())).field == field


@pytest.mark.parametrize(
    ("entry", "field"),
    [
        ("7", "trials[0]"),
        ("null", "trials[0]"),
        ("{}", "trials[0].file"),
        ("{file: 7, split: fit}", "trials[0].file"),
        ("{file: '', split: fit}", "trials[0].file"),
        ("{file: ., split: fit}", "trials[0].file"),
        ("{file: sub, split: fit}", "trials[0].file"),
        ("{file: /etc/passwd, split: fit}", "trials[0].file"),
        ("{file: sub/../../a.parquet, split: fit}", "trials[0].file"),
        ('{file: "a\\0.parquet", split: fit}', "trials[0].file"),
        ("{file: " + "x" * 5000 + ".parquet, split: fit}", "trials[0].file"),
        ("{file: a.parquet/b.parquet, split: fit}", "trials[0].file"),
        ("{file: broken.parquet, split: fit}", "trials[0].file"),
        ("{file: loop.parquet, split: fit}", "trials[0].file"),
        ("{file: a.parquet, split: [fit]}", "trials[0].split"),
        ("{file: a.parquet}", "trials[0].split"),
        ("{file: a.parquet, split: fit, command: {vx: .nan}}", "trials[0].command.vx"),
        ("{file: a.parquet, split: fit, command: {vx: " + "9" * 400 + "}}", "trials[0].command.vx"),
        ("{file: a.parquet, split: fit, command: [1]}", "trials[0].command"),
        ("{file: a.parquet, split: fit, base: 3}", "trials[0].base"),
        ("{file: a.parquet, split: fit, 3: 3}", "trials[0]"),
    ],
)
def test_wrong_trials(logs, entry, field):
    (logs / "sub").mkdir()
    (logs / "broken.parquet").symlink_to("nowhere.parquet")
    (logs / "loop.parquet").symlink_to("loop.parquet")
    assert refusal(logs, HEAD + f"trials:\n  - {entry}\n").field == field


@pytest.mark.parametrize("kind", ["folder", "broken link"])
def test_what_is_no_file(logs, kind):
    path = logs / "logset.yaml"
    path.mkdir() if kind == "folder" else path.symlink_to("nowhere")
    with pytest.raises(LogError) as info:
        read_log_set(logs)
    assert info.value.file == str(path) and info.value.fix
