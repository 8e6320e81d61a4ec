"""Bursts in which something outside pushes: a hand, a collision, digging. They are left out, for no parameter explains them."""

from __future__ import annotations

import numpy as np

from hqpipe.layers.joint_motion.first_fit import blocks, robust_fit
from hqpipe.layers.joint_motion.records import Part

SPAN_S = 0.25  # of a window; assumption: a push by hand takes longer than that
LEAST_SAMPLES = 4  # of a window: one length of the filter
OUTLIER = 6.0  # times the median of the windows' residuals; assumption: model errors of a fitted joint vary less over a motion
MOST = 0.2  # of the windows; assumption: if more stand out, the model is wrong and nobody pushed


def bursts(fit: Part, others: Part, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Masks over `keep` of both parts: where the residual of a robust fit of all shapes is an outlier for two windows in a row.

    Args:
        dt: s, between filtered samples.
    """
    span = max(SPAN_S, LEAST_SAMPLES * dt)
    typical, masks = None, []
    for part in (fit, others):
        if not len(part.keep):
            masks.append(np.zeros(0, dtype=bool))
            continue
        rows, torque = part.columns[part.keep], part.output[part.keep]
        residual = torque - rows @ robust_fit(rows, torque)
        window = blocks(part.segment[part.keep], part.time[part.keep], span)
        size = np.sqrt(np.bincount(window, residual**2) / np.bincount(window))
        typical = float(np.median(size)) if typical is None else typical
        out = size > OUTLIER * typical
        out &= np.append(out[1:], False) | np.insert(out[:-1], 0, False)
        masks.append(out[window] if out.mean() <= MOST else np.zeros(len(window), dtype=bool))
    return masks[0], masks[1]
