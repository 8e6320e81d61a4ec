"""What MuJoCo alone refuses of a robot, as an error that names the file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from hqpipe.errors import ConfigError


@contextmanager
def named(file: str | os.PathLike[str], fix: str) -> Iterator[None]:
    """Raise what MuJoCo refuses inside as a ConfigError of the URDF `file`.

    Args:
        file: the URDF. fix: what to do about it.
    """
    try:
        yield
    except ValueError as error:
        reason = " ".join(str(error).split())[:300]
        raise ConfigError(
            f"{os.fspath(file)}: MuJoCo cannot make a body of it ({reason})", file=file, fix=fix
        ) from error
