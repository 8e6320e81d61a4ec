"""Whether this process may have the memory that a stage takes."""

from __future__ import annotations

from pathlib import Path

from hqpipe.errors import HqpipeError

LEAST_ADDRESS_SPACE = 2 << 30
"""Bytes. Stages map 1.0 to 1.3 GiB, mostly libraries; where these find less, OpenBLAS tries again for ever."""


def check_address_space(folder: Path) -> None:
    """Refuse a limit of address space (``ulimit -v``) under which a stage would hang.

    Args:
        folder: where the stage writes, for the message.

    Raises:
        HqpipeError: the limit is below `LEAST_ADDRESS_SPACE`.
    """
    try:
        import resource
    except ImportError:  # a system without such limits
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY or limit >= LEAST_ADDRESS_SPACE:
        return
    raise HqpipeError(
        f"{folder}: not enough memory: the address space of this process is limited to {limit / 2**30:.1f} GiB, "
        f"expected at least {LEAST_ADDRESS_SPACE / 2**30:.0f} GiB",
        file=folder,
        fix="raise the limit, e.g. `ulimit -v unlimited`",
    )
