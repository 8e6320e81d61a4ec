"""Logs of other programs and machines, made into a log set.

A reader turns one file into `Recording`s, a mapping says which field is which channel, in which unit and on which clock.
"""

from __future__ import annotations

from hqpipe.registry import Registry

FOREIGN_READERS = Registry(
    "log format",
    {
        "csv": "hqpipe.logs.imports.csv_table:CsvReader",
        "npz": "hqpipe.logs.imports.npz:NpzReader",
        "hdf5": "hqpipe.logs.imports.hdf5:Hdf5Reader",
        "mat": "hqpipe.logs.imports.mat:MatReader",
        "parquet": "hqpipe.logs.imports.parquet_table:ParquetTableReader",
    },
)
"""In the order in which they are asked for a file whose suffix several of them read."""

PRESETS = Registry("preset", {})
"""Name → a function of the recordings that returns the content of a mapping file for them."""
