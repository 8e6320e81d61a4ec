"""Several engines that work side by side on the rows of one world: in this process, in threads or in processes."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import weakref
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol

from hqpipe.errors import HqpipeError
from hqpipe.sim.engine import Engine, EngineSetup
from hqpipe.sim.memory import share
from hqpipe.sim.state import ArraySizes, WorldArrays
from hqpipe.sim.worker import DONE, RESET, STEP, describe, receive_text, send_text
from hqpipe.system.signals import without_ctrl_c

EXIT_TIMEOUT_S = 5.0  # assumption: a worker that has not left by then is stuck


class Team(Protocol):
    """Engines that together own every row of `arrays`."""

    arrays: WorldArrays

    def step(self) -> None: ...

    def reset(self) -> None: ...

    def close(self) -> None: ...


def split(count: int, block: int, parts: int) -> list[tuple[int, int]]:
    """Cut `count` rows into at most `parts` ranges of whole blocks, as even as possible."""
    blocks = -(-count // block)
    parts = min(parts, blocks)
    edges = [min(count, block * (blocks * part // parts)) for part in range(parts + 1)]
    return list(zip(edges[:-1], edges[1:], strict=True))


class ThreadTeam:
    """Engines in this process, one thread each; a single engine needs no thread."""

    def __init__(
        self, engine: type[Engine], setup: EngineSetup, sizes: ArraySizes, ranges: Sequence[tuple[int, int]]
    ) -> None:
        self.arrays = sizes.arrays(bytearray(sizes.nbytes()))
        self._engines = [engine(setup, self.arrays.rows(a, b), a) for a, b in ranges]
        self._pool = ThreadPoolExecutor(len(ranges) - 1) if len(ranges) > 1 else None
        self._finalizer = weakref.finalize(self, _close_engines, self._engines, self._pool)

    def step(self) -> None:
        others = [self._pool.submit(e.step) for e in self._engines[1:]] if self._pool else []
        self._engines[0].step()
        for other in others:
            other.result()

    def reset(self) -> None:
        for engine in self._engines:
            engine.reset()

    def close(self) -> None:
        self._finalizer()


def _close_engines(engines: list[Engine], pool: ThreadPoolExecutor | None) -> None:
    if pool:
        pool.shutdown()
    for engine in engines:
        engine.close()


class ProcessTeam:
    """Engines in worker processes on shared memory; a command is one byte on a socket."""

    def __init__(self, engine: str, setup: EngineSetup, sizes: ArraySizes, ranges: Sequence[tuple[int, int]]) -> None:
        descriptor, memory = share(sizes.nbytes())
        self.arrays = sizes.arrays(memory)
        self._connections: list[socket.socket] = []
        self._processes: list[subprocess.Popen[bytes]] = []
        self._pipes: list[int] = []  # each ends with this process, and its worker with it
        self._broken = ""
        self._finalizer = weakref.finalize(self, _dismiss, self._connections, self._processes, self._pipes)
        try:
            for first, last in ranges:
                self._start(descriptor)
                send_text(self._connections[-1], describe(engine, setup, sizes, first, last))
            self._await()
        except BaseException:
            self.close()
            raise
        finally:
            os.close(descriptor)

    def _start(self, descriptor: int) -> None:
        ours, theirs = socket.socketpair()
        pipe, end = os.pipe()
        self._connections.append(ours)
        self._pipes.append(end)
        try:
            inherited = (theirs.fileno(), descriptor, pipe)
            with theirs, without_ctrl_c():
                process = subprocess.Popen(
                    [sys.executable, "-P", "-m", "hqpipe.sim", *map(str, inherited)],
                    pass_fds=inherited,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                )
        finally:
            os.close(pipe)
        self._processes.append(process)

    def step(self) -> None:
        self._all(STEP)

    def reset(self) -> None:
        self._all(RESET)

    def _all(self, command: bytes) -> None:
        if self._broken:
            raise HqpipeError(f"simulator: {self._broken}; make a new BatchedWorld")
        self._broken = "the previous step was interrupted"
        for number, connection in enumerate(self._connections):
            try:
                connection.sendall(command)
            except ConnectionError:
                self._fail(number)
        self._await()

    def _await(self) -> None:
        for number, connection in enumerate(self._connections):
            try:
                answer = connection.recv(1)
            except ConnectionError:
                answer = b""
            if answer != DONE:
                self._fail(number, receive_text(connection) if answer else "")
        self._broken = ""

    def _fail(self, number: int, text: str = "") -> None:
        if not text:
            code = self._processes[number].wait(EXIT_TIMEOUT_S)
            text = f"it ended with exit code {code}"
        self._broken = f"worker {number + 1} of {len(self._processes)} failed: {text}"
        raise HqpipeError(f"simulator: {self._broken}")

    def close(self) -> None:
        self._finalizer()


def _dismiss(connections: list[socket.socket], processes: list[subprocess.Popen[bytes]], pipes: list[int]) -> None:
    """End the workers, also those that are still starting."""
    for pipe in pipes:
        os.close(pipe)
    for connection in connections:
        connection.close()
    for process in processes:
        try:
            process.wait(EXIT_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
