"""Memory that parent and worker processes share, without a name: it goes with its last user, however that ends."""

from __future__ import annotations

import mmap
import os
import tempfile


def share(nbytes: int) -> tuple[int, mmap.mmap]:
    """Allocate zeroed shared memory; returns a file descriptor to pass on and the mapping of this process."""
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("hqpipe-world")
    else:  # outside Linux: a file whose name is gone already
        with tempfile.TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    os.truncate(descriptor, nbytes)
    return descriptor, mmap.mmap(descriptor, nbytes)


def attach(descriptor: int, nbytes: int) -> mmap.mmap:
    """Map memory that another process allocated, and close the descriptor."""
    mapping = mmap.mmap(descriptor, nbytes)
    os.close(descriptor)
    return mapping
