"""Which trials are held out when logset.yaml does not say, and what of the fit trials is held back for a choice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hqpipe.logs.manifest import SPLITS, Manifest
from hqpipe.logs.sections import rows_within, sections
from hqpipe.logs.trajectory import Excerpt, LogSet, Trajectory, Trial, recording_of

_HELDOUT_SHARE = 0.25
_HELD_BACK_SHARE = (
    0.3  # of every fit trial; assumption: a choice among models needs more to judge on than one model does
)
_GAP_S = 0.5  # assumption: longer than the memory of an actuator, so that no state is shared across it
_GAP_SHARE = 0.05


def split_of(manifest: Manifest | None, files: Sequence[str]) -> dict[str, str]:
    """File → "fit" or "heldout", for files that belong to one of them; a lone file without logset.yaml belongs to both."""
    if manifest:
        return {entry.file: entry.split for entry in manifest.trials}
    return {file: "heldout" if file == files[-1] else "fit" for file in files} if len(files) > 1 else {}


def infer_split(stretches: dict[str, list[tuple[str, Trajectory]]]) -> list[Trial]:
    """Hold out the last trial, or the last quarter of a lone one.

    Before a held-out quarter, 0.5 s (at most 5 % of the trial) belongs to neither part.

    Args:
        stretches: file → (name, trajectory) of each of its stretches, in the order of the file names.
    """
    if len(stretches) == 1:
        return _split_lone(next(iter(stretches.values())))
    last = list(stretches)[-1]
    return [
        Trial(name, "heldout" if file == last else "fit", None, t)
        for file, parts in stretches.items()
        for name, t in parts
    ]


def _split_lone(parts: list[tuple[str, Trajectory]]) -> list[Trial]:
    """The stretches of a lone trial up to its last quarter and from there on; one of them may lie in both."""
    fit, heldout = split_rows(sum(t.samples for _, t in parts), parts[0][1].dt)
    trials, before = [], 0
    for split, (first, last) in zip(SPLITS, (fit, heldout), strict=True):
        before = 0
        for name, t in parts:
            start, stop = max(first - before, 0), min(last - before, t.samples)
            before += t.samples
            if stop - start < 2:  # a clock needs two samples
                continue
            part = t.section(start, stop)
            if t.excerpt:
                part = replace(part, excerpt=replace(t.excerpt, start=t.start + float(t.time[start])))
            trials.append(Trial(name, split, None, part))
    return trials


def split_rows(samples: int, dt: float, share: float = _HELDOUT_SHARE) -> tuple[tuple[int, int], tuple[int, int]]:
    """First row and the one after the last, of the fit and of the held-out part of a lone trial.

    Args:
        samples: rows of the trial. dt: sample time, s. share: of the rows that are held out.
    """
    cut = int(round((1.0 - share) * samples))
    rows = _GAP_S / dt if dt > 0.0 else np.inf  # a broken clock is refused when the rows are read
    gap = max(1, int(round(min(rows, _GAP_SHARE * samples))))
    return (0, cut - gap), (cut, samples)


def hold_back(log_set: LogSet, most: int | None = None) -> LogSet:
    """The fit trials alone, the end of each held out: what a choice among models may see that is to be judged later.

    All parts keep the time of the recorded trial. The held-out trials are not in it.

    Args:
        log_set: with fit trials. most: as in `fit_sections`.
    """
    trials = []
    for trial in fit_sections(log_set, most).trials:
        t = trial.trajectory
        parts = split_rows(t.samples, t.dt, _HELD_BACK_SHARE)
        trials += [replace(_part(trial, *rows), split=name) for name, rows in zip(SPLITS, parts, strict=True)]
    return replace(log_set, trials=tuple(trials))


def fit_sections(log_set: LogSet, most: int | None = None) -> LogSet:
    """The fit trials alone; of more than `most` samples × joints evenly spaced sections, see `hqpipe.logs.sections`."""
    fit = log_set.fit
    rows = rows_within(most, len(log_set.joints), 0) if most else sum(t.trajectory.samples for t in fit)
    if sum(t.trajectory.samples for t in fit) > rows:
        cuts = sections([(t.trajectory.samples, t.trajectory.dt) for t in fit], rows)
        fit = [_part(trial, *cut) for trial, each in zip(fit, cuts, strict=True) for cut in each]
    return replace(log_set, trials=tuple(fit))


def _part(trial: Trial, start: int, stop: int) -> Trial:
    """Some rows of a trial as a trial, with its place in the recorded one."""
    t = trial.trajectory
    excerpt = Excerpt(recording_of(trial), t.start + float(t.time[start] - t.time[0]), t.whole)
    return replace(trial, trajectory=replace(t.section(start, stop), excerpt=excerpt))
