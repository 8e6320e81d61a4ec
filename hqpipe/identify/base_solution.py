"""The base of a layer fitted by itself, without any effect."""

from __future__ import annotations

from itertools import product

import numpy as np

from hqpipe.identify.least_squares import Fitter, Solution

STARTS = 12  # combinations of starting values that are tried; assumption: more would be a search of its own


def base_solution(fitter: Fitter) -> Solution:
    """The base parameters alone, from the best of their starting values."""
    model = fitter.model
    options = [parameter.starts or (parameter.neutral,) for parameter in model.base]
    starts = []
    for values in list(product(*options))[:STARTS]:
        start = fitter.neutral.copy()
        start[: len(model.base)] = values
        starts.append(start)
    return fitter.fit(np.arange(len(model.base)), starts, 0.0)
