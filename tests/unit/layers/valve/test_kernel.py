"""The compiled simulation against plain numpy: inert at neutral values bit for bit, and each effect by itself."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.layers.valve import kernel
from hqpipe.layers.valve.kernel import LAYOUT, beyond, held_mean, opened, run_blocks

DT = 0.01
NEUTRAL = {
    "recovery_s": 0.1,
    "damping_ratio": 0.4,
    "area_ratio": 1.0,
    "drawn_ratio": 1.0,
    "other_kinds": 1.0,
    "longest_s": 2.0,
}
NEUTRAL |= dict.fromkeys(("limit", "speed_limit", "upper_speed", "lower_speed"), np.inf)
GAIN, ZERO = 0.731, 0.0437  # unit per s and command, command


def row(**numbers):
    base = NEUTRAL | {"gain": GAIN, "neutral": ZERO, "dt": DT, "command_scale": 1.0, "own_demand": 1.0} | numbers
    return np.array([base.get(name, 0.0) for name in LAYOUT])


def signals(samples, **rows):
    values = np.random.default_rng(7).uniform(0.1, 1.0, (10, samples))
    values[kernel.LOSS] = 0.0
    for name, value in rows.items():
        values[getattr(kernel, name)] = value
    return values


def simulate(command, substeps=1, logged=None, **numbers):
    last, velocity = len(command) - 1, np.zeros(len(command))
    bounds = [np.array([k]) for k in (0, last, 0, 0, last + 1)]
    logged = signals(len(command)) if logged is None else logged
    run_blocks(row(**numbers), command, logged, *bounds, substeps, velocity)
    return velocity


@pytest.fixture
def command():
    return np.random.default_rng(3).uniform(-1.0, 1.0, 200)


def test_neutral_values_leave_the_straight_line_bit_for_bit(command):
    assert np.array_equal(simulate(command), GAIN * (command - ZERO))


def test_the_straight_line_does_not_depend_on_the_substeps(command):
    assert simulate(command, substeps=7) == pytest.approx(simulate(command), abs=1e-12)


def test_a_held_command_is_averaged_over_the_time_it_is_seen():
    command = np.array([1.0, 3.0, 5.0])
    assert held_mean(command, 0, 2, 0.25, 1.0) == pytest.approx(0.75 * 1.0 + 0.25 * 3.0)
    assert held_mean(command, 0, 2, -3.0, 1.0) == 1.0 and held_mean(command, 0, 2, 7.0, 1.0) == 5.0


def test_a_delay_of_a_sample_and_a_half(command):
    expected = GAIN * (0.5 * (command[:-2] + command[1:-1]) - ZERO)
    assert simulate(command, delay_s=1.5 * DT)[2:] == pytest.approx(expected)


def test_the_edge_of_a_deadband_is_smooth_and_exact_away_from_it():
    assert beyond(-0.2, 0.1) == 0.0 and beyond(0.2, 0.1) == 0.2 and beyond(0.0, 0.1) == pytest.approx(0.025)
    p = row(half_width=0.2, neutral=0.0, limit=0.7)
    assert [opened(p, u) for u in (-0.9, -0.1, 0.1, 0.5)] == pytest.approx([-0.5, 0.0, 0.0, 0.3])


def test_a_lag_reaches_its_share_of_a_step():
    step = np.concatenate([np.full(20, ZERO), np.full(80, ZERO + 1.0)])
    lag = 0.03
    time = (np.arange(80) + 0.5) * DT
    mean = 1.0 - lag / DT * (np.exp(-(time - 0.5 * DT) / lag) - np.exp(-(time + 0.5 * DT) / lag))
    assert simulate(step, time_constant_s=lag)[20:] == pytest.approx(GAIN * mean)
    assert simulate(step, substeps=5, time_constant_s=lag)[20:] == pytest.approx(GAIN * mean)


def test_direction_saturation_drift_and_load(command):
    opening = command - ZERO
    assert simulate(command, ratio=0.2) == pytest.approx(GAIN * np.where(opening > 0.0, 1.2, 0.8) * opening)
    assert simulate(command, limit=0.3) == pytest.approx(GAIN * np.clip(opening, -0.3, 0.3))
    logged = signals(len(command), TIME=np.arange(len(command)) * DT, EFFORT=np.linspace(-40.0, 40.0, len(command)))
    drifted = GAIN * opening * (1.0 + 0.1 * logged[kernel.TIME])
    assert simulate(command, logged=logged, rate_per_s=0.1) == pytest.approx(drifted)
    loaded = GAIN * opening * np.sqrt(1.0 - np.sign(opening) * logged[kernel.EFFORT] / 50.0)
    assert simulate(command, logged=logged, inverse_effort_max=1.0 / 50.0) == pytest.approx(loaded)


def test_a_supply_sags_to_what_its_own_flow_asks():
    command, droop = np.full(400, ZERO + 1.0), 0.5
    still = signals(400, OTHER_SPEED=0.0, OTHER_KIND=0.0, FREE=1.0)
    found = simulate(command, substeps=4, logged=still, droop=droop)[-1]
    assert found == pytest.approx(GAIN * np.sqrt(1.0 - droop * found), rel=1e-6)


def test_a_second_order_response_settles_and_overshoots():
    step = np.concatenate([np.full(5, ZERO), np.full(300, ZERO + 1.0)])
    found = simulate(step, substeps=20, period_s=0.3, damping_ratio=0.3)
    assert found[-1] == pytest.approx(GAIN, rel=1e-3)
    assert found.max() == pytest.approx(GAIN * (1.0 + np.exp(-np.pi * 0.3 / np.sqrt(1.0 - 0.09))), rel=0.05)


def test_every_column_of_a_parameter_changes_something(command):
    inert = {"dt", "command_scale", "own_demand", "longest_s"}
    beside = {
        "recovery_s": {"droop": 0.3},
        "drawn_ratio": {"droop": 0.3},
        "other_kinds": {"droop": 0.3},
        "damping_ratio": {"period_s": 0.1},
        "behind_edges": {"time_constant_s": 0.05, "half_width": 0.1},
        "area_ratio": {"inverse_effort_max": 0.4},
        "load_relief": {"inverse_effort_max": 0.4},
        "moment_s": {"gain_step": 0.3},
    }
    speeds = dict.fromkeys(("speed_limit", "upper_speed", "lower_speed"), 0.2)
    for name in set(LAYOUT) - inert:
        others = beside.get(name, {})
        value = ({"limit": 0.4, "moment_s": 1.0, "area_ratio": 0.7} | speeds).get(name, 0.02)
        before = simulate(command, substeps=2, **others)
        assert not np.array_equal(simulate(command, substeps=2, **others, **{name: value}), before), name
