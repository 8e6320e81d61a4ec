"""Trials of one joint as filtered and decimated samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.identify.model import Samples
from hqpipe.layers.joint_motion.bandwidth import low_passed
from hqpipe.layers.joint_motion.columns import Columns, View
from hqpipe.layers.joint_motion.motion import ParallelFilter

MOST_SAMPLES = 20_000  # of a joint and split: what a search over sets of effects handles in seconds
LONGEST = 200_000  # samples of the log at a time: 150 terms of other joints then take 240 MB
PIECE = 400  # samples of a stretch where a log is too long to use all of it
REST_SHARE = 0.2  # of the filter's weight that may lie on rest; assumption: a reversal passes, a dwell does not
REACH = 0.25  # of a period of the cut-off: half of the main lobe of the low-pass
LONGEST_BRIDGE = 0.25  # of a period of the cut-off: of half of it, the common filter's, a line errs by (2π/8)²/8 = 8 %
SATURATED_RUN = 5  # samples in a row at a trial's largest torque; assumption: fewer are chance in a coarse channel


@dataclass(frozen=True, eq=False)
class Record:
    """One joint of one trial at the rate of the log.

    Attributes:
        file: its name. heldout: its split. start: s, of the section in the recorded trial.
        output: (T,) as measured. usable: (T,) whether a sample is evidence. view: its motion.
    """

    file: str
    heldout: bool
    start: float
    output: np.ndarray
    usable: np.ndarray
    view: View


@dataclass(frozen=True, eq=False)
class Filters:
    """The filters of a joint.

    Attributes:
        cutoff: Hz, of the low-pass without delay on position and torque. parallel: on torque and columns after that.
    """

    cutoff: float
    parallel: ParallelFilter


@dataclass(frozen=True, eq=False)
class Part:
    """All filtered samples of one split; only those in `keep` are judged.

    Attributes:
        files: of the trials. trial, time, position, velocity, output, segment: (N,). columns: (N, K).
        record: (N,) index into the records. centre: (N,) sample of the record.
        rest: (N,) share of the filter's weight on samples at rest. keep: (M,) indices.
    """

    files: tuple[str, ...]
    trial: np.ndarray
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    output: np.ndarray
    segment: np.ndarray
    record: np.ndarray
    centre: np.ndarray
    columns: np.ndarray
    rest: np.ndarray
    keep: np.ndarray

    def without(self, dropped: np.ndarray) -> Part:
        """With the samples of a (M,) mask over `keep` left out."""
        return replace(self, keep=self.keep[~dropped])

    def samples(self, back: int) -> Samples:
        """What is judged; `back`: samples from the output to the one that persistence predicts it by."""
        first = np.searchsorted(self.segment, self.segment)
        earlier = np.maximum(np.arange(len(self.time)) - back, first)
        own = (self.trial, self.time, self.position, self.velocity, self.output, self.output[earlier])
        return Samples(self.files, *(values[self.keep] for values in own))


def bridged(recorded: np.ndarray, cutoff: float, dt: float) -> np.ndarray:
    """(T,) recorded, or interpolated over a gap too short for the filters to tell.

    Args:
        recorded: (T,). cutoff: Hz, of the low-pass on the position. dt: s.
    """
    samples = np.flatnonzero(recorded)
    gaps = np.diff(samples)
    found = recorded.copy()
    for at in np.flatnonzero((gaps > 1) & (gaps * dt * cutoff <= LONGEST_BRIDGE)):
        found[samples[at] : samples[at + 1]] = True
    return found


def usable_samples(output: np.ndarray, recorded: np.ndarray, margin: int) -> np.ndarray:
    """(T,) recorded, finite, not at the limit of the drive or the sensor, and `margin` samples from the ends.

    Args:
        output, recorded: (T,); short gaps in `recorded` bridged.
    """
    found = recorded & np.isfinite(output)
    size = np.abs(output)
    top = size >= np.max(size[found], initial=0.0) * (1.0 - 1e-9)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], top.astype(int), [0]])))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if stop - start >= SATURATED_RUN:
            found[start:stop] = False
    found[:margin] = found[len(found) - margin :] = False
    return found


def part_of(
    records: Sequence[Record], heldout: bool, columns: Columns, filters: Filters, dt: float, mean: float
) -> Part:
    """Filtered samples of the trials of one split.

    Args:
        filters: of position and torque, and of torque and columns.
        mean: of the position, which `View.x` is less. dt: s, of the records.
    """
    low_pass = filters.parallel
    chosen = [k for k, record in enumerate(records) if record.heldout == heldout]
    total = sum(len(records[k].output) // low_pass.step for k in chosen)
    pieces = [(k, *ends) for k in chosen for ends in _pieces(len(records[k].output), low_pass, total)]
    files = tuple(dict.fromkeys(records[k].file for k in chosen))
    smoothed = {k: _smooth(records[k], dt, filters.cutoff) for k in chosen}
    found: list[tuple[np.ndarray, ...]] = []
    for number, (k, start, stop) in enumerate(pieces):
        record, view = records[k], cut(records[k].view, start, stop)
        centres = low_pass.centres(stop - start)
        torque, usable = (values[start:stop] for values in smoothed[k])
        rows = np.vstack([columns.of(view), torque, ~usable, view.own.rest])
        filtered = low_pass.apply(rows)
        many = np.ones(len(centres), dtype=np.int64)
        found.append(
            (
                files.index(record.file) * many,
                record.start + (start + centres) * dt,
                view.x[centres] + mean,
                view.own.velocity[centres],
                filtered[-3],
                number * many,
                k * many,
                start + centres,
                filtered[:-3].T,
                filtered[-1],
                filtered[-2],
            )
        )
    if not found:
        whole, none = np.zeros(0, dtype=np.int64), np.zeros(0)
        empty = np.zeros((0, columns.own + len(columns["coupling"])))
        return Part(files, whole, none, none, none, none, whole, whole, whole, empty, none, whole)
    *values, unusable = (np.concatenate(part) for part in zip(*found, strict=True))
    keep = np.flatnonzero((unusable < 1e-12) & (values[-1] <= REST_SHARE))
    return Part(files, *values, keep)


def _smooth(record: Record, dt: float, cutoff: float) -> tuple[np.ndarray, np.ndarray]:
    """(T,) torque with the low-pass of the position, and which of it is not touched by what cannot be used."""
    usable, samples = record.usable, np.arange(len(record.usable))
    if usable.all() or not usable.any():
        return low_passed(np.where(usable, record.output, 0.0), dt, cutoff), usable
    filled = np.interp(samples, samples[usable], record.output[usable])
    reach = round(REACH / (cutoff * dt))
    bad = np.convolve(~usable, np.ones(2 * reach + 1), "same") > 0.5
    return low_passed(filled, dt, cutoff), ~bad


def _pieces(samples: int, low_pass: ParallelFilter, total: int) -> list[tuple[int, int]]:
    """Start and stop of the stretches of one trial that are used: all of it, or evenly spaced ones; none too long."""
    size = PIECE * low_pass.step
    if total <= MOST_SAMPLES or samples <= size:
        ends = [(start, min(start + LONGEST, samples)) for start in range(0, samples, LONGEST)]
        return [(start, stop) for start, stop in ends if stop - start >= low_pass.length]
    count = max(1, int(samples * MOST_SAMPLES / total / size))
    starts = np.linspace(0, samples - size, count).astype(int)
    return [(int(start), int(start) + size) for start in starts]


def cut(view: View, start: int, stop: int) -> View:
    """A stretch of a motion."""

    def motion(m):
        names = ("position", "velocity", "acceleration", "rest", "direction")
        return replace(m, **{name: getattr(m, name)[start:stop] for name in names})

    others = tuple((x[start:stop], motion(m), turns) for x, m, turns in view.others)
    return View(view.x[start:stop], motion(view.own), others)
