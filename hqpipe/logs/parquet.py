"""Reader for one flat Parquet file per trial."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs.checks import check_clock, check_length, clock
from hqpipe.logs.columns import TIME, RawTable, Shape
from hqpipe.logs.parquet_file import explained, opened
from hqpipe.logs.values import Senseless, find_senseless, senseless_error

_BATCH = 32768  # rows decoded at a time, of up to 128 columns; fewer of wider files
_BATCH_VALUES = 128 * _BATCH


class ParquetReader:
    """Scalar numeric columns; anything else is refused by name."""

    suffixes = (".parquet",)

    @staticmethod
    def outline(path: Path) -> Shape:
        """Columns and rows as the footer of the file states them; its `dt` is NaN.

        Raises:
            LogError: the file is empty, truncated or no Parquet, or a column is not numeric.
        """
        with opened(path) as file:
            _check_schema(path, file.schema_arrow)
            return Shape(path, tuple(file.schema_arrow.names), file.metadata.num_rows, np.nan)

    @staticmethod
    def shape(path: Path) -> Shape:
        """Columns, rows and median sample time; of the rows only the clock is read.

        Raises:
            LogError: as `outline`.
        """
        found = ParquetReader.outline(path)
        time = np.empty(0)
        if TIME in found.names:
            _, time = next(ParquetReader.read_columns(path, (TIME,)))
        dt = float(np.median(np.diff(clock(time)))) if len(time) > 1 else np.nan
        return Shape(path, found.names, found.rows, dt)

    @staticmethod
    def read(path: Path) -> RawTable:
        """Read every column of one file.

        Raises:
            LogError: as `outline`; a value is missing, or a page does not match its checksum.
        """
        names = ParquetReader.outline(path).names
        columns = dict(ParquetReader.read_columns(path, names))
        with opened(path) as file:
            return RawTable(path, columns, _metadata(file.schema_arrow))

    @staticmethod
    def read_columns(path: Path, names: Sequence[str]) -> Iterator[tuple[str, np.ndarray]]:
        """Name and values (T,) of some columns, one after the other.

        Raises:
            LogError: as `read`.
        """
        with opened(path) as file:
            for name in names:
                with explained(path, name):
                    column = file.read(columns=[name]).column(name)
                if column.null_count:
                    raise _no_value(path, name, _first_null(column), column.null_count)
                yield name, column.to_numpy()

    @staticmethod
    def read_rows(path: Path, ranges: Sequence[tuple[int, int]]) -> tuple[np.ndarray, list[RawTable]]:
        """Check every row of a file and keep some, with no more than a few ten thousand rows in memory besides.

        Args:
            path: the file.
            ranges: first row and the one after the last of each part to keep, in ascending order.

        Returns:
            (T,) s, the whole clock as stored; a table per range.

        Raises:
            LogError: as `read`; samples without physical sense, a broken clock, too few rows.
        """
        with opened(path) as file:
            schema = file.schema_arrow
            _check_schema(path, schema)
            scan = _Scan.of(file.metadata.num_rows, schema, ranges)
            row = 0
            for batch in file.iter_batches(min(_BATCH, max(1, _BATCH_VALUES // len(schema.names)))):
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
    odd: dict[str, Senseless] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: int, schema: Any, ranges: Sequence[tuple[int, int]]) -> _Scan:
        kinds = {name: kind.to_pandas_dtype() for name, kind in zip(schema.names, schema.types, strict=True)}
        kept = [{name: np.empty(stop - start, kind) for name, kind in kinds.items()} for start, stop in ranges]
        return cls(clock(np.empty(rows, kinds[TIME])), ranges, kept)

    def take(self, name: str, column: Any, row: int) -> None:
        """Look at the values of one column from row `row` on."""
        if column.null_count:
            first, count = self.nulls.get(name, (row + _first_null(column), 0))
            self.nulls[name] = first, count + column.null_count
            return
        values = column.to_numpy(zero_copy_only=False)
        if found := find_senseless(name, values, row):
            self.odd[name] = self.odd[name].later(found) if name in self.odd else found
        end = row + len(values)
        if name == TIME:
            self.time[row:end] = clock(values)
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
                raise senseless_error(path, name, self.odd[name])


def _check_schema(path: Path, schema: Any) -> None:
    import pyarrow as pa

    seen = set()
    for name, kind in zip(schema.names, schema.types, strict=True):
        if name in seen:
            raise LogError(f"{path}: column '{name}' is there twice", file=path, field=name, fix="drop one")
        if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)):
            raise LogError(
                f"{path}: column '{name}' holds {_short(str(kind))}, expected numbers",
                file=path,
                field=name,
                fix="drop or convert it",
            )
        seen.add(name)


def _short(text: str) -> str:
    """At most 80 characters of the name of a type, which a nested one can make as long as it likes."""
    return text if len(text) <= 80 else text[:79] + "…"


def _first_null(column: Any) -> int:
    return int(np.flatnonzero(column.is_null().to_numpy(zero_copy_only=False))[0])


def _no_value(path: Path, name: str, row: int, count: int) -> LogError:
    return LogError(
        f"{path}: column '{name}', row {row}: no value ({count} such row{'s' if count > 1 else ''})",
        file=path,
        field=name,
        fix="fill the gap or cut the trial there",
    )


def _metadata(schema: Any) -> dict[str, str]:
    return {
        key.decode("utf-8", "replace"): value.decode("utf-8", "replace")
        for key, value in (schema.metadata or {}).items()
    }
