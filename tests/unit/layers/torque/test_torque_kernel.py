"""The compiled simulation: inert at neutral values bit for bit, and each column does something."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.layers.torque import kernel
from hqpipe.layers.torque.kernel import LAYOUT, opened, run_blocks

DT, RATE, SHARE, OFFSET = 2e-3, 90.0, 1.7, 3.0
NEUTRAL = {"limit": np.inf, "recovery_s": 0.1, "others": 1.0, "drawn_ratio": 1.0, "area_ratio": 1.0}
SCALES = {"error_scale": 20.0, "speed_scale": 1.0, "effort_scale": 40.0, "most_effort": 60.0, "longest_s": 2.0}
SAMPLES, SUBSTEPS = 1000, 3


@pytest.fixture
def logged():
    rng, time = np.random.default_rng(4), np.arange(SAMPLES) * DT
    command = 40.0 * np.sin(9.0 * time) + np.repeat(rng.uniform(-20.0, 20.0, SAMPLES // 50), 50)
    signals = np.zeros((kernel.SIGNALS, SAMPLES))
    signals[kernel.TIME], signals[kernel.Z] = time, np.sin(3.0 * time)
    signals[kernel.VELOCITY] = 3.0 * np.cos(3.0 * time)
    signals[kernel.OTHER_SPEED] = 0.5 + 0.1 * rng.random(SAMPLES)
    signals[kernel.COMMAND_SUM] = np.cumsum(command) * DT
    return command, signals


def row(**numbers):
    base = NEUTRAL | SCALES | {"rate": RATE, "speed_share": SHARE, "offset": OFFSET, "dt": DT} | numbers
    return np.array([base.get(name, 0.0) for name in LAYOUT])


def simulate(logged, substeps=SUBSTEPS, **numbers):
    command, signals = logged
    torque, restart = np.zeros(SAMPLES), np.zeros(SAMPLES, dtype=bool)
    bounds = [np.array([k]) for k in (0, SAMPLES - 1, 0, SAMPLES)]
    means = np.array([[1.0, 0.2, 5.0]])
    run_blocks(row(**numbers), command, np.full(SAMPLES, 5.0), signals, means, restart, *bounds, substeps, torque)
    return torque


def first_order_loop(logged):
    """The base model alone, by the midpoint rule of the kernel."""
    command, signals = logged
    torque, x, slope, h = np.zeros(SAMPLES), 5.0, 0.0, DT / SUBSTEPS
    velocity = signals[kernel.VELOCITY]
    for k in range(SAMPLES):
        torque[k] = x
        for i in range(SUBSTEPS):
            at = k + i * (1.0 / SUBSTEPS) + 0.5 * (1.0 / SUBSTEPS)
            following = velocity[min(k + 1, SAMPLES - 1)]
            v = velocity[k] + (at - k) * (following - velocity[k])
            wanted = command[k] - (x + 0.5 * h * slope)
            slope = RATE * (wanted + OFFSET - SHARE * v)
            x += h * slope
    return torque


def test_neutral_values_leave_the_first_order_loop(logged):
    assert simulate(logged) == pytest.approx(first_order_loop(logged), rel=1e-12, abs=1e-12)


NUMBERS = {
    "limit": 10.0, "recovery_s": 0.5, "others": 2.0, "inverse_effort_max": 0.01, "inverse_stall": 0.01,
    "time_constant_s": 3e-3, "delay_s": 5e-3,
    "difference_s": 4e-3, "row_offset_s": 1e-3, "half_width": 2.0, "play": 1.0, "speed_lead_s": 3e-3, "moment_s": 1.2,
    "leak_curve": 0.05, "evened_out": 0.5, "drawn_ratio": 0.7, "area_ratio": 0.7,
}  # fmt: skip
BESIDE = {
    "recovery_s": {"droop": 0.2},
    "others": {"droop": 0.2},
    "drawn_ratio": {"droop": 0.2},
    "evened_out": {"droop": 0.2},
    "inverse_stall": {"limit": 20.0},
    "area_ratio": {"inverse_effort_max": 0.01},
    "compensation": {"half_width": 2.0},
    "moment_s": {"gain_step": 0.3},
}  # numbers that show only beside another


@pytest.mark.parametrize(
    "name", sorted(set(LAYOUT) - set(SCALES) - {"dt", "rate", "speed_share", "offset", "compensation"})
)
def test_every_effect_is_inert_at_neutral_bit_for_bit_and_acts_elsewhere(logged, name):
    beside = BESIDE.get(name, {})
    without = simulate(logged, **beside)
    assert np.array_equal(without, simulate(logged, **beside, **{name: NEUTRAL.get(name, 0.0)}))
    assert np.max(np.abs(simulate(logged, **beside, **{name: NUMBERS.get(name, 0.1)}) - without)) > 1e-3


def test_what_the_drive_adds_for_the_speed_does_nothing_while_the_valve_is_linear(logged):
    assert simulate(logged, compensation=4.0) == pytest.approx(simulate(logged), abs=1e-9)
    assert np.max(np.abs(simulate(logged, compensation=4.0, half_width=2.0) - simulate(logged, half_width=2.0))) > 1.0


def test_a_deadband_of_a_wide_limit_and_a_limit_of_no_deadband():
    assert opened(row(limit=7.0), 9.0, 0.0) == 7.0 and opened(row(limit=7.0), -9.0, 0.0) == -7.0
    assert opened(row(half_width=2.0), 5.0, 0.0) == 3.0 and opened(row(half_width=2.0), -1.0, 0.0) == 0.0


def test_the_step_of_the_simulation_does_not_decide(logged):
    numbers = {"time_constant_s": 4e-3, "delay_s": 3e-3, "half_width": 1.0, "limit": 60.0}
    fine = simulate(logged, substeps=40, **numbers)
    assert np.sqrt(np.mean((simulate(logged, substeps=2, **numbers) - fine) ** 2)) < 0.005 * np.std(fine)


def test_a_fully_open_valve_passes_less_against_the_load_and_more_with_it():
    limited = row(limit=10.0, inverse_stall=0.01)
    assert opened(limited, 50.0, 75.0) == pytest.approx(5.0)
    assert opened(limited, -50.0, 75.0) == pytest.approx(-10.0 * np.sqrt(1.75))
    assert opened(limited, 3.0, 75.0) == 3.0


def test_friction_before_the_sensor_is_lost_at_once(logged):
    command, signals = logged
    measured = simulate(logged, friction_nm=4.0)
    direction = np.sign(signals[kernel.VELOCITY])
    moving = np.abs(signals[kernel.VELOCITY]) > 0.5
    lost = simulate(logged) - measured
    # The loop starts from the measured torque, so that the torque before the friction differs until that has faded.
    late = np.arange(SAMPLES) * DT > 0.2
    assert lost[moving & late] == pytest.approx(4.0 * direction[moving & late], rel=0.01)
