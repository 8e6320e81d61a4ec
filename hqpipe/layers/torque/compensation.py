"""What the drive seems to add to the torque error for the speed, before anything is fitted."""

from __future__ import annotations

import numpy as np

from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.model import all_parameters
from hqpipe.layers.torque.joint import TorqueJoint

SHARES = (0.0, 1.0, 3.0, 10.0, 30.0)  # of usual effort per usual speed, that are tried; assumption: half a decade apart


def likely_compensation(model: TorqueJoint, per_speed: float, opening_of) -> float:
    """The compensation at which one effect of the valve promises most.

    A prompt linear valve does not show it, and a fit from the wrong one does not find the edges of a valve. So each candidate is
    judged by how much of the squared error of the base the secant of an effect of the valve takes.

    Args:
        per_speed: usual effort per usual speed. opening_of: compensation → (usual, largest) opening of the valve.
    """
    fitter, base = Fitter(model), np.arange(len(model.base))
    solution = fitter.fit(base, fitter.neutral.copy(), 0.0)
    index = [p.name for p in model.base].index("compensation")
    names = [p.name for p in all_parameters(model)]
    span = np.linalg.qr(fitter.jacobian(solution.values, solution.error, np.delete(base, index)))[0]
    best, chosen = -np.inf, 0.0
    for share in SHARES:
        start = solution.values.copy()
        start[index] = share * per_speed
        usual, full = opening_of(start[index])
        tried = {
            "limit": [part * full for part in (0.8, 0.6, 0.4, 0.25)],
            "half_width": [0.1 * usual, 0.3 * usual],
            "ratio": [0.1],
            "droop": [0.2],
            "time_constant_s": [0.001, 0.004],
        }
        for name, numbers in tried.items():
            if name not in names:
                continue
            for number in numbers:
                values = start.copy()
                values[names.index(name)] = number
                change = fitter.error(values) - solution.error
                change -= span @ (span.T @ change)
                size = float(change @ change)
                taken = float(change @ solution.error) ** 2 / size if np.isfinite(size) and size > 0.0 else 0.0
                if taken > best:
                    best, chosen = taken, share * per_speed
    return chosen


