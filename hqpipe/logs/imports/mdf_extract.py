"""The channels of an MDF file, extracted in a process of its own.

asammdf copies bytes as the file describes them: a damaged file can end the process that reads it. What is found goes
through a folder, as plain arrays and JSON.

Usage: python -m hqpipe.logs.imports.mdf_extract FILE FOLDER
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.logs.imports.arrays import listed
from hqpipe.logs.imports.decoding import decoding
from hqpipe.logs.imports.recording import ImportLogError, Recording, Stream

OUTLINE, ARRAYS = "outline.json", "arrays.npz"
_TIME = (0, 1)  # sync types of a master in MDF 4: none stated, time; the others are angle, distance and index
_FORMULA = {3: (10,), 4: (3,)}  # conversion types that hold a formula, by version of the format
_MASTER = {3: (1,), 4: (2, 3)}  # channel types of a master
_NO_NUMBERS = {3: (7, 8), 4: tuple(range(6, 17))}  # data types: text, bytes, media, CANopen dates, complex


def extract(path: Path, folder: Path) -> None:
    """Write the arrays of `path`, and an outline with their names or with what is wrong, into `folder`."""
    try:
        recording = _read(path)
    except ImportLogError as error:
        (folder / OUTLINE).write_text(json.dumps({"message": error.message, "fix": error.fix}))
        return
    arrays = {}
    outline: dict[str, Any] = {"notes": recording.notes, "streams": []}
    for index, stream in enumerate(recording.streams):
        arrays[f"{index}"] = stream.time
        arrays |= {f"{index}_{number}": values for number, values in enumerate(stream.fields.values())}
        outline["streams"].append([stream.name, stream.time_name, list(stream.fields), dict(stream.units)])
    np.savez(folder / ARRAYS, **arrays)
    (folder / OUTLINE).write_text(json.dumps(outline))


def _read(path: Path) -> Recording:
    from asammdf import MDF

    notes: list[str] = []
    with decoding(path, "an MDF file"):
        with MDF(path, process_bus_logging=False, use_display_names=False) as file:
            streams = list(_streams(file, notes))
    if not streams:
        what = f"{path}: no channel of numbers with a time ({'; '.join(notes) or 'it has no groups'})"
        raise ImportLogError(what[:500], file=path, fix="export the signals, not the frames of the bus")
    start = min(stream.time[0] for stream in streams)
    streams = [Stream(s.name, s.fields, s.units, s.time - start, s.time_name) for s in streams]
    return Recording(path, tuple(streams), notes=tuple(notes))


def _streams(file: Any, notes: list[str]) -> Iterator[Stream]:
    version = int(file.version[0])
    seen: dict[str, int] = {}
    for number, group in enumerate(file.groups):
        name = (getattr(group.channel_group, "acq_name", "") or f"group{number}").strip()
        seen[name] = seen.get(name, 0) + 1
        if seen[name] > 1:
            name = f"{name}#{seen[name]}"
        if reason := _no_time(file, group, number, version):
            notes.append(f"{name}: not read ({reason})")
            continue
        master = np.asarray(file.get_master(number), np.float64)
        fields, units, left = _channels(file, group, number, version, len(master))
        notes += [f"{name}: left out {listed(names)} ({reason})" for reason, names in left.items()]
        order = np.argsort(master, kind="stable")
        if fields and np.any(np.diff(order) < 0):
            notes.append(f"{name}: its samples were not in the order of their time")
        if fields:
            sorted_fields = {each: values[order] for each, values in fields.items()}
            yield Stream(name, sorted_fields, units, master[order], group.channels[file.masters_db[number]].name)


def _no_time(file: Any, group: Any, number: int, version: int) -> str | None:
    """Why a group is not read, or None."""
    if number not in file.masters_db:
        return "no master channel"
    if version == 4 and (sync := group.channels[file.masters_db[number]].sync_type) not in _TIME:
        return f"its master is no time (sync type {sync})"
    return None if group.channel_group.cycles_nr else "no samples"


def _channels(
    file: Any, group: Any, number: int, version: int, length: int
) -> tuple[dict[str, np.ndarray], dict[str, str], dict[str, list[str]]]:
    """Fields, their units, and reason → names of what is left out."""
    fields: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    left: dict[str, list[str]] = {}
    for index, channel in enumerate(group.channels):
        if channel.channel_type in _MASTER[version] or group.channel_dependencies[index]:
            continue  # what an array or a structure consists of are channels too
        name = channel.name if channel.name not in fields else f"{channel.name}#{index}"
        reason = _unfit(channel, version)
        if reason is None:
            signal = file.get(group=number, index=index, raw=True, ignore_invalidation_bits=True)
            reason = _take(fields, units, name, signal, length)
        if reason:
            left.setdefault(reason, []).append(name)
    return fields, units, left


def _take(fields: dict[str, np.ndarray], units: dict[str, str], name: str, signal: Any, length: int) -> str | None:
    """Put a channel into `fields`; returns why it is left out, or None."""
    if signal.samples.dtype.kind not in "fiub":
        return "no numbers"
    physical = signal.physical(copy=False, ignore_value2text_conversions=True)
    values = np.asarray(physical.samples)
    if values.dtype.kind not in "fiub":
        return "no numbers"
    if values.shape != (length,):
        return "not a value per sample of the group"
    fields[name] = values.astype(np.float64)
    if signal.invalidation_bits is not None:
        fields[name][np.asarray(signal.invalidation_bits, bool)] = np.nan
    if physical.unit:
        units[name] = physical.unit.strip()
    return None


def _unfit(channel: Any, version: int) -> str | None:
    """Why a channel is not read, as far as its description says."""
    if channel.data_type in _NO_NUMBERS[version]:
        return "no numbers"
    return "its conversion is a formula, which is not evaluated" if _has_formula(channel.conversion, version) else None


def _has_formula(conversion: Any, version: int) -> bool:
    """Whether a conversion, or one that it refers to, is a formula: evaluating text from a file could run code."""
    waiting, seen = [conversion], set()
    while waiting:
        one = waiting.pop()
        kind = getattr(one, "conversion_type", None)
        if kind is None or id(one) in seen:
            continue
        seen.add(id(one))
        if kind in _FORMULA[version]:
            return True
        waiting += list((getattr(one, "referenced_blocks", None) or {}).values())
    return False


if __name__ == "__main__":
    extract(Path(sys.argv[1]), Path(sys.argv[2]))
