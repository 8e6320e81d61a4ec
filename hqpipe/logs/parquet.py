"""Reader for one flat Parquet file per trial."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs.checks import check_clock, check_length, not_finite
from hqpipe.logs.columns import TIME, RawTable, Shape

_BATCH = 32768  # rows decoded at a time
_BUFFER = 1 << 20  # bytes of a column read ahead, so that a file with one row group is not held either


class ParquetReader:
    """Scalar numeric columns; anything else is refused by name."""

    suffixes = (".parquet",)

    @staticmethod
    def read(path: Path) -> RawTable:
        """Read every column of one file.

        Raises:
            LogError: the file is empty, truncated or no Parquet, or a column is not numeric.
        """
        import pyarrow.parquet as pq

        with _opened(path):
            table = pq.read_table(path, memory_map=False, partitioning=None)
        _check_schema(path, table.schema)
        columns: dict[str, np.ndarray] = {}
        for name, column in zip(table.schema.names, table.columns, strict=True):
            if column.null_count:
                raise _no_value(path, name, _first_null(column), column.null_count)
            columns[name] = column.to_numpy()
        return RawTable(path, columns, _metadata(table.schema))

    @staticmethod
    def shape(path: Path) -> Shape:
        """Columns, rows and median sample time; of the rows only the clock is read.

        Raises:
            LogError: as `read`.
        """
        import pyarrow.parquet as pq

        with _opened(path), pq.ParquetFile(path) as file:
            _check_schema(path, file.schema_arrow)
            rows, names = file.metadata.num_rows, tuple(file.schema_arrow.names)
            time = file.read(columns=[TIME]).column(0).to_numpy() if TIME in names else np.empty(0)
        return Shape(path, names, rows, float(np.median(np.diff(time))) if len(time) > 1 else np.nan)

    @staticmethod
    def read_rows(path: Path, ranges: Sequence[tuple[int, int]]) -> tuple[np.ndarray, list[RawTable]]:
        """Check every row of a file and keep some, with no more than a few ten thousand rows in memory besides.

        Args:
            path: the file.
            ranges: first row and the one after the last of each part to keep, in ascending order.

        Returns:
            (T,) s, the whole clock as stored; a table per range.

        Raises:
            LogError: as `read`; values that are not finite, a broken clock, too few rows.
        """
        import pyarrow.parquet as pq

        with _opened(path), pq.ParquetFile(path, pre_buffer=False, buffer_size=_BUFFER) as file:
            schema = file.schema_arrow
            _check_schema(path, schema)
            scan = _Scan.of(file.metadata.num_rows, schema, ranges)
            row = 0
            for batch in file.iter_batches(_BATCH):
                for name, column in zip(schema.names, batch.columns, strict=True):
                    scan.take(name, column, row)
                row += batch.num_rows
        scan.judge(path, schema.names)
        check_clock(path, scan.time)
        metadata = _metadata(schema)
        return scan.time, [RawTable(path, columns, metadata) for columns in scan.kept]


@dataclass(eq=False)
class _Scan:
    """What a pass over a file has seen: its clock, the rows to keep, and per column the first bad row and their number."""

    time: np.ndarray
    ranges: Sequence[tuple[int, int]]
    kept: list[dict[str, np.ndarray]]
    nulls: dict[str, tuple[int, int]] = field(default_factory=dict)
    odd: dict[str, tuple[int, float, int]] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: int, schema: Any, ranges: Sequence[tuple[int, int]]) -> _Scan:
        kinds = {name: kind.to_pandas_dtype() for name, kind in zip(schema.names, schema.types, strict=True)}
        kept = [{name: np.empty(stop - start, kind) for name, kind in kinds.items()} for start, stop in ranges]
        return cls(np.empty(rows), ranges, kept)

    def take(self, name: str, column: Any, row: int) -> None:
        """Look at the values of one column from row `row` on."""
        if column.null_count:
            first, count = self.nulls.get(name, (row + _first_null(column), 0))
            self.nulls[name] = first, count + column.null_count
            return
        values = column.to_numpy(zero_copy_only=False)
        if values.dtype.kind == "f" and not (finite := np.isfinite(values)).all():
            at = int(np.argmin(finite))
            first, value, count = self.odd.get(name, (row + at, values[at], 0))
            self.odd[name] = first, value, count + int((~finite).sum())
        end = row + len(values)
        if name == TIME:
            self.time[row:end] = values
        for (start, stop), columns in zip(self.ranges, self.kept, strict=True):
            low, high = max(start, row), min(stop, end)
            if low < high:
                columns[name][low - start : high - start] = values[low - row : high - row]

    def judge(self, path: Path, names: Sequence[str]) -> None:
        """Refuse the file for what was seen, in the order of a file that is read whole."""
        for name in names:
            if name in self.nulls:
                raise _no_value(path, name, *self.nulls[name])
        check_length(path, len(self.time))
        for name in names:
            if name in self.odd:
                raise not_finite(path, name, *self.odd[name])


@contextmanager
def _opened(path: Path) -> Iterator[None]:
    """Say in a user's terms what keeps a file from being read."""
    import pyarrow as pa

    if path.stat().st_size == 0:
        raise LogError(f"{path}: the file is empty (0 bytes); record the trial again or drop it from the log set")
    try:
        yield
    except (pa.ArrowException, OSError) as error:
        reason = str(error).splitlines()[0]
        raise LogError(f"{path}: not a complete Parquet file ({reason}); copy it again, or export it anew") from error


def _check_schema(path: Path, schema: Any) -> None:
    import pyarrow as pa

    seen = set()
    for name, kind in zip(schema.names, schema.types, strict=True):
        if name in seen:
            raise LogError(f"{path}: column '{name}' is there twice; drop one")
        if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)):
            raise LogError(f"{path}: column '{name}' holds {kind}, expected numbers; drop or convert it")
        seen.add(name)


def _first_null(column: Any) -> int:
    return int(np.flatnonzero(column.is_null().to_numpy(zero_copy_only=False))[0])


def _no_value(path: Path, name: str, row: int, count: int) -> LogError:
    return LogError(
        f"{path}: column '{name}', row {row}: no value ({count} such rows); fill the gap or cut the trial there"
    )


def _metadata(schema: Any) -> dict[str, str]:
    return {key.decode(): value.decode("utf-8", "replace") for key, value in (schema.metadata or {}).items()}
