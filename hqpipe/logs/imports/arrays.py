"""Named arrays, as NPZ, MAT and HDF5 files hold them, as streams of fields."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from hqpipe.logs.imports.recording import Stream

_LEAST_ROWS = 2  # a single number is a setting, not a signal
_MOST_COMPONENTS = 512  # of one array; assumption: more are an image or a matrix, not signals of joints
_LISTED = 6


@dataclass
class Fields:
    """Signals found so far, and what was left out.

    Attributes:
        arrays: name → (T,) float64. units: name → as the file states it. left: name → why it was left out.
    """

    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    left: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, values: np.ndarray, unit: str = "") -> None:
        """Take an array; components become fields `name[0]`, `name[1]`, ….

        Args:
            name: of the array. values: (T,), (T, n), or (1, T); of numbers, times, or records of these.
            unit: as the file states it.
        """
        if values.dtype.names:
            for part in values.dtype.names:
                self.add(f"{name}/{part}", values[part], unit)
            return
        if 1 in values.shape and values.ndim > 1:
            values = values.reshape([n for n in values.shape if n != 1] or [1])
        if reason := _unfit(values):
            self.left[name] = reason
        elif values.ndim == 1:
            self._put(name, values, unit)
        else:
            for index, part in enumerate(values.T if values.shape[0] >= values.shape[1] else values):
                self._put(f"{name}[{index}]", part, unit)

    def _put(self, name: str, values: np.ndarray, unit: str) -> None:
        self.arrays[name], stated = as_numbers(values)
        if unit or stated:
            self.units[name] = unit or stated

    def notes(self) -> list[str]:
        """What was left out, a line per reason."""
        by_reason: dict[str, list[str]] = {}
        for name, reason in self.left.items():
            by_reason.setdefault(reason, []).append(name)
        return [f"left out: {listed(names)} ({reason})" for reason, names in by_reason.items()]


def as_numbers(values: np.ndarray) -> tuple[np.ndarray, str]:
    """(T,) as float64, and the unit: dates become seconds since 1970, durations seconds."""
    if values.dtype.kind in "mM":
        seconds = values.astype(f"{values.dtype.kind}8[ns]").astype(np.int64) / 1e9
        return np.where(np.isnat(values), np.nan, seconds), "s"
    return np.ascontiguousarray(values, np.float64), ""


def _unfit(values: np.ndarray) -> str | None:
    """Why an array is no signal, or None."""
    if values.dtype.kind not in "fiubmM":
        return "no numbers"
    if values.ndim == 0 or values.size < _LEAST_ROWS:
        return "a single value"
    if values.ndim > 2:
        return "more than two dimensions"
    if values.ndim == 2 and min(values.shape) > _MOST_COMPONENTS:
        return f"more than {_MOST_COMPONENTS} components"
    return None


def streams_by_length(fields: Fields) -> tuple[Stream, ...]:
    """A stream without a name of the fields that have the most common length, and one named `rows<T>` for each other length."""
    if not fields.arrays:
        return ()
    lengths = Counter(len(values) for values in fields.arrays.values())
    main = max(lengths, key=lambda length: (lengths[length], length))
    found = []
    for length in sorted(lengths, key=lambda length: (length != main, length)):
        names = [name for name, values in fields.arrays.items() if len(values) == length]
        found.append(stream_of("" if length == main else f"rows{length}", fields, names))
    return tuple(found)


def stream_of(name: str, fields: Fields, names: Iterable[str], inside: str = "") -> Stream:
    """A stream of some of the fields; their names lose the prefix `inside`."""
    names = list(names)
    short: Mapping[str, str] = {each: each.removeprefix(inside) for each in names}
    return Stream(
        name,
        {short[each]: fields.arrays[each] for each in names},
        {short[each]: fields.units[each] for each in names if each in fields.units},
    )


def listed(names: list[str]) -> str:
    """Names for a note, the first few of many."""
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more
