"""A defect of the logs: what is broken, where, and whether a cause may still be sought."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

KINDS = (
    "too_short",
    "rows_out_of_order",
    "held_samples",
    "constant",
    "saturated",
    "velocity_mismatch",
    "swapped",
    "sign_flipped",
    "unsigned",
)
_SHOWN = 6


@dataclass(frozen=True)
class Defect:
    """What is broken in a log set.

    Attributes:
        kind: one of `KINDS`.
        trials: files in which it was found.
        joints: joints concerned; empty if it concerns the whole trial.
        channel: name of the channel in the log format, or None for all channels.
        message: one line: what, where, by which figures, and the mend.
        fatal: whether a cause named from these logs could be the defect in disguise.
    """

    kind: str
    trials: tuple[str, ...]
    joints: tuple[str, ...]
    channel: str | None
    message: str
    fatal: bool


def listed(names: Iterable[str]) -> str:
    """Names in a message; the first six, then how many more."""
    names = list(names)
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more


def where(trials: tuple[str, ...], total: int) -> str:
    """ "in every trial", or the files."""
    return "in every trial" if len(trials) == total and total > 1 else f"in {listed(trials)}"
