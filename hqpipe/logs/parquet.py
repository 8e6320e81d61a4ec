"""Reader for one flat Parquet file per trial."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs.columns import RawTable


class ParquetReader:
    """Scalar numeric columns; anything else is refused by name."""

    suffixes = (".parquet",)

    @staticmethod
    def read(path: Path) -> RawTable:
        """Read every column of one file.

        Raises:
            LogError: the file is empty, truncated or no Parquet, or a column is not numeric.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        if path.stat().st_size == 0:
            raise LogError(f"{path}: the file is empty (0 bytes); record the trial again or drop it from the log set")
        try:
            table = pq.read_table(path, memory_map=False, partitioning=None)
        except (pa.ArrowException, OSError) as error:
            reason = str(error).splitlines()[0]
            raise LogError(
                f"{path}: not a complete Parquet file ({reason}); copy it again, or export it anew"
            ) from error
        columns: dict[str, np.ndarray] = {}
        for name, column in zip(table.schema.names, table.columns, strict=True):
            if name in columns:
                raise LogError(f"{path}: column '{name}' is there twice; drop one")
            kind = column.type
            if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)):
                raise LogError(f"{path}: column '{name}' holds {kind}, expected numbers; drop or convert it")
            if column.null_count:
                row = int(np.flatnonzero(column.is_null().to_numpy())[0])
                raise LogError(
                    f"{path}: column '{name}', row {row}: no value ({column.null_count} such rows); "
                    "fill the gap or cut the trial there"
                )
            columns[name] = column.to_numpy()
        raw = table.schema.metadata or {}
        metadata = {k.decode(): v.decode("utf-8", "replace") for k, v in raw.items()}
        return RawTable(path, columns, metadata)
