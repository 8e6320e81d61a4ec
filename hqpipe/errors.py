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
from collections.abc import Iterable
from typing import Any


class HqpipeError(Exception):
    """A failure with a message that a user can act on."""

    exit_code = 1


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

    def __init__(self, message: str) -> None:
        super().__init__(message)
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
