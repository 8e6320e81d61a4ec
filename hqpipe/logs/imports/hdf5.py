"""HDF5 files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hqpipe.logs.imports.arrays import Fields, stream_of, streams_by_length
from hqpipe.logs.imports.decoding import check_bytes, decoding
from hqpipe.logs.imports.packages import needed
from hqpipe.logs.imports.recording import ImportLogError, Recording, Stream

_UNIT_NAMES = ("units", "unit", "Units", "Unit")


class Hdf5Reader:
    """Data sets of shape (T,) or (T, n), also inside groups.

    Groups that hold the same data sets, as `data/demo_0`, `data/demo_1` of robot learning, are recordings of their own.
    """

    suffixes = (".h5", ".hdf5", ".hdf", ".he5")
    extra = "hdf5"

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """Recordings; where lengths differ, a stream per group. Links and data sets that lie in other files are not followed.

        Raises:
            ImportLogError: h5py is missing; no HDF5, damaged, too large, or without a signal.
        """
        h5py = needed("h5py", "hdf5", path)
        with decoding(path, "an HDF5 file"), h5py.File(path, "r") as file:
            check_stored(path, file)
            groups = _alike(file)
            recordings = [_recording(path, group, name) for name, group in groups.items()]
        found = [recording for recording in recordings if recording.streams]
        if not found:
            what = f"{path}: no signal in it, expected data sets of shape (T,) or (T, n)"
            raise ImportLogError(what, file=path, fix="export the signals as arrays of numbers")
        return found


def check_stored(path: Path, file: Any) -> None:
    """Refuse declared sizes that do not fit into memory; a chunk that was never written takes no room in the file."""
    check_bytes(path, sum(data.size * max(8, data.dtype.itemsize) for _, data in datasets(file)))


def datasets(group: Any) -> list[tuple[str, Any]]:
    """(path within the group, data set) of all data sets that lie in this file and are no object references."""
    import h5py

    found: list[tuple[str, Any]] = []

    def visit(name: str, node: Any) -> None:  # visititems follows no soft or external link
        if isinstance(node, h5py.Dataset) and node.shape is not None and not node.is_virtual and not node.external:
            found.append((name, node))

    group.visititems(visit)
    return found


def _alike(file: Any) -> dict[str, Any]:
    """Name → group of each recording: the groups that hold the same data sets, else the whole file under ""."""
    import h5py

    group = file
    while True:
        inner = [(name, node) for name, node in _members(group) if isinstance(node, h5py.Group)]
        kinds = [tuple(name for name, _ in datasets(node)) for _, node in inner]
        if len(inner) > 1 and kinds[0] and len(set(kinds)) == 1 and len(kinds[0]) > 1:
            return dict(inner)
        if len(inner) != 1 or len(datasets(group)) != len(kinds[0]):
            return {"": file}
        group = inner[0][1]


def _members(group: Any) -> list[tuple[str, Any]]:
    """Members that lie in this file itself."""
    import h5py

    return [(n, group[n]) for n in group if isinstance(group.get(n, getlink=True), h5py.HardLink)]


def _recording(path: Path, group: Any, name: str) -> Recording:
    fields = Fields()
    for each, data in datasets(group):
        unit = next((data.attrs[key] for key in _UNIT_NAMES if key in data.attrs), "")
        unit = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else unit
        if data.dtype.kind in "OSV" and not data.dtype.names:
            fields.left[each] = "no numbers"
        elif data.ndim > 2:
            fields.left[each] = "more than two dimensions"
        else:
            fields.add(each, data[()], unit if isinstance(unit, str) else "")
    return Recording(path, streams_by_group(fields), name, tuple(fields.notes()))


def streams_by_group(fields: Fields) -> tuple[Stream, ...]:
    """One stream if all fields have one length, a stream per group if those of every group have, else one per length."""
    lengths = {len(values) for values in fields.arrays.values()}
    groups: dict[str, list[str]] = {}
    for name in fields.arrays:
        groups.setdefault(name.rpartition("/")[0], []).append(name)
    if len(lengths) < 2 or any(len({len(fields.arrays[n]) for n in names}) > 1 for names in groups.values()):
        return streams_by_length(fields)
    return tuple(stream_of(group, fields, names, f"{group}/" if group else "") for group, names in groups.items())
