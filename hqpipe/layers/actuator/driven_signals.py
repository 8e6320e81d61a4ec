"""The signals of one record with shares that change seldom, and which of several versions each signal is."""

from __future__ import annotations

from hqpipe.layers.actuator.record import Record
from hqpipe.machine.chain import Signals

SPEEDS = ("raw_velocity", "velocity", "sliding")  # signals that are the speed of the log, or come of it
_DRIVEN = (SPEEDS, ("demand",), ("raw_command", "command"), ("raw_position", "position"))
"""Signals that one share each drives: of the logged speed, the flow by openings, the motion of command and of position."""

Shares = tuple[float, float, tuple[float, ...]]
"""As of `Record.driven_by`."""


class DrivenSignals:
    """What `Record.driven_by` gives, where only what other shares drive than last time is made anew.

    Attributes:
        signals: as they were made last. versions: of those of them that shares drive; the share of a signal says which of
            several it is, see `hqpipe.machine.chain.Loops.arranged`.
    """

    def __init__(self, record: Record) -> None:
        self._record = record
        self._shares: Shares | None = None
        self.signals = record.signals
        self.versions = {name: 0.0 for names in _DRIVEN for name in names}
        self._plays: dict[tuple[float, float], int] = {}

    def by(self, shares: Shares) -> Signals:
        """The signals that shares drive."""
        if shares != self._shares:
            logged, opening, moving = shares
            # A log as fast as the controller has no motion between rows.
            each = zip(_DRIVEN, (logged, opening, *(moving or (0.0, 0.0))), strict=True)
            versions = {name: share for names, share in each for name in names}
            moved = [name for name, version in versions.items() if self.versions[name] != version]
            if moved:
                self.signals = self._record.driven_by(*shares, self.signals, moved)
            self.versions, self._shares = versions, shares
        return self.signals

    def versions_inside(self, change: float, half_play: float) -> dict[str, float]:
        """Versions of all signals where shapes inside the law change some of them: the time by a sudden change of the gain, the
        command by half of a spool's play."""
        found = self.versions | {"time": float(change != 0.0)}
        if half_play:
            play = (found["command"], half_play)
            version = 2.0 + self._plays.setdefault(play, len(self._plays))  # shares go from 0 to 1
            found |= {"raw_command": version, "command": version}
        return found
