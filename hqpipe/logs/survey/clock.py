"""The clock of each trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.logs.clocks import STEADY
from hqpipe.logs.trajectory import AsRecorded, Trajectory, Trial, recording_of

_UNIFORM = 1e-3  # of a sample; less is the rounding of the time column


@dataclass(frozen=True)
class TrialVerdict:
    """One trial: its length, its clock and what is missing.

    Attributes:
        file: of the recording. split: "fit", "heldout" or "" where it is not known.
        seconds: s, of the recording. samples: that were read. rate_hz: median.
        jitter_rms, jitter_max: deviation of the sample time from its median, share of a sample.
        gaps: places where rows are missing. lost: share of the rows that are. stretches: into which it was cut.
        missing: share of all samples of all channels that are missing or without physical sense.
        verdict: "ok", "jitter", "gaps" or "refused". error: why it is refused.
    """

    file: str
    split: str
    seconds: float | None = None
    samples: int | None = None
    rate_hz: float | None = None
    jitter_rms: float | None = None
    jitter_max: float | None = None
    gaps: int | None = None
    lost: float | None = None
    stretches: int | None = None
    missing: float | None = None
    verdict: str = "ok"
    error: str | None = None

    @property
    def clock(self) -> str:
        """ "uniform", "jitter" or "gaps"; "" of a file that could not be read."""
        if self.jitter_rms is None:
            return ""
        return "gaps" if self.gaps else "uniform" if self.jitter_rms <= _UNIFORM else "jitter"


def recordings(trials: Sequence[Trial]) -> dict[tuple[str, str], list[Trajectory]]:
    """(file, split) → what was read of it, a whole trial or some sections."""
    found: dict[tuple[str, str], list[Trajectory]] = {}
    for trial in trials:
        found.setdefault((recording_of(trial), trial.split), []).append(trial.trajectory)
    return found


def trial_verdict(file: str, split: str, parts: Sequence[Trajectory], before: Sequence[AsRecorded]) -> TrialVerdict:
    """Judge the clock of one trial.

    Args:
        parts: stretches or sections of it. before: the file, or its sections, before their repair.
    """
    rows = sum(each.rows for each in before)
    gaps = sum(each.gaps for each in before)
    rms = max(each.jitter_rms for each in before)
    return TrialVerdict(
        file=file,
        split=split,
        seconds=parts[0].whole,
        samples=sum(part.samples for part in parts),
        rate_hz=float(np.median([each.rate_hz for each in before])),
        jitter_rms=rms,
        jitter_max=max(each.jitter_max for each in before),
        gaps=gaps,
        lost=sum(each.lost for each in before) / (rows + sum(each.lost for each in before)),
        stretches=sum(each.stretches for each in before),
        missing=sum(each.missing * each.rows for each in before) / rows,
        verdict="gaps" if gaps else "jitter" if rms > STEADY else "ok",
    )
