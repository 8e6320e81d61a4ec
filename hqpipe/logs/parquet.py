"""Reader for one flat Parquet file per trial."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs.checks import check_clock, check_length
from hqpipe.logs.clocks import clock, repeated_rows
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
        with np.errstate(invalid="ignore"):  # an infinite time is refused when the rows are read
            dt = float(np.median(np.diff(clock(time)))) if len(time) > 1 else np.nan
        return Shape(path, found.names, found.rows, dt)

    @staticmethod
    def read(path: Path) -> RawTable:
        """Read every column of one file; a missing value is NaN.

        Raises:
            LogError: as `outline`; a page does not match its checksum.
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
                yield name, _numbers(column)

    @staticmethod
    def read_rows(
        path: Path, ranges: Sequence[tuple[int, int]], *, strict: bool = False
    ) -> tuple[np.ndarray, list[RawTable]]:
        """Read the clock of a file and some of its rows, with no more than a few ten thousand rows in memory besides.

        Args:
            path: the file.
            ranges: first row and the one after the last of each part to keep, in ascending order.
            strict: refuse the file if any of its rows would have to be repaired.

        Returns:
            (T,) s, the whole clock as stored; a table per range.

        Raises:
            LogError: as `read`; a clock that cannot be used, too few rows.
        """
        with opened(path) as file:
            schema = file.schema_arrow
            _check_schema(path, schema)
            scan = _Scan.of(file.metadata.num_rows, schema, ranges, strict)
            row = 0
            for batch in file.iter_batches(min(_BATCH, max(1, _BATCH_VALUES // len(schema.names)))):
                for name, column in zip(schema.names, batch.columns, strict=True):
                    scan.take(name, column, row)
                row += batch.num_rows
        scan.judge(path, schema.names)
        metadata = _metadata(schema)
        return scan.time, [RawTable(path, columns, metadata) for columns in scan.kept]


@dataclass(eq=False)
class _Scan:
    """What a pass over a file has seen: its clock, the rows to keep, and per column samples without physical sense: those of
    the clock, of the others if it is `strict`."""

    time: np.ndarray
    ranges: Sequence[tuple[int, int]]
    kept: list[dict[str, np.ndarray]]
    strict: bool
    odd: dict[str, Senseless] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: int, schema: Any, ranges: Sequence[tuple[int, int]], strict: bool) -> _Scan:
        kinds = {name: np.dtype(kind.to_pandas_dtype()) for name, kind in zip(schema.names, schema.types, strict=True)}
        time = clock(np.empty(rows, kinds[TIME]))
        # a column of integers may lack values, which are NaN
        kinds = {name: kind if name == TIME or kind.kind == "f" else np.dtype(float) for name, kind in kinds.items()}
        kept = [{name: np.empty(stop - start, kind) for name, kind in kinds.items()} for start, stop in ranges]
        return cls(time, ranges, kept, strict)

    def take(self, name: str, column: Any, row: int) -> None:
        """Look at the values of one column from row `row` on."""
        values = _numbers(column)
        end = row + len(values)
        if (self.strict or name == TIME) and (found := find_senseless(name, values, row)):
            self.odd[name] = self.odd[name].later(found) if name in self.odd else found
        if name == TIME:
            self.time[row:end] = clock(np.nan_to_num(values))
        for (start, stop), columns in zip(self.ranges, self.kept, strict=True):
            low, high = max(start, row), min(stop, end)
            if low < high:
                columns[name][low - start : high - start] = values[low - row : high - row]

    def judge(self, path: Path, names: Sequence[str]) -> None:
        """Refuse the file for what was seen."""
        check_length(path, len(self.time))
        for name in names:
            if name in self.odd:
                raise senseless_error(path, name, self.odd[name])
        (check_clock if self.strict else repeated_rows)(path, self.time)


def _numbers(column: Any) -> np.ndarray:
    """Values of an Arrow column; a missing one is NaN."""
    import pyarrow as pa

    if column.null_count and pa.types.is_boolean(column.type):
        column = column.cast(pa.uint8())
    return column.to_numpy(zero_copy_only=False) if isinstance(column, pa.Array) else column.to_numpy()


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


def _metadata(schema: Any) -> dict[str, str]:
    return {
        key.decode("utf-8", "replace"): value.decode("utf-8", "replace")
        for key, value in (schema.metadata or {}).items()
    }
