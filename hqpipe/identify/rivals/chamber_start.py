"""First guesses of the two-chamber model: the paper's coefficients read as physics."""

from __future__ import annotations

import numpy as np

from hqpipe.identify.constants.paper_constants import paper_constants
from hqpipe.identify.paper_model.problem import Problem
from hqpipe.identify.windows import JointData, Windows

_SPANS = (5, 20)  # samples; regressions over several samples average the torque's noise
_LAGS = (0.001, 0.003)  # s; assumption: servo valves of 50 … 150 Hz
_FULL = (1.0, 3.0)  # share of the largest torque; assumption: a machine is built for some reserve
_NULL = 1e-3  # rad; assumption: small, but off the bound
_SLOPE = 0.3  # 1/rad; assumption: a joint of 1 rad range uses a third of its chamber
_LEAST = 1e-3  # of any coefficient, so that a regression on its bound still gives a machine


def first_guesses(joints: list[JointData], windows: Windows, limit: np.ndarray) -> list[np.ndarray]:
    """(9,) guesses in the order of `hqpipe.identify.rivals.chamber_model.PARAMETERS`.

    Stiffness, flow gain and relaxation follow from the coefficients of eq. (7); the full torque is the effort limit if
    that is known, else a multiple of the largest torque.

    Args:
        joints: that share their parameters. limit: (J,) effort limit, N·m, may be infinite.
    """
    problem = Problem(joints, windows, np.ones(len(joints)), limit)
    largest = max(float(np.abs(data.effort).max()) for data in joints)
    finite = limit[np.isfinite(limit)]
    sizes = [float(finite.max())] if len(finite) else [share * largest for share in _FULL]
    found = []
    for span in [span for span in _SPANS if span <= windows.samples // 2] or [1]:
        k = np.maximum(problem.one_step(span), _LEAST)
        k[1] = min(k[1], 0.9)
        seen = paper_constants(k, 1.0, windows.dt)
        for full in sizes:
            leak = seen.droop * full
            for lag in _LAGS:
                found.append(np.array([full, seen.stiffness, seen.flow_gain, lag, leak, _NULL, _SLOPE, 0.0, 0.0]))
    return found
