"""Calls in worker processes, none of which outlives the process that started them.

A worker is a fresh interpreter with a pipe of its own, so that the death of one is seen at once and holds up no other. Where
the work begins with much that is there already, it may be a copy of the process instead (`SPAWN`, `FORK`).
"""

from __future__ import annotations

import multiprocessing
import pickle
import queue
import signal
import traceback
from collections.abc import Callable, Mapping
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any, Self, TypeVar

from hqpipe.errors import HqpipeError
from hqpipe.system.orphans import end_with_parent
from hqpipe.system.signals import FIRST_ON_SIGNAL, without_ctrl_c

Result = TypeVar("Result")
Report = Callable[[int, str], None]
"""Called after each call as ``report(done, name)``; `done` counts."""
Told = Callable[[str, Any], None]
"""Called with the name of a call and what its task gave `tell`."""

SPAWN, FORK = "spawn", "fork"  # a fresh interpreter; a copy of this one, which must then do nothing but compute
_PARENT: list[Connection] = []  # of a worker, to the process that started it; empty in any other
EXIT_TIMEOUT_S = 5.0  # assumption: an idle worker that has not left by then is stuck
CAUSES = {
    -signal.SIGKILL: "was killed, as the system does when memory runs out",
    -signal.SIGSEGV: "crashed in compiled code (SIGSEGV)",
    -signal.SIGBUS: "crashed in compiled code (SIGBUS)",
    -signal.SIGABRT: "was aborted by compiled code (SIGABRT)",
}
"""Exit code of a process → what has become of it."""


def in_processes(
    task: Callable[..., Result],
    calls: Mapping[str, tuple],
    workers: int,
    report: Report = lambda done, name: None,
    told: Told = lambda name, message: None,
) -> list[Result]:
    """``task(*arguments)`` of every call in at most `workers` processes; the first error ends the others.

    Args:
        task: a function of a module; it, its arguments and its results are copied between processes.
        calls: name → arguments.

    Returns:
        The results in the order of `calls`.

    Raises:
        HqpipeError: a worker died or could not be started.
        Exception: what `task` raised, with the traceback of the worker as a note.
    """
    results: dict[str, Result] = {}
    waiting = iter(calls.items())
    with WorkerPool(min(workers, len(calls))) as pool:
        busy: dict[Connection, Worker] = {}
        idle = list(pool.workers)
        while len(results) < len(calls):
            for worker, (name, arguments) in zip(idle, waiting, strict=False):
                worker.start(name, task, arguments)
                busy[worker.connection] = worker
            idle = []
            for worker in [busy[connection] for connection in wait(list(busy))]:
                done, value = worker.receive()
                if not done:
                    told(worker.name, value)
                    continue
                idle.append(busy.pop(worker.connection))
                results[worker.name] = value
                report(len(results), worker.name)
    return [results[name] for name in calls]


def tell(message: Any) -> None:
    """Called by a task: give the process that started the worker a message, which goes to `told` of `in_processes`."""
    _PARENT[-1].send_bytes(pickle.dumps((False, message, None)))


class WorkerPool:
    """Workers for the duration of a ``with`` block; an error that leaves the block ends them in the middle of their work.

    Args:
        count: how many. method: `SPAWN` or `FORK`.
    """

    def __init__(self, count: int, method: str = SPAWN) -> None:
        self.workers: list[Worker] = []
        self._count, self._method = count, method
        self._idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()

    def __enter__(self) -> Self:
        FIRST_ON_SIGNAL.append(self.kill)
        try:
            for _ in range(self._count):
                self.workers.append(Worker(self._method))
                self._idle.put(self.workers[-1])
        except BaseException:
            self.kill()
            self._end()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, *more: Any) -> None:
        if kind is not None:
            self.kill()
        self._end()

    def call(self, name: str, task: Callable[..., Result], *arguments: Any) -> Result:
        """Call `task` in a worker, from any thread, once one is idle; see `in_processes`."""
        worker = self._idle.get()
        try:
            worker.start(name, task, arguments)
            return worker.result()
        finally:
            self._idle.put(worker)

    def kill(self) -> None:
        for worker in self.workers:
            worker.process.kill()

    def _end(self) -> None:
        FIRST_ON_SIGNAL.remove(self.kill)
        if self._method == FORK:
            self.kill()  # its pipe does not end: copies that were made later hold it open, too
        for worker in self.workers:
            worker.connection.close()  # an idle worker leaves when its pipe ends
        for worker in self.workers:
            worker.process.join(EXIT_TIMEOUT_S)
            worker.process.kill()
            worker.process.join()


class Worker:
    """A process that carries out one call after the other."""

    def __init__(self, method: str = SPAWN) -> None:
        context = multiprocessing.get_context(method)
        self.name = ""
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs,), daemon=True)
        try:
            resource_tracker.ensure_running()  # otherwise started by the next line, it would let Ctrl-C through
            with theirs, without_ctrl_c():
                self.process.start()
        except OSError as error:
            raise HqpipeError(
                f"a worker process could not be started: {error.strerror or error}",
                fix="raise the limit of processes, or use fewer of them (workers: 1)",
            ) from error

    def start(self, name: str, task: Callable[..., Any], arguments: tuple) -> None:
        self.name = name
        message = pickle.dumps((task, arguments))
        try:
            self.connection.send_bytes(message)
        except OSError:
            raise self._death() from None

    def result(self) -> Any:
        """Wait for what the call returns or raises; what its task tells is dropped."""
        done = False
        while not done:
            done, value = self.receive()
        return value

    def receive(self) -> tuple[bool, Any]:
        """Wait for a message: whether the call has ended, and what it returned or, if not, told."""
        try:
            message = self.connection.recv_bytes()
        except (EOFError, OSError):
            raise self._death() from None
        done, value, error = pickle.loads(message)
        if error is not None:
            raise error
        return done, value

    def _death(self) -> HqpipeError:
        self.process.join(EXIT_TIMEOUT_S)
        code = self.process.exitcode
        cause = CAUSES.get(code, f"ended with exit code {code}")
        return HqpipeError(
            f"the worker process of '{self.name}' {cause}",
            fix="free memory, or use fewer processes at a time (workers: 1)",
        )


def _serve(connection: Connection) -> None:
    """What a worker does until its pipe ends."""
    _PARENT.append(connection)
    end_with_parent(multiprocessing.parent_process().sentinel)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    while True:
        try:
            message = connection.recv_bytes()
        except EOFError:
            return
        connection.send_bytes(_answer(message))


def _answer(message: bytes) -> bytes:
    try:
        task, arguments = pickle.loads(message)
        return pickle.dumps((True, task(*arguments), None))
    except Exception as error:  # not swallowed: the parent raises it
        error.add_note(f"In the worker process:\n{traceback.format_exc()}")
        return pickle.dumps((True, None, _portable(error)))


def _portable(error: Exception) -> Exception:
    """The error, or one of the same text where it cannot be copied between processes."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return HqpipeError(f"{type(error).__name__}: {error}")
    return error
