"""Every error that hqpipe raises on purpose.

HqpipeError                  1  a stage failed
├── UsageError               2  wrong option, path or configuration
│   └── ConfigError          2  a field of pipeline.yaml or robot.yaml
├── LogError                 1  a log set cannot be used as it is
├── IdentificationError      1  the data cannot determine what was asked
├── DivergedError            1  a training whose numbers are no longer finite
├── IntegrityError           3  an artifact is stale or was changed
├── GateError                4  a validation threshold was missed
└── LockedError              5  another run holds the artifacts

The number is the exit code of the command line.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable
from typing import Any


class HqpipeError(Exception):
    """A failure with a message that a user can act on.

    Args:
        message: what is wrong, with file, field, what was found and what was expected.
        file: the file or folder that it is about, for scripts.
        field: the field, column or option that it is about, for scripts.
        fix: what to do about it, as an order ("rename it"); part of the text that people read.
    """

    exit_code = 1

    def __init__(
        self,
        message: str,
        *,
        file: str | os.PathLike[str] | None = None,
        field: str | None = None,
        fix: str | None = None,
    ) -> None:
        super().__init__(message)
        self.message = message
        self.file = None if file is None else os.fspath(file)
        self.field = field
        self.fix = fix

    def __str__(self) -> str:
        return f"{self.message}: {self.fix}" if self.fix else self.message

    def in_file(self, path: str | os.PathLike[str], kind: type[HqpipeError]) -> HqpipeError:
        """The same failure as an error `kind` of the file at `path`, which then begins the message."""
        return kind(f"{os.fspath(path)}: {self.message}", file=path, field=self.field, fix=self.fix)

    def to_json(self) -> dict[str, str | None]:
        """What ``--json`` answers under ``error``; None where that is not known."""
        return {"message": str(self), "file": self.file, "field": self.field, "fix": self.fix}


class UsageError(HqpipeError):
    exit_code = 2


class ConfigError(UsageError):
    pass


class LogError(HqpipeError):
    pass


class IdentificationError(HqpipeError):
    pass


class DivergedError(HqpipeError):
    """A training whose numbers are no longer finite; `rows` are those of its metrics table up to there."""

    def __init__(self, message: str, **details: Any) -> None:
        super().__init__(message, **details)
        self.rows: list[dict[str, Any]] = []


class IntegrityError(HqpipeError):
    exit_code = 3


class GateError(HqpipeError):
    exit_code = 4


class LockedError(HqpipeError):
    exit_code = 5


def near_match(name: str, known: Iterable[str]) -> str:
    """Return ``" – did you mean 'x'?"`` for the closest of `known`, or an empty string."""
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=0.6)
    return f" – did you mean '{close[0]}'?" if close else ""


SHOWN = 80
"""Characters of a value that a message repeats."""


def shown(value: object) -> str:
    """The value as a message repeats it, cut where it is long."""
    try:
        text = repr(value)
    except ValueError:  # Python writes out no whole number of thousands of digits
        return "a number that is too long"
    return text if len(text) <= SHOWN else f"{text[: SHOWN - 1]}…"
