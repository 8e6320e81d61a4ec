"""Which trials are held out when logset.yaml does not say."""

from __future__ import annotations

from hqpipe.logs.trajectory import Trajectory, Trial

_HELDOUT_SHARE = 0.25
_GAP_S = 0.5  # assumption: longer than the memory of an actuator, so that no state is shared across it
_GAP_SHARE = 0.05


def infer_split(named: list[tuple[str, Trajectory]]) -> list[Trial]:
    """Hold out the last trial, or the last quarter of a lone one.

    Before a held-out quarter, 0.5 s (at most 5 % of the trial) belongs to neither part.

    Args:
        named: (file, trajectory) in the order of the file names.
    """
    if len(named) > 1:
        last = len(named) - 1
        splits = ["heldout" if i == last else "fit" for i in range(len(named))]
        return [Trial(file, split, None, t) for (file, t), split in zip(named, splits, strict=True)]
    file, whole = named[0]
    fit, heldout = split_rows(whole.samples, whole.dt)
    return [Trial(file, "fit", None, whole.section(*fit)), Trial(file, "heldout", None, whole.section(*heldout))]


def split_rows(samples: int, dt: float) -> tuple[tuple[int, int], tuple[int, int]]:
    """First row and the one after the last, of the fit and of the held-out part of a lone trial.

    Args:
        samples: rows of the trial. dt: sample time, s.
    """
    cut = int(round((1.0 - _HELDOUT_SHARE) * samples))
    gap = int(round(min(_GAP_S / dt, _GAP_SHARE * samples)))
    return (0, cut - gap), (cut, samples)
