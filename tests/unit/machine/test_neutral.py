"""Adding an effect at its neutral value changes nothing, whichever others are there."""

from __future__ import annotations

import numpy as np
import pytest
from machine.signal_windows import windows_of

from hqpipe.logs.trajectory import Trajectory
from hqpipe.machine import EFFECTS
from hqpipe.machine.bases.hydraulic import plain
from hqpipe.machine.chain import loops, residual_windows
from hqpipe.machine.layout import neutral_row, slot, slots

BASE = {"k1": 540.0, "k2": 0.05, "k3": 21.6, "k4": 0.36}
IN_THE_LOOP = [name for name, effect in EFFECTS.items() if effect.blocks]
STEPS = 100


def base_row():
    row = neutral_row()
    for key, value in BASE.items():
        row[slot("base", key)] = value
    return row


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


def filled(name):
    """A row with an effect whose shape parameters are there and whose first number is not."""
    row = base_row()
    for column, parameter in zip(slots(name), EFFECTS[name].parameters, strict=True):
        if not parameter.search.counts and parameter.name not in ("asymmetry_nm", "rounding", "presliding_rad"):
            row[column] = 0.3
    return row


@pytest.mark.parametrize("name", IN_THE_LOOP)
def test_neutral_effect_is_no_effect(motion, name):
    """The first parameter at zero switches the effect off, whatever its shape parameters say."""
    signals = windows_of([motion], 0, STEPS)
    np.testing.assert_array_equal(residual_windows(filled(name), signals), residual_windows(base_row(), signals))


def test_a_row_without_effects_is_the_law_bit_for_bit(motion):
    """In windows, row by row, and in a batch."""
    t, row = motion, base_row()
    signals = windows_of([t], 0, STEPS)
    windows = residual_windows(row, signals)
    memory, tau = np.zeros((1, loops().memory)), t.effort[0].copy()
    planes, many = np.zeros((loops().memory, 1)), t.effort[0].copy()
    prepared, torque = loops().prepare(row[None]), float(t.effort[0, 0])
    for k in range(t.samples - 1):
        if k % STEPS == 0 and k // STEPS < len(signals.first):
            restarted = float(t.effort[k, 0])
        q_des, q, qd = t.position_command[k], t.position[k], t.velocity[k]
        error, speed = float(q_des[0] - q[0]), signals.velocity[k]
        restarted = plain(restarted, error, speed, *BASE.values(), np.inf)
        if k // STEPS < len(signals.first):
            assert windows[k % STEPS, k // STEPS] == restarted - t.effort[k + 1, 0]
        torque = plain(torque, error, float(qd[0]), *BASE.values(), np.inf)
        loops().step_row(row[None], tau, memory, q_des, q, qd)
        loops().step_batch(*prepared, many, planes, q_des, q, qd, 1)
        assert tau[0] == many[0] == torque
