"""Log sets with planted effects."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from hqpipe.logs.trajectory import Excerpt, LogSet

sys.path.insert(0, str(Path(__file__).parents[2] / "recovery"))
import planted_effects as planted

STEPS = 100
TYPICAL = planted.TYPICAL
logs_of = planted.logs_of


def size(*names: str) -> dict[str, dict[str, float]]:
    """Effects at their typical size."""
    return {name: dict(TYPICAL[name]) for name in names}


def in_sections(log_set: LogSet, rows: int, every: int) -> LogSet:
    """The log set as if only the first `rows` of every `every` samples of its trials had been read."""
    trials = []
    for trial in log_set.trials:
        t = trial.trajectory
        for start in range(0, t.samples - rows + 1, every):
            excerpt = Excerpt(trial.file, float(t.time[start]), t.duration)
            part = replace(t.section(start, start + rows), excerpt=excerpt)
            trials.append(replace(trial, file=f"{trial.file} ({start})", trajectory=part))
    return replace(log_set, trials=tuple(trials))
