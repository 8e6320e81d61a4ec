"""Back-translation of the paper's coefficients."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.sysid.paper_constants import paper_constants

STIFF, GAIN, DROOP, RADIUS, DT = 2e4, 25.0, 4e-3, 0.06, 1e-3


def test_exact_coefficients_of_a_linear_actuator_return_its_constants():
    rate = STIFF * DROOP
    share = -np.expm1(-rate * DT)
    k3 = share / rate * STIFF / RADIUS**2
    found = paper_constants(np.array([GAIN * k3, share, k3, 0.0]), RADIUS, DT, area=8e-4)
    assert found.stiffness == pytest.approx(STIFF)
    assert found.flow_gain == pytest.approx(GAIN)
    assert found.droop == pytest.approx(DROOP)
    assert found.loop_stiffness == pytest.approx(GAIN / DROOP)
    assert found.bulk_over_volume == pytest.approx(STIFF / (2 * (8e-4 * RADIUS) ** 2))
    assert found.full_force is None


def test_without_leakage_nothing_fades():
    found = paper_constants(np.array([1e5, 0.0, 4e3, 2.0]), RADIUS, DT)
    assert found.relaxation == 0.0 and found.droop == 0.0 and found.loop_stiffness == np.inf
    assert found.stiffness == pytest.approx(4e3 * RADIUS**2 / DT)
    assert found.full_force == pytest.approx(4e3 / (2.0 * DT)) and found.bulk_over_volume is None
