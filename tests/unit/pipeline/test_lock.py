"""The lock of the artifacts: one holder, named to the others, freed by the system when it dies."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from hqpipe.errors import IntegrityError, LockedError, UsageError
from hqpipe.pipeline.lock import exclusive


def test_lock_is_exclusive_and_released(tmp_path):
    with exclusive(tmp_path), pytest.raises(LockedError, match=f"process {os.getpid()}"), exclusive(tmp_path):
        pass
    with exclusive(tmp_path):
        pass
    assert [path.name for path in tmp_path.iterdir() if path.name != ".lock"] == []


def test_lock_that_a_worker_of_a_dead_run_holds_is_told_apart(tmp_path):
    finished = subprocess.Popen(["true"])
    finished.wait()
    with exclusive(tmp_path):
        record = {"pid": finished.pid, "command": "hqpipe run all"}
        (tmp_path / ".lock").write_text(json.dumps(record))
        with (
            pytest.raises(LockedError, match=f"{finished.pid} .*a worker process of it has not"),
            exclusive(tmp_path),
        ):
            pass


def test_forked_worker_does_not_free_the_lock(tmp_path):
    try:
        with exclusive(tmp_path):
            child = os.fork()
            if child == 0:
                sys.exit()
            os.waitpid(child, 0)
            with pytest.raises(LockedError, match=f"process {os.getpid()}"), exclusive(tmp_path):
                pass
    except SystemExit:
        # Only the child comes here, after it has left the lock's block.
        os._exit(0)


def test_many_start_at_once_and_one_gets_it(tmp_path):
    code = (
        "import sys, time\nfrom pathlib import Path\nfrom hqpipe.errors import LockedError\n"
        "from hqpipe.pipeline.lock import exclusive\n"
        "try:\n"
        "    with exclusive(Path(sys.argv[1])):\n"
        "        print('held', flush=True)\n"
        "        sys.stdin.read()\n"
        "except LockedError:\n"
        "    print('locked', flush=True)\n"
    )
    command, pipe = [sys.executable, "-c", code, str(tmp_path)], subprocess.PIPE
    started = [subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) for _ in range(4)]
    assert sorted(each.stdout.readline() for each in started) == ["held\n"] + ["locked\n"] * 3
    for each in started:
        each.communicate()


def test_lock_of_a_killed_holder_is_free(tmp_path):
    code = (
        "import os, sys\nfrom pathlib import Path\nfrom hqpipe.pipeline.lock import exclusive\n"
        "with exclusive(Path(sys.argv[1])):\n    os.kill(os.getpid(), 9)\n"
    )
    assert subprocess.run([sys.executable, "-c", code, str(tmp_path)]).returncode == -9
    with exclusive(tmp_path):
        pass


@pytest.mark.parametrize("text", ["", "[]", "{", '{"pid": 1}', '{"pid": 1e400, "command": ""}', "[" * 10_000, "\xff"])
def test_record_of_the_holder_that_says_nothing(tmp_path, text):
    with exclusive(tmp_path):
        (tmp_path / ".lock").write_bytes(text.encode("latin-1"))
        with pytest.raises(LockedError, match="in use by another process"), exclusive(tmp_path):
            pass


def test_a_file_of_somebody_else_is_not_touched(tmp_path):
    (tmp_path / "precious").write_text("precious")
    (tmp_path / "artifacts").mkdir()
    (tmp_path / "artifacts" / ".lock").symlink_to(tmp_path / "precious")
    with (
        pytest.raises(IntegrityError, match="not a regular file: remove it") as raised,
        exclusive(tmp_path / "artifacts"),
    ):
        pass
    assert raised.value.file.endswith(".lock") and (tmp_path / "precious").read_text() == "precious"


def test_file_system_without_locks(tmp_path, monkeypatch):
    def fail(descriptor: int, operation: int) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr("fcntl.flock", fail)
    with pytest.raises(UsageError, match="No locks available.*local disk"), exclusive(tmp_path):
        pass
