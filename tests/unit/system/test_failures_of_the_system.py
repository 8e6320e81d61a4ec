from __future__ import annotations

import errno
from pathlib import Path

import pytest

from hqpipe.errors import HqpipeError, LogError, UsageError
from hqpipe.system.failures import _FAILURES, reported, system_failure


@pytest.mark.parametrize("number", _FAILURES, ids=errno.errorcode.get)
def test_every_failure_has_file_and_fix(number):
    failure = system_failure(OSError(number, "text of the system", "/disk/file"), Path("/elsewhere"))
    assert failure.file == "/disk/file" and str(failure).startswith("/disk/file: ") and failure.fix
    assert system_failure(OSError(number, "text of the system"), Path("/disk")).file == "/disk"
    assert system_failure(OSError(number, "text of the system")).file is None


class SafetensorError(Exception):
    pass


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError(), "not enough memory"),
        (RecursionError(), "nested too deeply"),
        (RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory: you tried"), "not enough memory"),
        (SafetensorError('IoError(Os { code: 28, kind: StorageFull, message: "No space left" })'), "disk is full"),
        (SafetensorError("I/O error: No space left on device (os error 28)"), "disk is full"),
        (OSError("Unable to write (errno = 28, error message = 'No space left on device')"), "disk is full"),
    ],
)
def test_errors_of_libraries(error, words):
    assert words in str(system_failure(error, Path("/")))


def test_cause_of_an_error_is_looked_at():
    wrapped = ValueError("cannot save")
    wrapped.__cause__ = OSError(errno.ENOSPC, "No space left on device", "/")
    assert "disk is full" in str(system_failure(wrapped))


@pytest.mark.parametrize(
    "error", [KeyError("x"), ValueError("exit code: 13"), FileNotFoundError(2, "no", "x"), LogError("errno 28")]
)
def test_other_errors_are_left_alone(error):
    assert system_failure(error) is None
    with pytest.raises(type(error)), reported(Path("/")):
        raise error


def test_who_is_to_act_decides_the_exit_code():
    assert type(system_failure(OSError(errno.ENOSPC, ""))) is HqpipeError
    assert type(system_failure(OSError(errno.EROFS, ""))) is UsageError
