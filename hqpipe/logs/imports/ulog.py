"""ULog files of PX4 (docs.px4.io, ULog File Format)."""

from __future__ import annotations

from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.logs.imports.arrays import listed
from hqpipe.logs.imports.decoding import decoding
from hqpipe.logs.imports.packages import needed
from hqpipe.logs.imports.recording import ImportLogError, Recording, Stream

_CLOCK = "timestamp"  # µs since the autopilot started, in every topic
_TEXT = "char"
_PADDING = "_padding"
_MOST_FIELDS = 4096  # of one topic; assumption: more come from a damaged format line


class UlogReader:
    """Every topic, and every instance of it; a topic that is logged more than once is named `esc_status[1]`.

    A log that ends early, as at a loss of power, is read up to there.
    """

    suffixes = (".ulg", ".ulog")
    extra = "px4"

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """One recording with a stream per topic.

        Raises:
            ImportLogError: no ULog file, damaged before its data, or without a number; or the package is missing.
        """
        needed("pyulog", "px4", path)
        from pyulog import ULog

        with decoding(path, "a ULog file"), redirect_stdout(StringIO()):  # pyulog prints what it finds damaged
            log = ULog(str(path))
            kept = [each for each in log.data_list if _CLOCK in each.data]
            notes = _notes(log, kept)
            kept = [each for each in kept if np.any(each.data[_CLOCK] > 0)]
            if not kept:
                raise ImportLogError(f"{path}: no topic with messages in it", file=path, fix="record the flight again")
            start = min(int(each.data[_CLOCK][each.data[_CLOCK] > 0].min()) for each in kept)
            many = {each.name for each in kept if each.multi_id > 0}
            streams = tuple(_stream(each, start, each.name in many, notes) for each in kept)
        return [Recording(path, streams, notes=tuple(notes))]


def _stream(topic: Any, start: int, many: bool, notes: list[str]) -> Stream:
    name = f"{topic.name}[{topic.multi_id}]" if many else topic.name
    clock = topic.data[_CLOCK]
    good = clock > 0
    order = np.flatnonzero(good)[np.argsort(clock[good], kind="stable")]
    if lost := len(clock) - len(order):
        notes.append(f"{name}: {lost} messages have no timestamp and were left out")
    if np.any(np.diff(order) < 0):
        notes.append(f"{name}: its messages were not in the order of their timestamps")
    kinds = {each.field_name: each.type_str for each in topic.field_data}
    text = [field for field in topic.data if kinds.get(field) == _TEXT]
    if text:
        notes.append(f"{name}: left out {listed(text)} (text)")
    fields = {
        field: np.asarray(values[order], np.float64)
        for field, values in topic.data.items()
        if field not in text and field != _CLOCK and not field.rpartition(".")[2].startswith(_PADDING)
    }
    if len(fields) > _MOST_FIELDS:
        notes.append(f"{name}: left out {len(fields) - _MOST_FIELDS} fields (a topic may have {_MOST_FIELDS})")
        fields = dict(list(fields.items())[:_MOST_FIELDS])
    time = (clock[order].astype(np.int64) - start) / 1e6
    return Stream(name, fields, time=time, time_name=_CLOCK)


def _notes(log: Any, kept: list[Any]) -> list[str]:
    notes = []
    if log.file_corruption:
        notes.append("the file is damaged in places; the messages there are missing")
    if log.dropouts:
        worst = max(each.duration for each in log.dropouts)
        notes.append(f"{len(log.dropouts)} dropouts while logging, the longest {worst} ms")
    if others := [each.name for each in log.data_list if each not in kept]:
        notes.append(f"left out {listed(others)} (no timestamp)")
    return notes
