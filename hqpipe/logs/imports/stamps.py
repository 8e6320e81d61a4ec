"""The clock of a topic: when its messages were measured, or, if that is not known, when they were logged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hqpipe.logs.imports.recording import ImportLogError, Recording, Stream
from hqpipe.logs.imports.topics import Topic

HEADER, LOG = "header stamp", "log time"
_SAME_CLOCK = 1e9  # ns; assumption: programs on one network deliver within a second, other differences are other clocks
_SPREAD = (5, 95)  # %, so that a single late message does not set it


@dataclass
class _Clock:
    """Times of one topic.

    Attributes:
        times: (T,) ns. name: what they are. notes: of the topic.
        delays: (T,) ns from stamp to log, only where the stamps are used. shift: ns added to bring them to the log's clock.
    """

    times: np.ndarray
    name: str
    notes: list[str]
    delays: np.ndarray | None = None
    shift: int = 0


def recording_of(path: Path, topics: Sequence[Topic], notes: Sequence[str]) -> Recording:
    """One recording with a stream per topic; time is in s from the earliest of them.

    Raises:
        ImportLogError: there is no number in the file.
    """
    kept = [topic for topic in topics if len(topic) and topic.fields()]
    if not kept:
        what = f"{path}: no topic with a number in it ({'; '.join(notes) or 'it has no messages'})"
        raise ImportLogError(what[:500], file=path, fix="record the joint states and commands too")
    clocks = [_clock(topic) for topic in kept]
    _join_clocks(clocks)
    start = min(int(clock.times.min()) + clock.shift for clock in clocks)
    streams, lines = [], list(notes)
    for topic, clock in zip(kept, clocks, strict=True):
        seconds = (clock.times + (clock.shift - start)) / 1e9
        streams.append(Stream(topic.name, topic.fields(), time=seconds, time_name=clock.name))
        lines += [f"{topic.name}: {line}" for line in clock.notes] + topic.notes()
    return Recording(path, tuple(streams), notes=tuple(lines))


def _clock(topic: Topic) -> _Clock:
    log, stamps = topic.log_times(), topic.stamps()
    if stamps is None:
        return _Clock(log, LOG, ["time is the log time, its messages have no stamp"])
    if unsound := _unsound(stamps):
        return _Clock(log, LOG, [f"time is the log time, its header stamps {unsound}"])
    delays = log - stamps
    low, middle, high = np.percentile(delays, (_SPREAD[0], 50, _SPREAD[1])) / 1e6
    spread = f"{_SPREAD[0]} to {_SPREAD[1]} %: {low:.2f} to {high:.2f} ms"
    notes = [f"time is the header stamp, written to the log {middle:.2f} ms later (median; {spread})"]
    if repeats := int(np.count_nonzero(np.diff(stamps) == 0)):
        notes.append(f"{repeats} of {len(stamps)} header stamps repeat the one before")
    return _Clock(stamps, HEADER, notes, delays)


def _unsound(stamps: np.ndarray) -> str | None:
    """Why stamps are no clock, or None."""
    if not np.all(stamps > 0):
        return "are not all set"
    if len(stamps) > 1 and stamps[-1] == stamps[0]:
        return "are all the same"
    if backwards := int(np.count_nonzero(np.diff(stamps) < 0)):
        return f"run backwards {backwards} times"
    return None


def _join_clocks(clocks: list[_Clock]) -> None:
    """Shift stamps of another epoch (simulated time, time since power-on) by their smallest delay, so that topics compare."""
    other = sorted(((float(np.median(c.delays)), c) for c in clocks if c.delays is not None), key=lambda item: item[0])
    groups: list[list[tuple[float, _Clock]]] = []
    for item in other:
        if abs(item[0]) <= _SAME_CLOCK:
            if item[0] < 0:
                item[1].notes.append("the header stamps lie after the log times: the two clocks are not synchronised")
            continue
        if groups and item[0] - groups[-1][-1][0] <= _SAME_CLOCK:
            groups[-1].append(item)
        else:
            groups.append([item])
    for group in groups:
        shift = min(int(clock.delays.min()) for _, clock in group)
        for _, clock in group:
            clock.shift = shift
            clock.notes[0] = (
                f"time is the header stamp, which is on another clock than the log, {shift / 1e9:.3f} s apart; "
                f"shifted by that (the smallest delay), so that its transport delay is not known"
            )
            if (drift := float(np.ptp(clock.delays)) / 1e9) > _SAME_CLOCK / 1e9:
                clock.notes.append(f"the two clocks run {drift:.1f} s apart over the recording")
