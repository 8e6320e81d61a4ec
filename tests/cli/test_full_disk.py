"""Failures of the operating system: the disk, memory, limits. One line with the place and what to do; nothing lost."""

from __future__ import annotations

import errno
import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TOY = Path(__file__).with_name("toy_pipeline.py")
ROOM = 2 * 2**20


@pytest.fixture
def disk(toy):
    """The artifacts folder of the project on a small disk of its own."""
    toy.artifacts.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={ROOM}", "tmpfs", str(toy.artifacts)]
    if shutil.which("mount") is None or subprocess.run(command, capture_output=True).returncode:
        pytest.skip("mounting a small disk is not permitted here")
    yield toy
    subprocess.run(["umount", "--lazy", str(toy.artifacts)], check=True)


def fill(folder: Path) -> None:
    """Leave not a byte."""
    descriptor = os.open(folder / "filler", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    try:
        for size in (65536, 1):
            with pytest.raises(OSError, match="No space"):
                while True:
                    os.write(descriptor, b"x" * size)
    finally:
        os.close(descriptor)
    assert shutil.disk_usage(folder).free == 0


def with_garbage(toy) -> None:
    """Two generations, of which the first is garbage; a killed stage's leftovers; and a full disk."""
    toy("run", "all", "--set", "square_up.offset=1")
    toy("run", "all")
    leftover = toy.artifacts / "store" / ".tmp-killed"
    leftover.mkdir()
    (leftover / "half").write_bytes(b"x" * 100_000)
    fill(toy.artifacts)


@pytest.mark.parametrize("lock", ["used before", "never used"])
def test_gc_works_on_a_full_disk_and_the_run_goes_on(disk, lock):
    with_garbage(disk)
    if lock == "never used":
        (disk.artifacts / ".lock").unlink()
    for command in (["status"], ["verify"], ["diff", "numbers", "squares"], ["gc", "--dry-run"]):
        assert disk(*command).code == 0, command
    answer = disk("gc", "--json")
    assert answer.code == 0, answer.err
    assert len(answer.data["removed"]) == 2 and not list(disk.artifacts.rglob(".tmp-*"))
    assert disk("run", "all", "--set", "square_up.offset=2").code == 0


def test_a_stage_on_a_full_disk_says_so_and_loses_nothing(disk):
    disk("run", "all")
    before = (disk.artifacts / "squares").readlink()
    for command in (["run", "all", "--set", "square_up.offset=3"], ["run", "all", "--force"]):
        fill(disk.artifacts)
        answer = disk(*command)
        assert answer.code == 1
        (line,) = [line for line in answer.err.splitlines() if line.startswith("error: ")]
        assert "the disk is full (0.0 MB free)" in line and "hqpipe gc" in line and "artifacts" in line
        assert (disk.artifacts / "squares").readlink() == before
        assert disk("verify").code == 0
        assert not list(disk.artifacts.rglob(".tmp-*"))


def test_read_only_disk(disk):
    disk("run", "all")
    subprocess.run(["mount", "-o", "remount,ro", str(disk.artifacts)], check=True)
    for command in (["status"], ["verify"], ["run", "all", "--dry-run"], ["gc", "--dry-run"]):
        assert disk(*command).code == 0
    for command in (["run", "all"], ["gc"], ["numbers", "--force"]):
        answer = disk(*command)
        assert answer.code == 2
        assert "artifacts" in answer.err and "read-only" in answer.err and "make it writable" in answer.err


LIMITS = {
    "size of a file": (resource.RLIMIT_FSIZE, 1000, "larger than this process", "ulimit -f"),
    "open files": (resource.RLIMIT_NOFILE, None, "too many open files", "ulimit -n"),
    "memory": (resource.RLIMIT_AS, None, "not enough memory", "fewer workers"),
}
# A stage that wants more of something than there is.
GREEDY = {
    "size of a file": "(context.output / 'large').write_bytes(bytes(10**6))",
    "open files": "files = [open('/dev/null') for _ in range(10**5)]",
    "memory": "data = bytearray(2**50)",
}


@pytest.mark.parametrize("limit", LIMITS)
def test_limits_of_the_process(toy, limit):
    kind, value, text, fix = LIMITS[limit]
    code = (
        f"import sys; sys.path.insert(0, {str(TOY.parent)!r}); import hqpipe.cli, toy_pipeline, toy_numbers\n"
        f"def run(context):\n    {GREEDY[limit]}\n"
        "toy_numbers.run = run\n"
        "sys.exit(hqpipe.cli.run_cli(toy_pipeline.TABLE, ['numbers']))"
    )

    def restrict() -> None:
        if value is not None:
            resource.setrlimit(kind, (value, value))

    result = subprocess.run(
        [sys.executable, "-c", code], cwd=toy.root, capture_output=True, text=True, preexec_fn=restrict
    )
    assert result.returncode == 1
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert text in line and fix in line and "numbers: /" in line
    assert "Traceback" not in result.stderr and not list(toy.artifacts.rglob(".tmp-*"))


def test_too_little_address_space_is_refused_before_a_library_waits_for_it(toy):
    toy("numbers")

    def restrict() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))

    def run(*arguments: str) -> subprocess.CompletedProcess:
        command = [sys.executable, str(TOY), *arguments]
        return subprocess.run(command, cwd=toy.root, capture_output=True, text=True, preexec_fn=restrict)

    result = run("run", "all")
    assert result.returncode == 1 and "limited to 1.0 GiB" in result.stderr and "ulimit -v" in result.stderr
    assert not (toy.artifacts / "squares").exists()
    assert run("verify").returncode == 0  # looking needs none of the libraries


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (OSError(errno.EDQUOT, "quota", "/disk/a"), 1, ("/disk/a", "quota", "hqpipe gc")),
        (OSError(errno.ENAMETOOLONG, "long", "/disk/b"), 2, ("/disk/b", "too long", "shorten it")),
        (RecursionError("maximum recursion depth exceeded"), 1, ("nested too deeply", "fewer levels")),
        (MemoryError(), 1, ("not enough memory", "num_envs")),
    ],
)
def test_failure_of_a_command(toy, monkeypatch, error, code, words):
    def fail(*arguments):
        raise error

    monkeypatch.setattr("hqpipe.pipeline.project.open_project", fail)
    answer = toy("status")
    assert answer.code == code and answer.err.count("\n") == 1
    assert all(word in answer.err for word in words)


def test_name_of_a_robot_that_is_too_long(toy):
    toy.edit("robot: toy", f"robot: ./{'r' * 300}")
    answer = toy("run", "all")
    assert answer.code == 2 and "pipeline.yaml:1: robot: expected names of at most 255 bytes" in answer.err
