"""Parquet files that are no trial of a log set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.logs.imports.arrays import Fields, streams_by_length
from hqpipe.logs.imports.decoding import check_bytes, decoding
from hqpipe.logs.imports.recording import ImportLogError, Recording
from hqpipe.logs.parquet_file import opened


class ParquetTableReader:
    """Columns of numbers, times, and lists of numbers of one length."""

    suffixes = (".parquet", ".pq")
    extra = None

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """One recording with one stream.

        Raises:
            LogError: no Parquet, damaged, or without a column of numbers.
        """
        fields = Fields()
        with decoding(path, "a Parquet file"), opened(path) as file:
            check_bytes(path, 8 * file.metadata.num_rows * file.metadata.num_columns)
            names = file.schema_arrow.names
            for index, name in enumerate(names):
                if name in names[:index]:
                    raise ImportLogError(f"{path}: column '{name}' is there twice", file=path, fix="drop one")
                _take(fields, name, file.read(columns=[name]).column(0))
        if not fields.arrays:
            raise ImportLogError(f"{path}: no column of numbers", file=path, fix="export the signals as numbers")
        return [Recording(path, streams_by_length(fields), notes=tuple(fields.notes()))]


def _take(fields: Fields, name: str, column: Any) -> None:
    import pyarrow as pa

    kind = column.type
    if pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_large_list(kind):
        array = column.combine_chunks()
        width = len(array[0]) if len(array) and array[0].is_valid else 0
        flat = array.flatten()
        if width < 1 or len(flat) != width * len(array) or not _is_number(flat.type):
            fields.left[name] = "lists of different lengths, or of no numbers"
            return
        fields.add(name, _numbers(flat).reshape(-1, width))
    elif pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        to = pa.timestamp("ns") if pa.types.is_timestamp(kind) else pa.duration("ns")
        fields.add(name, _numbers(column.cast(to).cast(pa.int64())) / 1e9, "s")
    elif _is_number(kind):
        fields.add(name, _numbers(column))
    else:
        fields.left[name] = "no numbers"


def _is_number(kind: Any) -> bool:
    import pyarrow as pa

    return (
        pa.types.is_integer(kind)
        or pa.types.is_floating(kind)
        or pa.types.is_boolean(kind)
        or pa.types.is_decimal(kind)
    )


def _numbers(column: Any) -> np.ndarray:
    """(T,) float64, NaN where no value is."""
    import pyarrow as pa

    if pa.types.is_boolean(column.type):
        column = column.cast(pa.uint8())
    return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False), np.float64)
