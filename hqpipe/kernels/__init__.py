"""Compiled loops: arrays in, arrays out, nothing else."""

import hqpipe.checked_cache  # noqa: F401 (before any function is compiled)
