"""First values of the four coefficients: differences over a few samples, by least squares."""

from __future__ import annotations

import numpy as np

from hqpipe.layers.actuator.record import Record

SPANS = (1, 5, 20)
"""Rows of the differences; assumption: one of them is long beside the noise and short beside the loop."""
MOST_LEAK = 0.9  # of the torque in a sample; assumption


def first_guesses(record: Record, per_row: int) -> list[dict[str, float]]:
    """Coefficient → value, for each span that a window holds; per_row: samples from one row of the log to the next."""
    s = record.signals
    error, found = s.command - s.position, []
    sums = [np.concatenate([[0.0], np.cumsum(x)]) for x in (error, -s.effort, -s.velocity)]
    for span in (span * per_row for span in SPANS if span * per_row <= s.steps):
        at = (s.first[None, :] + np.arange(0, s.steps - span + 1, span)[:, None]).ravel()
        columns = np.stack([total[at + span] - total[at] for total in sums], axis=1)
        rise = s.effort[at + span] - s.effort[at]
        k1, k2, k3 = np.linalg.lstsq(columns, rise, rcond=None)[0]
        found.append({"k1": max(k1, 0.0), "k2": min(max(k2, 0.0), MOST_LEAK), "k3": max(k3, 0.0), "k4": 0.0})
    return found
