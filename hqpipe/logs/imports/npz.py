"""NumPy archives."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from hqpipe.logs.imports.arrays import Fields, streams_by_length
from hqpipe.logs.imports.decoding import check_bytes, decoding
from hqpipe.logs.imports.recording import ImportLogError, Recording


class NpzReader:
    """Arrays of shape (T,) or (T, n) in an .npz file; nothing that needs pickle is read."""

    suffixes = (".npz",)
    extra = None

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """One recording; arrays of another length than most have a stream of their own.

        Raises:
            ImportLogError: no archive, damaged, too large, or without a signal.
        """
        fields = Fields()
        with decoding(path, "a NumPy archive"):
            with zipfile.ZipFile(path) as archive:
                check_bytes(path, sum(entry.file_size for entry in archive.infolist()))
            with np.load(path, allow_pickle=False) as archive:
                for name in archive.files:
                    _take(fields, name, archive)
        if not fields.arrays:
            what = f"{path}: no signal in it, expected arrays of shape (T,) or (T, n) ({'; '.join(fields.notes())})"
            raise ImportLogError(what[:500], file=path, fix="save the signals as arrays of numbers")
        return [Recording(path, streams_by_length(fields), notes=tuple(fields.notes()))]


def _take(fields: Fields, name: str, archive: np.lib.npyio.NpzFile) -> None:
    try:
        values = archive[name]
    except ValueError as error:
        if "allow_pickle" not in str(error):
            raise
        fields.left[name] = "needs pickle, which can run code"
        return
    if isinstance(values, np.ndarray):
        fields.add(name, values)
    else:
        fields.left[name] = "no array"
