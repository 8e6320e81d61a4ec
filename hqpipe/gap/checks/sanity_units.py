"""Trials whose positions are in another unit than those of the others."""

from __future__ import annotations

import numpy as np

from hqpipe.gap.checks.defect import Defect
from hqpipe.logs.trajectory import LogSet, recording_of

FACTORS = {180.0 / np.pi: "degrees where the others are in radians", 1000.0: "mm where the others are in m"}
MIN_TRIALS = 3  # of two trials none is the odd one
CLEAR_STEPS = 5.0  # standard deviation over the usual step, below which noise or a count or two may be all; assumption
MOST = 0.5  # of the joints must be comparable: a unit is that of the whole trial


def unit_defects(log_set: LogSet) -> list[Defect]:
    """Trials in which most joints move more than those of the others by about the ratio of two units.

    A joint is compared over the trials in which it moves: rest, or what a neighbour shakes it by, says nothing of a unit. The
    sections of one recording are one trial. A livelier trial looks alike: whether the factor is one of units, the comparison
    of models says.
    """
    files: dict[str, list[str]] = {}
    parts: dict[str, list[np.ndarray]] = {}
    for trial in log_set.trials:
        files.setdefault(recording_of(trial), []).append(trial.file)
        parts.setdefault(recording_of(trial), []).append(trial.trajectory.position)
    if len(files) < MIN_TRIALS:
        return []
    size = np.array([_motion(each) for each in parts.values()])  # (recordings, J), NaN where a joint rests
    compared = ~np.isnan(size) & (np.sum(~np.isnan(size), axis=0) >= MIN_TRIALS)
    usual = [
        np.median(column[moves]) if moves.any() else np.nan for column, moves in zip(size.T, compared.T, strict=True)
    ]
    found = []
    for name, mine, moves in zip(files, size, compared, strict=True):
        if moves.mean() <= MOST:
            continue
        ratio = float(np.median(mine[moves] / np.array(usual)[moves]))
        factor = min(FACTORS, key=lambda f: abs(np.log(f / ratio)))
        if ratio < np.sqrt(factor):  # nearer to no factor at all
            continue
        text = (
            f"the positions in {name} are {ratio:.3g} times as large as in the other trials: they look like "
            f"{FACTORS[factor]}; convert them"
        )
        found.append(Defect("other_units", tuple(files[name]), (), None, text, fatal=True, factor=factor))
    return found


def _motion(positions: list[np.ndarray]) -> np.ndarray:
    """(J,) standard deviation of the positions, each (T, J), of one recording; NaN for a joint that does not clearly move."""
    size = np.concatenate(positions).std(axis=0)
    steps = np.abs(np.concatenate([np.diff(q, axis=0) for q in positions]))
    usual = np.array([np.median(column[column > 0.0]) if column.any() else np.inf for column in steps.T])
    return np.where(size > CLEAR_STEPS * usual, size, np.nan)
