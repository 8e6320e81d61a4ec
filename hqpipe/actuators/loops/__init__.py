"""Compiled loops: arrays in, arrays out, nothing else."""

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)
