"""Standard streams that are closed, full, unread, or of an encoding that lacks some signs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from test_processes import TOY

# In C, Python would switch to UTF-8 by itself unless it is told not to.
ENCODINGS = {
    "ascii": {"PYTHONIOENCODING": "ascii"},
    "latin-1": {"PYTHONIOENCODING": "latin-1"},
    "C": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
}
MANY = ("status", "--explain"), ("dag",), ("--help",), ("square-up", "--help"), ("run", "all", "--dry-run"), ("doctor",)


def shell(toy, line: str, **environment: str) -> subprocess.CompletedProcess:
    """Run a line of bash in which `hqpipe` is the toy; the result's text is read as bytes."""
    path = f"{sys.executable} {TOY}"
    command = ["bash", "-c", f'hqpipe() {{ {path} "$@"; }}\n{line}']
    return subprocess.run(command, cwd=toy.root, env=os.environ | environment, capture_output=True, timeout=60)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("arguments", MANY, ids=" ".join)
def test_text_can_be_printed_in_every_encoding(toy, encoding, arguments):
    result = shell(toy, f"hqpipe {' '.join(arguments)}", **ENCODINGS[encoding])
    assert b"Traceback" not in result.stderr and b"Unicode" not in result.stderr
    assert result.returncode == {"status": 3}.get(arguments[0], 0)
    assert result.stdout


def test_arrows_become_ascii(toy):
    assert shell(toy, "hqpipe dag", PYTHONIOENCODING="ascii").stdout.splitlines()[0].split() == [
        b"numbers",
        b"-",
        b"->",
        b"numbers",
    ]
    assert "–" in shell(toy, "hqpipe dag", PYTHONIOENCODING="utf-8").stdout.decode()


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_json_and_errors_are_exact_in_every_encoding(toy, encoding):
    toy.edit("numbers: {count: 4}", "numbers: {count: 4, label: größe → ∞}")
    expected = json.loads(shell(toy, "hqpipe numbers --json", PYTHONIOENCODING="utf-8").stdout)
    toy.edit("größe → ∞", "a")
    assert "größe → ∞" in json.dumps(json.loads(shell(toy, "hqpipe status --json").stdout), ensure_ascii=False)
    result = shell(toy, "hqpipe status --json", **ENCODINGS[encoding])
    assert "größe → ∞" in json.dumps(json.loads(result.stdout), ensure_ascii=False)
    assert expected["stages"][0]["action"] == "ran"
    failed = shell(toy, "hqpipe run all --set square_up.fault=unexpected", **ENCODINGS[encoding])
    assert failed.returncode == 1 and b"ZeroDivisionError" in failed.stderr and b"Traceback" not in failed.stderr


def test_a_folder_whose_name_is_no_text(toy):
    folder = Path(os.fsdecode(b"no\xfftext"))
    (toy.root / folder).mkdir()
    for name in ("pipeline.yaml", "robot"):
        (toy.root / folder / name).symlink_to(toy.root / name)
    for line in ("hqpipe run all --json", "hqpipe status", "hqpipe status --json", "hqpipe verify", "hqpipe gc --json"):
        result = shell(toy, f"cd no* && {line}")
        assert result.returncode == 0 and b"Traceback" not in result.stderr, result.stderr
        if "--json" in line:
            json.loads(result.stdout)


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", ">&- 2>&- <&-", "2>/dev/full"])
def test_stages_run_though_streams_are_closed(toy, closed):
    result = shell(toy, f"hqpipe run all --json {closed}")
    assert result.returncode == 0 and b"Traceback" not in result.stderr, result.stderr
    assert shell(toy, f"hqpipe verify {closed}").returncode == 0
    assert shell(toy, f"hqpipe nonsense {closed}").returncode == 2
    assert (toy.artifacts / "numbers" / "part" / "numbers.json").read_text() == "[1, 2, 3, 4]"


@pytest.mark.parametrize("command", ["dag", "status --json", "--help", "run all --json"])
def test_a_full_device_as_standard_output_is_told(toy, command):
    result = shell(toy, f"hqpipe {command} >/dev/full")
    *_, last = result.stderr.decode().splitlines()
    assert last == "error: standard output cannot be written: No space left on device: send it somewhere else"
    assert result.returncode == 1 and b"Traceback" not in result.stderr


@pytest.mark.parametrize("command", ["dag", "status --json", "run all --json"])
def test_a_reader_that_went_away_is_no_error(toy, command):
    result = shell(toy, f"hqpipe {command} | true; exit ${{PIPESTATUS[0]}}")
    assert result.returncode == 141
    assert b"error" not in result.stderr and b"Exception" not in result.stderr


def test_a_closed_standard_output_is_never_a_file_of_the_project(toy):
    """Otherwise the first file that is opened would be number 1, and what a stage prints would go into it."""
    shell(toy, "hqpipe run all >&- 2>&- <&-")
    assert toy("verify").code == 0
    assert not any(b"chatter" in content for content in toy.snapshot().values() if isinstance(content, bytes))
