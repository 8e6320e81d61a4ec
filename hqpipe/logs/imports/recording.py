"""What a foreign file holds, before anything is known of its joints and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from hqpipe.errors import LogError


class ImportLogError(LogError):
    """A foreign file that cannot be read, or a mapping that does not fit it."""


@dataclass(frozen=True, eq=False)
class Stream:
    """Fields that were sampled together: a table, or a topic.

    Attributes:
        name: of the topic, group or data set; "" for a lone table.
        fields: name → (T,) float64 as stored; NaN where a sample is missing. Components of an array have names of their own,
            `position[0]`, or `position/left_hip` where the file names them.
        units: field → unit as the file states it, for those whose unit it states.
        time: (T,) s, the clock of the stream where the format has one (bags, ULog, MDF); None where the clock is one of
            `fields`, as in tables.
        time_name: what `time` was taken from, e.g. "log time" or "header stamp".
    """

    name: str
    fields: Mapping[str, np.ndarray]
    units: Mapping[str, str] = field(default_factory=dict)
    time: np.ndarray | None = None
    time_name: str = ""


@dataclass(frozen=True, eq=False)
class Recording:
    """One trial in a foreign file.

    Attributes:
        path: the file. name: of the trial, unique within the file; "" if the file holds one.
        streams: on clocks of their own, all of the same epoch.
        notes: what had to be left out or repaired while reading, a line each.
        drive, load: joint → quantity → value where the format states them, as in logset.yaml.
    """

    path: Path
    streams: tuple[Stream, ...]
    name: str = ""
    notes: tuple[str, ...] = ()
    drive: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    load: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


class ForeignReader(Protocol):
    """A reader of one foreign format.

    Attributes:
        suffixes: of its files, lower case with the dot.
        extra: the pip extra that brings the packages it needs; None if hqpipe always has them.

    Two more methods are optional: `claims_file(path) -> bool`, where other formats use the same suffix, and
    `claims_folder(path) -> bool`, where a whole folder is one recording.
    """

    suffixes: tuple[str, ...]
    extra: str | None

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """Every recording in a file.

        Raises:
            LogError: the file cannot be read, or a package is missing; most are `ImportLogError`.
        """
        ...
