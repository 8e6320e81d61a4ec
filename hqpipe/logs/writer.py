"""Writing log sets: the same data give the same bytes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs import FORMAT
from hqpipe.logs.checks import check_clock, check_shapes, check_values
from hqpipe.logs.clocks import clock, repeated_rows
from hqpipe.logs.columns import TIME, RawTable, check_names, joints_of, order_columns, unit_of
from hqpipe.logs.drive import Stated
from hqpipe.logs.manifest import FILE, SPLITS, Manifest, TrialEntry, write_manifest

_ROW_GROUP = 65536  # rows; fixed, because the bytes depend on it
_ZSTD_LEVEL = 3


class LogSetWriter:
    """Write trials one at a time, then logset.yaml when the block is left without an error.

    Args:
        folder: made if absent; must hold no log set yet.
        robot, base, control_mode, effort_source, rate_hz: fields of logset.yaml, see `Manifest`.
        clock_source: what the `time` column was taken from, e.g. "controller tick".
        urdf_sha256: hash of the robot description that the joints belong to.
        drive, load: joint → quantity → value, where they are known. kinds: joint → "revolute" or "prismatic", likewise.
    """

    def __init__(
        self,
        folder: Path,
        *,
        robot: str | None = None,
        base: str | None = None,
        control_mode: str | None = None,
        effort_source: str | None = None,
        rate_hz: float | None = None,
        clock_source: str = "unspecified",
        urdf_sha256: str = "",
        drive: Mapping[str, Mapping[str, float]] | None = None,
        load: Mapping[str, Mapping[str, float]] | None = None,
        kinds: Mapping[str, str] | None = None,
    ) -> None:
        self.folder = Path(folder)
        if (self.folder / FILE).exists():
            raise LogError(f"{self.folder}: already holds a log set", file=self.folder, fix="write to an empty folder")
        self.folder.mkdir(parents=True, exist_ok=True)
        stated = {"drive": _plain(drive), "load": _plain(load), "kinds": dict(kinds or {})}
        self._manifest = Manifest((), robot, base, control_mode, effort_source, rate_hz, **stated)
        self._metadata = {"clock_source": clock_source, "urdf_sha256": urdf_sha256}
        self._entries: list[TrialEntry] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()

    def add(
        self,
        file: str,
        columns: Mapping[str, np.ndarray],
        *,
        split: str = "fit",
        command: Mapping[str, float] | None = None,
        base: str | None = None,
        drive: Mapping[str, Mapping[str, float]] | None = None,
        load: Mapping[str, Mapping[str, float]] | None = None,
        clock_source: str | None = None,
        repairable: bool = False,
    ) -> Path:
        """Write one trial.

        Args:
            file: name inside the folder, ending in .parquet.
            columns: full column name → (T,); stored as float32, `time` as float64.
            split: "fit" or "heldout".
            command: body velocity command of the trial, for logset.yaml.
            base, drive, load, clock_source: where the trial differs from the log set.
            repairable: accept missing samples (NaN) and an irregular clock, which the reader repairs; time must still increase.

        Raises:
            LogError: the columns would not be accepted when read back.
        """
        path = self.folder / file
        if path.suffix != ".parquet" or split not in SPLITS or path.exists():
            raise LogError(
                f"{path} (split {split}): expected a new .parquet file, split fit or heldout",
                file=path,
                fix="give the trial a name of its own that ends in .parquet",
            )
        table = RawTable(path, {name: np.asarray(values) for name, values in columns.items()})
        check_names(table)
        if repairable:
            _check_repairable(table)
        else:
            check_values(table)
            check_clock(path, clock(table.columns[TIME]))
        numbers = None if command is None else {k: float(v) for k, v in command.items()}
        entry = TrialEntry(file, split, numbers, base, _plain(drive), _plain(load))
        self._write(table, entry, {} if clock_source is None else {"clock_source": clock_source})
        self._entries.append(entry)
        return path

    def taken_back(self, file: str) -> dict[str, np.ndarray]:
        """Remove a trial that was added, and return its columns as they were written."""
        import pyarrow.parquet as pq

        path = self.folder / file
        table = pq.read_table(path)
        self._entries = [entry for entry in self._entries if entry.file != file]
        path.unlink()
        return {name: table[name].to_numpy() for name in table.column_names}

    def _write(self, table: RawTable, entry: TrialEntry, metadata: Mapping[str, str]) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        joints = joints_of(table.columns)
        names = order_columns(table.columns, joints)
        arrays = [pa.array(table.columns[n].astype(np.float64 if n == TIME else np.float32, copy=False)) for n in names]
        metadata = {
            **self._metadata,
            **metadata,
            "format": FORMAT,
            "joints": ",".join(joints),
            "units": json.dumps({n: unit_of(n) for n in names if unit_of(n)}, ensure_ascii=False),
            "split": entry.split,
            "command": json.dumps(entry.command, sort_keys=True),
        }
        schema = pa.schema([(n, a.type) for n, a in zip(names, arrays, strict=True)], metadata=metadata)
        pq.write_table(
            pa.Table.from_arrays(arrays, schema=schema),
            table.path,
            row_group_size=_ROW_GROUP,
            version="2.6",
            use_dictionary=False,
            use_byte_stream_split=True,
            compression="zstd",
            compression_level=_ZSTD_LEVEL,
            write_page_checksum=True,  # a changed byte is found when the log set is read, wherever it lies
        )

    def close(self) -> None:
        """Write logset.yaml.

        Raises:
            LogError: no trial was added.
        """
        if not self._entries:
            raise LogError(f"{self.folder}: a log set needs at least one trial", file=self.folder, fix="add one")
        write_manifest(self.folder / FILE, replace(self._manifest, trials=tuple(self._entries)))


def _check_repairable(table: RawTable) -> None:
    """Refuse what a reader cannot repair: too few rows, columns of unequal length, time that does not increase."""
    check_shapes(table)
    time = table.columns[TIME]
    check_values(RawTable(table.path, {TIME: time}))
    repeated_rows(table.path, clock(time))


def _plain(per_joint: Mapping[str, Mapping[str, float]] | None) -> Stated:
    return {j: {k: float(v) for k, v in found.items()} for j, found in (per_joint or {}).items()}
