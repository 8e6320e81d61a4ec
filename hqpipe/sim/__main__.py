"""A worker process of the batched world: ``python -m hqpipe.sim SOCKET MEMORY PARENT`` (three file descriptors)."""

from __future__ import annotations

import signal
import sys

from hqpipe.system.orphans import end_with_parent


def main() -> None:
    connection, memory, parent = map(int, sys.argv[1:])
    end_with_parent(parent)  # before the imports, which take seconds
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    from hqpipe.sim.worker import work

    work(connection, memory)


if __name__ == "__main__":
    main()
