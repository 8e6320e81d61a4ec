"""Recorded and simulated trials: `hqpipe-log/1` on disk, `Trajectory` and `LogSet` in memory.

A reader turns one file into a `RawTable` of named columns; all that follows is the same for every format.
"""

from __future__ import annotations

from hqpipe.registry import Registry

FORMAT = "hqpipe-log/1"

LOG_READERS = Registry("log format", {"parquet": "hqpipe.logs.parquet:ParquetReader"})
