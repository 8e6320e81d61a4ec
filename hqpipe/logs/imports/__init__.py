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
        "mcap": "hqpipe.logs.imports.mcap:McapReader",
        "rosbag": "hqpipe.logs.imports.rosbag:RosbagReader",
        "ulog": "hqpipe.logs.imports.ulog:UlogReader",
        "mdf": "hqpipe.logs.imports.mdf:MdfReader",
        "lerobot": "hqpipe.logs.imports.lerobot:LerobotReader",
    },
)
