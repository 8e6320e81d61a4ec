"""Least squares on a joint's model: the effects that a test wants, from every starting value."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.optimize import least_squares

from hqpipe.identify.model import all_parameters, positions


def fitted(model, *effects):
    """Parameter name → value, and the root mean square of the error at the fit and the held-out samples."""
    parameters = all_parameters(model)
    free = positions(model, effects)
    neutral = np.array([p.neutral for p in parameters])
    choices = [[p.neutral] if k < len(model.base) else _starts(p) for k, p in ((i, parameters[i]) for i in free)]
    scale = np.array([_scale(parameters[i]) for i in free])
    low, high = np.array([parameters[i].low for i in free]), np.array([parameters[i].high for i in free])

    def with_free(values):
        every = neutral.copy()
        every[free] = values
        return every

    best = None
    for start in product(*choices):
        found = least_squares(
            lambda values: model.error(with_free(values)),
            np.clip(start, low, high),
            bounds=(low - 1e-12, high + 1e-12),
            x_scale=scale,
            diff_step=1e-4,
        )
        best = found if best is None or found.cost < best.cost else best
    values = with_free(best.x)
    sizes = [float(np.sqrt(np.mean(model.error(values, heldout) ** 2))) for heldout in (False, True)]
    return {parameters[i].name: float(values[i]) for i in free}, sizes


def _starts(parameter):
    if parameter.starts:
        return list(parameter.starts)
    return [parameter.neutral + parameter.spread]


def _scale(parameter):
    return parameter.spread if np.isfinite(parameter.spread) else max(abs(parameter.neutral), 1e-3)
