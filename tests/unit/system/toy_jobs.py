"""Jobs for worker processes, and a parent that runs them: ``python toy_jobs.py JOB [THREAD]`` prints pids of workers."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
from functools import partial

from hqpipe.errors import LogError
from hqpipe.system.processes import WorkerPool, in_processes, tell

LONG_S = 600


class Awkward(Exception):
    """An error that cannot be copied between processes."""

    def __init__(self, one: int, two: int) -> None:
        super().__init__(f"{one} and {two}")


def square(number: int) -> int:
    return number * number


def count_up(number: int) -> int:
    for step in range(number):
        tell((step, number))
    return number


def fail(kind: str) -> None:
    if kind == "log":
        raise LogError("column 'x' is missing", file="a.parquet", field="x", fix="rename it")
    if kind == "awkward":
        raise Awkward(1, 2)
    if kind == "uncopied":
        return lambda: None
    os.kill(os.getpid(), getattr(signal, kind))


def die_in_the_answer() -> None:
    """Half an answer, as of a worker that is killed while it sends."""
    import gc
    from multiprocessing.connection import Connection

    (pipe,) = [one for one in gc.get_objects() if isinstance(one, Connection)]
    os.write(pipe.fileno(), (1000).to_bytes(4, "big") + b"beginning")
    os.kill(os.getpid(), signal.SIGKILL)


def sleep() -> None:
    _tell_pid()
    time.sleep(LONG_S)


def compute() -> None:
    """Compiled code that lets no other thread of Python run."""
    _tell_pid()
    ctypes.PyDLL(None).sleep(LONG_S)


def _tell_pid() -> None:
    os.write(1, f"{os.getpid()}\n".encode())  # whole lines, from two processes


def main() -> None:
    job, *threads = sys.argv[1:]
    work = partial(in_processes, globals()[job], {"first": (), "second": ()}, 2)
    if threads:
        threading.Thread(target=work, daemon=True).start()
        time.sleep(LONG_S)
    work()


def call_from_threads() -> list[int]:
    with WorkerPool(2) as pool:
        found: list[int] = []
        threads = [threading.Thread(target=lambda n=n: found.append(pool.call("square", square, n))) for n in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return sorted(found)


if __name__ == "__main__":
    main()
