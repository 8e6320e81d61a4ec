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
        "mcap": "hqpipe.logs.imports.mcap:McapReader",
        "rosbag": "hqpipe.logs.imports.rosbag:RosbagReader",
        "ulog": "hqpipe.logs.imports.ulog:UlogReader",
        "mdf": "hqpipe.logs.imports.mdf:MdfReader",
        "lerobot": "hqpipe.logs.imports.lerobot:LerobotReader",
        "pace": "hqpipe.logs.imports.presets.pace:PaceReader",
        "bam": "hqpipe.logs.imports.presets.bam:BamReader",
        "sage": "hqpipe.logs.imports.presets.sage:SageReader",
        "parquet": "hqpipe.logs.imports.parquet_table:ParquetTableReader",
    },
)
"""In the order in which they are asked for a file whose suffix several of them read."""

PRESETS = Registry(
    "preset",
    {
        "pace": "hqpipe.logs.imports.presets.pace:mapping",
        "bam": "hqpipe.logs.imports.presets.bam:mapping",
        "sage": "hqpipe.logs.imports.presets.sage:mapping",
        "unitree": "hqpipe.logs.imports.presets.unitree:mapping",
    },
)
"""Name → a function of the recordings that returns the content of a mapping file for them."""
