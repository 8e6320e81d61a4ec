"""A defect of the logs: what is broken, where, and whether a cause may still be sought."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hqpipe.logs.columns import joint_column
from hqpipe.logs.findings import in_trials, listed

__all__ = ["KINDS", "Defect", "listed", "of_channel", "where"]

KINDS = (
    "too_short",
    "rows_out_of_order",
    "other_units",
    "held_samples",
    "constant",
    "saturated",
    "velocity_mismatch",
    "swapped",
    "sign_flipped",
    "unsigned",
)
Rows = Mapping[tuple[str, str | None], np.ndarray]
"""(file, joint; None for all joints) → (K,) rows."""


@dataclass(frozen=True)
class Defect:
    """What is broken in a log set.

    Attributes:
        kind: one of `KINDS`.
        trials: files in which it was found.
        joints: joints concerned; empty if it concerns the whole trial.
        channel: name of the channel in the log format, or None for all channels or several.
        message: one line: what, where, by which figures, and after the last semicolon what to do.
        fatal: whether a cause named from these logs could be the defect in disguise.
        channels: those that a swap concerns.
        cells: (file, joint) where it was found, if not every joint in every trial.
        rows: in which it shows, where the other rows are sound.
        order: file → (T,) order in which its rows are right again.
        factor: by which the positions are too large.
    """

    kind: str
    trials: tuple[str, ...]
    joints: tuple[str, ...]
    channel: str | None
    message: str
    fatal: bool
    channels: tuple[str, ...] = ()
    cells: frozenset[tuple[str, str]] = frozenset()
    rows: Rows = field(default_factory=dict, compare=False)
    order: Mapping[str, np.ndarray] = field(default_factory=dict, compare=False)
    factor: float = 1.0
    what: str = ""
    total: int = 0

    @property
    def reason(self) -> str:
        """The message without what to do."""
        return self.message.rpartition("; ")[0] or self.message

    @property
    def fix(self) -> str:
        """The mend."""
        return self.message.rpartition("; ")[2]

    def where_in(self) -> frozenset[tuple[str, str]]:
        """(file, joint) where it was found; empty for whole trials."""
        return self.cells or frozenset((file, joint) for file in self.trials for joint in self.joints)

    def for_joints(self, joints: Sequence[str]) -> Defect:
        """The same in fewer joints; a defect that binds its joints together cannot be parted."""
        return self.within(joints, self.trials)

    def within(self, joints: Sequence[str], files: Collection[str]) -> Defect:
        """The same in fewer joints and trials; a defect that binds its joints together keeps all of them."""
        joints = tuple(joint for joint in self.joints if joint in joints or not self.what)
        cells = frozenset((file, joint) for file, joint in self.where_in() if joint in joints and file in files)
        there = {file for file, _ in cells} if self.joints else set(files)
        trials = tuple(file for file in self.trials if file in there)
        if (joints, trials) == (self.joints, self.trials):
            return self
        rows = {key: rows for key, rows in self.rows.items() if key[0] in trials and key[1] in (None, *joints)}
        part = replace(self, joints=joints, trials=trials, cells=cells, rows=rows)
        if not self.what or not joints or not trials:
            return part
        return replace(part, message=_message(self.channel, joints, trials, self.total, self.what, cells))


def of_channel(
    kind: str,
    channel: str,
    joints: Sequence[str],
    trials: Sequence[str],
    total: int,
    what: str,
    *,
    fatal: bool = True,
    cells: frozenset[tuple[str, str]] = frozenset(),
    rows: Rows | None = None,
) -> Defect:
    """A defect of one channel, found in each of its joints by itself.

    Args:
        kind, channel, joints, trials, fatal, cells, rows: see `Defect`.
        total: trials of the set. what: the message after the place.
    """
    message = _message(channel, joints, trials, total, what, cells)
    return Defect(
        kind,
        tuple(trials),
        tuple(joints),
        channel,
        message,
        fatal,
        cells=cells,
        rows=rows or {},
        what=what,
        total=total,
    )


def _message(
    channel: str | None,
    joints: Sequence[str],
    trials: Sequence[str],
    total: int,
    what: str,
    cells: Collection[tuple[str, str]],
) -> str:
    """Joints that have the defect in the same trials are told together; `cells` is empty where all of them do."""
    together: dict[tuple[str, ...], list[str]] = {}
    for joint in joints:
        own = tuple(file for file in trials if (file, joint) in cells) if cells else tuple(trials)
        together.setdefault(own, []).append(joint)
    places = []
    for files, (first, *others) in together.items():
        more = f" (and of {listed(others)})" if others else ""
        places.append(f"{joint_column(first, channel)}{more} {where(files, total)}")
    return f"{' and '.join(places)}: {what}"


def where(trials: tuple[str, ...], total: int) -> str:
    """ "in every trial", "in 10 of 12 trials (a, b, c and 7 more)", or "in a"."""
    if len(trials) == total and total > 1:
        return "in every trial"
    return f"in {trials[0]}" if len(trials) == 1 else in_trials(trials, range(total))
