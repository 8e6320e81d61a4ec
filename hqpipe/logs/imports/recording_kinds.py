"""Kinds of recordings in a set of files: those that have the same fields."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs.imports.arrays import listed
from hqpipe.logs.imports.recording import ImportLogError, Recording
from hqpipe.logs.imports.sources import Found


@dataclass(frozen=True, eq=False)
class RecordingKind:
    """Recordings with the same fields.

    Attributes:
        example: the one with the most rows. rows: of all of them.
        still: (stream, field) that hold one value throughout, in every one of them.
    """

    example: Recording
    rows: int
    still: frozenset[tuple[str, str]]


def recording_kinds(found: Found) -> list[RecordingKind]:
    """The kinds of recordings in these files, the one with the most rows first.

    Raises:
        ImportLogError: no file can be read.
    """
    kinds: dict[frozenset[tuple[str, str]], RecordingKind] = {}
    errors: list[LogError] = []
    for file in found.files:
        try:
            recordings = file.reader.read(file.path)
        except LogError as error:
            errors.append(error)
            continue
        for recording in recordings:
            fields = frozenset((stream.name, name) for stream in recording.streams for name in stream.fields)
            kinds[fields] = _with(kinds.get(fields), recording)
    if not kinds:
        if errors:
            raise errors[0]
        unread = f": no reader for {listed([path.name for path in found.unknown])}" if found.unknown else ""
        raise ImportLogError(f"no file to import{unread}", fix="name files or folders of logs")
    return sorted(kinds.values(), key=lambda kind: -kind.rows)


def still_fields(recording: Recording) -> frozenset[tuple[str, str]]:
    """(stream, field) of the fields that hold one value throughout, or none."""
    return frozenset(
        (stream.name, name)
        for stream in recording.streams
        for name, values in stream.fields.items()
        if len(np.unique(values[np.isfinite(values)])) < 2
    )


def _with(kind: RecordingKind | None, recording: Recording) -> RecordingKind:
    """A kind, with one recording more."""
    rows, still = _rows(recording), still_fields(recording)
    if kind is None:
        return RecordingKind(recording, rows, still)
    example = recording if rows > _rows(kind.example) else kind.example
    return RecordingKind(example, kind.rows + rows, kind.still & still)


def _rows(recording: Recording) -> int:
    """Rows of the longest stream."""
    return max(len(values) for stream in recording.streams for values in stream.fields.values())
