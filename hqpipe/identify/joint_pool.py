"""Searches over the joints of a machine, several at a time.

Each worker is a copy of this process, in which the models are already there, and keeps the searches that it began. Threads
would wait for each other: half of a search is Python. The answers do not depend on how many there are.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from multiprocessing.connection import wait
from typing import Any, Self

from hqpipe.identify.joint_search import JointSearch
from hqpipe.system.processes import FORK, WorkerPool

Report = Callable[[int], None]
_SEARCHES: list[JointSearch] = []
"""Those of the pool that is open, for the workers to find."""


def _step(j: int, method: str, arguments: tuple) -> Any:
    return getattr(_SEARCHES[j], method)(*arguments)


class JointPool:
    """Searches for the duration of a ``with`` block.

    Args:
        searches: of each joint. workers: processes; one search after the other in this one where that is 1, where there is one
            joint, and on systems on which a process cannot be copied safely.
    """

    def __init__(self, searches: Sequence[JointSearch], workers: int) -> None:
        self._searches = list(searches)
        count = min(workers, len(self._searches))
        self._pool = WorkerPool(count, FORK) if count > 1 and sys.platform == "linux" else None
        self._owner: dict[int, int] = {}

    def __enter__(self) -> Self:
        _SEARCHES[:] = self._searches
        if self._pool is not None:
            self._searches[0].load_compiled_code()
            self._pool.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        _SEARCHES.clear()
        if self._pool is not None:
            self._pool.__exit__(*error)

    def each(self, method: str, arguments: Sequence[tuple] = (), report: Report = lambda joint: None) -> list[Any]:
        """One step of every search.

        Args:
            method: of `JointSearch`. arguments: of each search; none where it takes none.
            report: called with the number of each joint that is done.
        """
        arguments = list(arguments) or [()] * len(self._searches)
        found: list[Any] = [None] * len(self._searches)
        for j, result in self._steps(method, dict(enumerate(arguments))):
            found[j] = result
            report(j)
        return found

    def some(self, method: str, arguments: Mapping[int, Any]) -> dict[int, Any]:
        """One step of some searches that were begun.

        Args:
            method: of `JointSearch`. arguments: number of a joint → its one argument.
        """
        return dict(self._steps(method, {j: (argument,) for j, argument in arguments.items()}))

    def _steps(self, method: str, arguments: Mapping[int, tuple]) -> Iterator[tuple[int, Any]]:
        """(joint, result) of each, as they end; a search that no worker has is begun by the first that is idle."""
        if self._pool is None:
            yield from ((j, _step(j, method, given)) for j, given in arguments.items())
            return
        workers = self._pool.workers
        open_ones = deque(j for j in arguments if j not in self._owner)
        own = [deque(j for j in arguments if self._owner.get(j) == w) for w in range(len(workers))]
        busy: dict[Any, tuple[int, int]] = {}
        idle = list(range(len(workers)))
        while True:
            for w in idle:
                queue = own[w] or open_ones
                if queue:
                    j = queue.popleft()
                    self._owner[j] = w
                    workers[w].start(str(j), _step, (j, method, arguments[j]))
                    busy[workers[w].connection] = w, j
            if not busy:
                return
            ended = [busy.pop(connection) for connection in wait(list(busy))]
            idle = [w for w, _ in ended]
            for w, j in ended:
                yield j, workers[w].result()
