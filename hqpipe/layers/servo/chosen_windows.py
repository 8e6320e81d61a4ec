"""Which windows a joint is judged in, where its logs hold more than can be simulated in every call."""

from __future__ import annotations

import numpy as np

from hqpipe.layers.servo.tracks import Tracks, Windows

_MOVES = 0.1  # of the largest change within a window, from which a window is one of motion; assumption
_LARGEST = 0.99  # quantile that counts as the largest; the rest may be glitches


def chosen(tracks: Tracks, windows: Windows, samples: int, run_in: int, most: int) -> Windows:
    """At most `most` of the windows, evenly spaced; of those at rest evenly no more than of those in motion.

    Many logs stand still for most of the time, where one window says what all of them do.

    Args:
        samples: of a window after its run-in, which has `run_in`. most: windows.
    """
    count = len(windows.start)
    if count <= most:
        return windows
    moves = _in_motion(tracks, windows, samples, run_in)
    moving, resting = np.flatnonzero(moves), np.flatnonzero(~moves)
    if len(resting) <= len(moving):
        return windows.of(_evenly(np.arange(count), most))
    rests = max(most // 2, most - len(moving))
    return windows.of(np.sort(np.concatenate([_evenly(moving, most - rests), _evenly(resting, rests)])))


def _in_motion(tracks: Tracks, windows: Windows, samples: int, run_in: int) -> np.ndarray:
    """(M,) whether the position or the input changes in a window by a part of what it does in those of most motion."""
    index = windows.start[:, None] + np.arange(run_in, run_in + samples + 1)
    found = np.zeros(len(index), dtype=bool)
    for signal in (tracks.smooth, tracks.inputs):
        change = np.ptp(signal[index], axis=1)
        found |= change > _MOVES * np.quantile(change, _LARGEST)
    return found


def _evenly(index: np.ndarray, most: int) -> np.ndarray:
    """At most `most` of an index, evenly spaced."""
    if len(index) <= most:
        return index
    return index[np.linspace(0, len(index) - 1, most).round().astype(np.int64)]
