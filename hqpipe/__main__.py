"""The installed command, and ``python -m hqpipe``: signals are seen to before the imports, which take a while."""

from __future__ import annotations

from typing import NoReturn

from hqpipe.system.signals import Interrupted, end, raise_on_signals


def start() -> NoReturn:
    """Run the command line; see `hqpipe.cli.main`."""
    raise_on_signals()
    try:
        from hqpipe.cli import main

        main()
    except Interrupted as error:
        end(error)


if __name__ == "__main__":
    start()
