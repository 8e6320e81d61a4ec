"""A run that keeps what a change leaves as it was gives what a run from the start gives, up to rounding."""

from __future__ import annotations

import numpy as np
import pytest
from position_loop_logs import planted_logs

from hqpipe.identify.model import all_parameters
from hqpipe.layers.actuator import Actuator
from hqpipe.layers.actuator.driven_signals import SPEEDS
from hqpipe.layers.actuator.repeated_run import RepeatedRun
from hqpipe.machine.chain import residual_windows

STEPS = 120
ROUNDING = 1e-10  # sums are taken in an order that hangs on where arrays lie in memory


@pytest.fixture(scope="module")
def joint():
    return Actuator().joints(planted_logs({}, {}, seconds=3.0, fit=2)).models[0]


def rows(joint, seed):
    """Rows one after the other, each with a few numbers of some effects moved, set to neutral or back."""
    rng = np.random.default_rng(seed)
    parameters = all_parameters(joint)
    neutral = np.array([p.neutral for p in parameters])
    spread = np.array([p.spread if np.isfinite(p.spread) else 0.1 * abs(p.neutral) for p in parameters])
    low, high = (np.array([getattr(p, end) for p in parameters]) for end in ("low", "high"))
    values = neutral.copy()
    for _ in range(STEPS):
        for at in rng.integers(0, len(joint.base) + len(joint.places), rng.integers(1, 4)):
            values[at] = neutral[at] if rng.random() < 0.3 else values[at] + spread[at] * rng.uniform(-1.0, 1.0)
        values = np.clip(values, low, high)
        yield joint.row(values)


@pytest.mark.parametrize("seed", range(4))
def test_runs_in_a_row_are_those_from_the_start(joint, seed):
    signals = joint.records[0].signals
    run = RepeatedRun()
    for row in rows(joint, seed):
        found = run.errors(row, signals, {})
        expected = residual_windows(row, signals)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=ROUNDING * np.abs(expected).max())


def test_other_signals_are_run_from_the_start(joint):
    signals = joint.records[0].signals
    run = RepeatedRun()
    row = next(rows(joint, 1))
    run.errors(row, signals, {})
    faster = signals._replace(velocity=1.1 * signals.velocity)
    for version, given in ((1.0, faster), (0.0, signals), (1.0, faster), (0.5, signals)):
        found = run.errors(row, given, dict.fromkeys(SPEEDS, version))
        expected = residual_windows(row, given)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=ROUNDING * np.abs(expected).max())
