"""One sample after the other, against the windows of a log."""

from __future__ import annotations

import numpy as np
import pytest
from machine.augmented_rows import planted, row
from machine.signal_windows import windows_of

from hqpipe.machine.chain import loops, residual_windows
from hqpipe.machine.compose.shared import RING as RING_LENGTH
from hqpipe.machine.layout import slot

MEMORY, augmented_row = loops().memory, loops().step_row

SENSING = ("channel_skew", "torque_bias")  # no part of the machine
LATER = ("viscous_friction", "stribeck_friction")  # windows know the speed at the end of the sample
SAME = [name for name in planted.TYPICAL if name not in (*SENSING, *LATER, "integral_action")]
SKIPPED = 400  # samples: from there on every joint carries a torque beyond the slack of its chain


def recorded(effects, seconds=1.5):
    return planted.trajectory(planted.simulate(seconds, [effects] * 3, 0.0, 6))


def stepped(rows, t):
    """(T, J) torque through the recorded inputs, from the recorded torque at the start."""
    tau, memory = t.effort[0].copy(), np.zeros((len(rows), MEMORY))
    out = np.empty_like(t.effort)
    for k in range(t.samples):
        out[k] = tau
        augmented_row(np.array(rows), tau, memory, t.position_command[k], t.position[k], t.velocity[k])
    return out


def windowed(p, t, j):
    """(T − 1,) the same as one long window."""
    signals = windows_of([t], j, t.samples - 1, logged_speed=True)
    return (residual_windows(p, signals) + signals.target[1:])[:, 0]


def both(effects, others=None):
    t = recorded(effects)
    start = int(np.argmax(np.abs(t.effort[SKIPPED:]).min(axis=1))) + SKIPPED
    t = t.section(start, t.samples)
    rows = [row(effects)] * 3
    rows = [p.copy() for p in rows]
    for p in rows:
        p[slot("setting", "clear")] = 1.0
    ahead = stepped(rows, t)[1:]
    return t, ahead, np.stack([windowed(p, t, j) for j, p in enumerate(rows)], axis=1)


@pytest.mark.parametrize("effect", SAME)
def test_steps_equal_one_long_window(effect):
    _, ahead, expected = both({effect: planted.TYPICAL[effect]})
    np.testing.assert_allclose(ahead, expected, atol=1e-6)


@pytest.mark.parametrize("damping", [0.5, 1.0, 4.0])
def test_a_spool_of_second_order_steps_as_in_one_long_window(damping):
    t, shape = recorded({}), {"time_constant_s": 0.012, "damping_ratio": damping}
    p = row({"valve_lag": shape, "valve_delay": {"delay_s": 0.0033}})
    expected = np.stack([windowed(p, t, j) for j in range(3)], axis=1)
    np.testing.assert_allclose(stepped([p] * 3, t)[1:], expected, atol=1e-6)
    plain = row({"valve_lag": {"time_constant_s": 0.012}, "valve_delay": {"delay_s": 0.0033}})
    assert np.abs(stepped([plain] * 3, t)[1:] - expected).max() > 1.0


def test_effects_together_equal_one_long_window():
    effects = {name: planted.TYPICAL[name] for name in SAME}
    effects["flow_saturation"] = {"limit": 0.1}
    _, ahead, expected = both(effects)
    np.testing.assert_allclose(ahead, expected, atol=1e-6)


@pytest.mark.parametrize("effect,gain", [("viscous_friction", 20.0), ("stribeck_friction", 30.0 / 0.3)])
def test_friction_of_speed_is_one_sample_older_than_in_windows(effect, gain):
    t, ahead, expected = both({effect: planted.TYPICAL[effect]})
    change = gain * np.abs(np.diff(t.velocity, axis=0)).max()
    assert 0.0 < np.abs(ahead - expected).max() < 3.0 * change


def test_a_piston_behind_its_joint_steps_as_in_windows():
    """But for the friction itself, whose speed is one sample older: damping and stiffness so small that it hardly counts."""
    p = row({"viscous_friction": {"nm_s_per_rad": 1e-4, "behind_piston": 0.3}})
    p[slot("base", "k3")] = 0.3 * 1e-4  # a lag of one sample
    t = recorded({})
    expected = np.stack([windowed(p, t, j) for j in range(3)], axis=1)
    np.testing.assert_allclose(stepped([p] * 3, t)[1:], expected, atol=0.01)
    p[slot("viscous_friction", "behind_piston")] = 0.0
    assert np.abs(stepped([p] * 3, t)[1:] - expected).max() > 1.0


def test_integrator_starts_with_what_holds_the_load_and_winds_to_its_limit():
    t = recorded({})
    sizes = {"integral_action": {"ki": 2.0, "limit": 0.03}}
    error = t.position_command - t.position
    plain, driven = stepped([row({})] * 3, t), stepped([row(sizes)] * 3, t)
    lasting = stepped([row({"position_bias": {"rad": 0.03}})] * 3, t)
    assert np.abs(driven - plain).max() > 10.0
    assert np.abs(driven - plain).max() <= np.abs(lasting - plain).max() * 1.5
    assert np.abs(error).max() > 0.0


def test_delay_holds_the_first_command_and_reaches_no_further_than_the_ring():
    p = row({"command_delay": {"delay_s": 0.05}})
    tau, memory = np.zeros(1), np.zeros((1, MEMORY))
    zero = np.zeros(1)
    applied = []
    for k in range(120):
        augmented_row(p[None], tau, memory, np.full(1, 0.1 if k >= 10 else 0.0), zero, zero)
        applied.append(tau[0])
    assert np.flatnonzero(applied)[0] == 10 + 50
    assert RING_LENGTH > 80


def test_effort_limit_holds_and_memory_of_robots_is_apart():
    t = recorded({})
    p = row({"valve_lag": {"time_constant_s": 0.012}})
    p[slot("setting", "effort_limit")] = 100.0
    out = stepped([p] * 3, t)
    assert np.abs(out[1:]).max() == 100.0
    lone = stepped([p], t.for_joints(t.joints[1:2]))
    np.testing.assert_array_equal(lone[:, 0], out[:, 1])
