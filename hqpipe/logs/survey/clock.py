"""The clock of each trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.logs.checks import jitter
from hqpipe.logs.trajectory import Trajectory, Trial, recording_of

UNEVEN = 0.05  # of a sample, root mean square; below it the models do not notice, as in hqpipe.logs.log_set
_UNIFORM = 1e-3  # of a sample; less is the rounding of the time column
_GAP = 1.5  # samples; a step from which on a sample is missing, as in hqpipe.logs.checks


@dataclass(frozen=True)
class TrialVerdict:
    """One trial: its length, its clock and what is missing.

    Attributes:
        file: of the recording. split: "fit", "heldout" or "" where it is not known.
        seconds: s, of the recording. samples: that were read. rate_hz: median.
        jitter_rms, jitter_max: deviation of the sample time from its median, share of a sample.
        gaps: steps of more than a sample.
        missing: share of all samples of all channels that are not finite.
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


def trial_verdict(file: str, split: str, parts: Sequence[Trajectory]) -> TrialVerdict:
    """Judge the clock of one trial, of which some sections may have been read."""
    sizes = [jitter(part.time) for part in parts]
    dt = float(np.median([part.dt for part in parts]))
    gaps = sum(int((np.diff(part.time) > _GAP * dt).sum()) for part in parts)
    rms = max(size[0] for size in sizes)
    return TrialVerdict(
        file=file,
        split=split,
        seconds=parts[0].whole,
        samples=sum(part.samples for part in parts),
        rate_hz=1.0 / dt,
        jitter_rms=rms,
        jitter_max=max(size[1] for size in sizes),
        gaps=gaps,
        missing=_missing(parts),
        verdict="gaps" if gaps else "jitter" if rms > UNEVEN else "ok",
    )


def _missing(parts: Sequence[Trajectory]) -> float:
    arrays = [values for part in parts for values in (*part.channels().values(), *part.extra.values())]
    return float(sum((~np.isfinite(values)).sum() for values in arrays) / sum(values.size for values in arrays))
