"""Adding an effect at its neutral value changes nothing, whichever mode and whichever others are there."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from hqpipe.logs.trajectory import Trajectory
from hqpipe.machine import EFFECTS
from hqpipe.machine.layout import NOT_IN_THE_LOOP, neutral_row, slot, slots
from hqpipe.machine.loops.augmented_columns import ALL, MODES
from hqpipe.machine.loops.augmented_signals import make_work
from hqpipe.machine.loops.augmented_windows import simulate

sys.path.insert(0, str(Path(__file__).parents[1] / "kernels"))
from signal_windows import windows_of

BASE = {
    "position": {"k1": 540.0, "k2": 0.05, "k3": 21.6, "k4": 0.36},
    "torque": {"k1": 0.08, "k3": 2.0},
}


@pytest.fixture(scope="module")
def motion():
    rng = np.random.default_rng(0)
    time = np.arange(1200) * 1e-3
    rates, phases = rng.uniform(1.0, 5.0, (4, 3, 1)), rng.uniform(0.0, 6.0, (4, 3, 1))
    waves = np.sin(2 * np.pi * rates * time + phases).sum(axis=1)[:, :, None]
    position = 0.2 * waves[0]
    return Trajectory(
        time,
        ("j0",),
        position,
        np.gradient(position, 1e-3, axis=0),
        effort=100.0 * waves[1],
        position_command=position + 0.05 * waves[2],
        effort_command=120.0 * waves[3],
    )


def output(p, signals):
    out = np.empty((signals.steps, len(signals.first)))
    simulate(p, signals, make_work(signals), out, ALL)
    return out


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", [name for name in EFFECTS if name not in NOT_IN_THE_LOOP])
def test_neutral_effect_is_no_effect(motion, mode, name):
    """The first parameter at zero switches the effect off, whatever its shape parameters say."""
    signals = windows_of([motion], 0, 100, mode)
    row = neutral_row()
    for key, value in BASE[mode].items():
        row[slot("base", key)] = value
    expected = output(row, signals)
    for column, parameter in zip(slots(name), EFFECTS[name].parameters, strict=True):
        if not parameter.counts and parameter.name not in ("asymmetry_nm", "rounding", "presliding_rad"):
            row[column] = 0.3
    np.testing.assert_array_equal(output(row, signals), expected)
