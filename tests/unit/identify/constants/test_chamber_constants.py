"""Quantities of the two-chamber model: which of them a fit tells, and how far."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.identify.constants.chamber_constants import chamber_constants
from hqpipe.identify.rivals.chamber_model import PARAMETERS
from hqpipe.identify.rivals.fit_chambers import ChamberJointFit, ChamberParameter

VALUES = dict(zip(PARAMETERS, (1000.0, 2e4, 25.0, 1.5e-3, 4.0, 1e-3, 0.3, 8.0, 2.0), strict=True))


def fit_of(unknown=(), deviation=0.01) -> ChamberJointFit:
    """Every parameter is known to the same share of itself, but for those that are unknown."""
    values = np.array(list(VALUES.values()))
    known = np.array([name not in unknown for name in VALUES])
    parameters = tuple(
        ChamberParameter(name, "", value, (0.9 * value, 1.1 * value) if told else None, bool(told), False)
        for (name, value), told in zip(VALUES.items(), known, strict=True)
    )
    covariance = np.diag((deviation * values * known) ** 2)
    return ChamberJointFit("knee", parameters, covariance, np.full(len(values), 1e6), 1.0, 1.0)


def test_what_needs_an_undetermined_parameter_is_no_measurement():
    every = {q.name for q in chamber_constants(fit_of())}
    without = {q.name for q in chamber_constants(fit_of(unknown=("leakage",)))}
    assert every - without == {"leakage", "leak time constant", "loop stiffness"}
    assert chamber_constants(fit_of(unknown=tuple(VALUES))) == ()


def test_intervals_end_at_zero():
    for wide, narrow in zip(chamber_constants(fit_of(deviation=2.0)), chamber_constants(fit_of()), strict=True):
        assert wide.interval == (0.0, wide.value + wide.half_width), wide.name
        assert narrow.interval == pytest.approx((narrow.value - narrow.half_width, narrow.value + narrow.half_width))
