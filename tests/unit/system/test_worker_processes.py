"""Worker processes: results, failures, and that none outlives the process that started it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable

import pytest
import toy_jobs
from process_tree import children, runs

from hqpipe.errors import HqpipeError, LogError
from hqpipe.system.processes import WorkerPool, in_processes
from hqpipe.system.signals import FIRST_ON_SIGNAL

DEADLINE_S = 60.0


def await_that(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.02)


def parent_of(job: str, *arguments: str) -> subprocess.Popen:
    command = [sys.executable, toy_jobs.__file__, job, *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


@pytest.mark.parametrize("workers", [1, 3, 20])
def test_results_come_in_order_and_every_call_is_told(workers):
    told = []
    calls = {f"call {n}": (n,) for n in range(8)}
    found = in_processes(toy_jobs.square, calls, workers, lambda *given: told.append(given))
    assert found == [n * n for n in range(8)]
    assert [done for done, _ in told] == list(range(1, 9)) and {name for _, name in told} == set(calls)
    assert not multiprocessing.active_children() and not FIRST_ON_SIGNAL
    assert in_processes(toy_jobs.square, {}, workers) == []


@pytest.mark.parametrize("workers", [1, 3])
def test_what_tasks_tell_arrives_in_order_beside_their_results(workers):
    heard: dict[str, list] = {}
    calls = {f"call {n}": (n,) for n in range(5)}
    found = in_processes(
        toy_jobs.count_up, calls, workers, told=lambda name, message: heard.setdefault(name, []).append(message)
    )
    assert found == list(range(5))
    assert heard == {f"call {n}": [(step, n) for step in range(n)] for n in range(1, 5)}
    with WorkerPool(1) as pool:
        assert pool.call("count", toy_jobs.count_up, 3) == 3


def test_an_error_in_what_hears_the_tasks_ends_them():
    def refuse(name: str, message: tuple) -> None:
        raise LogError("no more")

    with pytest.raises(LogError, match="no more"):
        in_processes(toy_jobs.count_up, {"one": (2,), "two": (2,)}, 2, told=refuse)
    assert not multiprocessing.active_children() and not FIRST_ON_SIGNAL


def test_an_error_of_a_call_is_raised_with_its_fields_and_ends_the_others():
    with pytest.raises(LogError) as caught:
        in_processes(toy_jobs.fail, {"bad": ("log",), "worse": ("SIGSTOP",)}, 2)
    assert (caught.value.file, caught.value.field, caught.value.fix) == ("a.parquet", "x", "rename it")
    assert "toy_jobs.py" in "".join(caught.value.__notes__)
    assert not multiprocessing.active_children()


@pytest.mark.parametrize(("kind", "text"), [("awkward", "Awkward: 1 and 2"), ("uncopied", "<lambda>")])
def test_what_cannot_be_copied_between_processes_is_an_error_of_its_text(kind, text):
    with pytest.raises(Exception, match=text):
        in_processes(toy_jobs.fail, {"odd": (kind,)}, 1)


@pytest.mark.parametrize(
    ("kind", "cause"), [("SIGKILL", "memory runs out"), ("SIGSEGV", "compiled code"), ("SIGTERM", "exit code -15")]
)
def test_a_worker_that_dies_is_named_with_cause_and_fix(kind, cause):
    with pytest.raises(HqpipeError, match=rf"worker process of 'bad'.*{cause}") as caught:
        in_processes(toy_jobs.fail, {"bad": (kind,)}, 2)
    assert "workers: 1" in caught.value.fix


def test_half_an_answer_of_a_killed_worker_holds_nothing_up():
    with pytest.raises(HqpipeError, match="'bad' was killed"):
        in_processes(toy_jobs.die_in_the_answer, {"bad": ()}, 2)


def test_calls_from_threads_share_the_workers():
    assert toy_jobs.call_from_threads() == [0, 1, 4, 9, 16, 25]


@pytest.mark.parametrize("arguments", [("sleep",), ("compute",), ("sleep", "from a thread")])
def test_busy_workers_end_with_a_killed_parent(arguments):
    with parent_of(*arguments) as parent:
        pids = [int(parent.stdout.readline()) for _ in range(2)]
        everyone = children(parent.pid)
        assert set(pids) <= set(everyone)
        parent.kill()
        await_that(lambda: not any(map(runs, everyone)), "a process stayed behind")
        assert parent.stdout.read() == ""  # nobody holds the pipe open


@pytest.mark.parametrize("moment_s", [0.0, 0.01, 0.03, 0.06, 0.1, 0.2])
def test_starting_workers_end_with_a_killed_parent(moment_s):
    with parent_of("sleep") as parent:
        await_that(lambda: bool(children(parent.pid)), "no worker was started")
        time.sleep(moment_s)
        everyone = children(parent.pid)
        parent.kill()
        await_that(lambda: not any(map(runs, everyone)), "a process stayed behind")


def test_workers_leave_ctrl_c_to_the_parent():
    with parent_of("sleep") as parent:
        pids = [int(parent.stdout.readline()) for _ in range(2)]
        for pid in pids:
            os.kill(pid, signal.SIGINT)
        time.sleep(0.2)
        assert all(map(runs, pids))
        parent.kill()
