"""MATLAB files: version 5 with SciPy, version 7.3, which is HDF5, with h5py."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.logs.imports.arrays import Fields
from hqpipe.logs.imports.decoding import decoding
from hqpipe.logs.imports.hdf5 import check_stored, datasets, streams_by_group
from hqpipe.logs.imports.packages import needed
from hqpipe.logs.imports.recording import ImportLogError, Recording

_HDF5 = b"\x89HDF\r\n\x1a\n"
_HDF5_AT = (0, 512)  # MATLAB writes a text header of 512 bytes before the HDF5 part
_DEEPEST = 16  # levels of nested structs; assumption: more are no log


class MatReader:
    """Arrays, also inside structs (`log.q`), and Simulink's structure with time (`out/signals/values`).

    Objects such as timeseries are stored in a form that MathWorks does not publish; they are left out and named.
    """

    suffixes = (".mat",)
    extra = None

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """One recording; arrays of another length than the others have a stream of their own.

        Raises:
            ImportLogError: no MAT file, damaged, too large, or without a signal; h5py is missing for version 7.3.
        """
        fields = Fields()
        with decoding(path, "a MAT file"):
            if _is_hdf5(path):
                _read_7_3(path, fields)
            else:
                _read_5(path, fields)
        if not fields.arrays:
            what = f"{path}: no signal in it, expected vectors or matrices ({'; '.join(fields.notes())})"
            fix = "save arrays: t = ts.Time; x = ts.Data; save(file, 't', 'x')"
            raise ImportLogError(what[:500], file=path, fix=fix)
        return [Recording(path, streams_by_group(fields), notes=tuple(fields.notes()))]


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as stream:
        head = stream.read(max(_HDF5_AT) + len(_HDF5))
    return any(head[at : at + len(_HDF5)] == _HDF5 for at in _HDF5_AT)


def _read_5(path: Path, fields: Fields) -> None:
    from scipy.io import loadmat

    content = loadmat(path, simplify_cells=True)  # structs as dicts; nothing in them is run
    for name, value in content.items():
        if not name.startswith("__"):
            _take(fields, name, value, 0)


def _take(fields: Fields, name: str, value: Any, depth: int) -> None:
    """Take what `loadmat` made of a variable."""
    if depth > _DEEPEST:
        fields.left[name] = f"nested more than {_DEEPEST} levels deep"
    elif isinstance(value, dict):
        for part, inner in value.items():
            _take(fields, f"{name}/{part}", inner, depth + 1)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object and value.ndim == 1):
        for index, inner in enumerate(value):
            label = inner.get("label") if isinstance(inner, dict) else None  # of a signal that Simulink logged
            part = f"{name}/{label}" if isinstance(label, str) and label else f"{name}[{index}]"
            _take(fields, part, inner, depth + 1)
    elif type(value).__name__ in ("MatlabOpaque", "MatlabFunction"):
        fields.left[name] = "a MATLAB object: save its Time and Data as arrays"
    elif isinstance(value, np.ndarray):
        fields.add(name, value)
    else:
        fields.left[name] = "a single value" if isinstance(value, int | float | np.number) else "no numbers"


def _read_7_3(path: Path, fields: Fields) -> None:
    h5py = needed("h5py", "hdf5", path)
    with h5py.File(path, "r") as file:
        check_stored(path, file)
        for name, data in datasets(file):
            kind = data.attrs.get("MATLAB_class", b"")
            kind = kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)
            if name.startswith("#"):  # where MATLAB keeps cells and objects
                continue
            if kind in ("char", "cell", "function_handle") or "MATLAB_object_decode" in data.attrs:
                fields.left[name] = (
                    "a MATLAB object: save its Time and Data as arrays" if kind != "char" else "no numbers"
                )
            elif data.dtype.kind == "O" or data.ndim > 2:
                fields.left[name] = "no numbers" if data.dtype.kind == "O" else "more than two dimensions"
            else:
                fields.add(name, data[()].T)  # MATLAB's order of dimensions is the reverse
    if not fields.arrays and not fields.left:
        raise ImportLogError(f"{path}: no variable in it", file=path, fix="export the signals as arrays")
