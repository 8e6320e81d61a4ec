"""A linkage: the law holds for the force of the cylinder and the speed of its piston."""

from __future__ import annotations

import numpy as np
import pytest
from machine.augmented_rows import STEPS, planted, row
from machine.signal_windows import windows_of

from hqpipe.logs.trajectory import Trajectory
from hqpipe.machine.chain import loops, residual_windows
from hqpipe.machine.layout import slot
from hqpipe.machine.moment_arm import LEAST, relative_arm

SLOPE, CURVE, MIDDLE = 0.4, -0.6, 0.1


def with_arm(effects):
    p = row(effects, middle=MIDDLE)
    p[slot("setting", "arm_slope")], p[slot("setting", "arm_curve")] = SLOPE, CURVE
    return p


def arm_of(position):
    offset = position - MIDDLE
    return 1.0 + SLOPE * offset + CURVE * offset**2


@pytest.fixture(scope="module")
def sound():
    """A joint without a linkage and without effects; its motion covers half a radian."""
    return planted.trajectory(planted.simulate(4.0, [{}], 1.0, 3))


@pytest.mark.parametrize("effects", [{}, {"orifice_flow": {"effort_max_nm": 900.0}}], ids=["law", "orifice"])
def test_a_log_in_torques_is_the_log_in_forces_times_the_arm(sound, effects):
    """A linkage changes nothing but what force and speed of the piston are to the joint."""
    forces = windows_of([sound], 0, STEPS)
    arm = arm_of(forces.position)
    at = forces.first[None, :] + np.arange(STEPS + 1)[:, None]
    torques = forces._replace(effort=forces.effort * arm, target=forces.target * arm[at])
    forces = forces._replace(velocity=forces.velocity * arm)
    expected = residual_windows(row(effects, middle=MIDDLE), forces) * arm[at[1:]]
    found = residual_windows(with_arm(effects), torques)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("effects", [{}, {"integral_action": {"ki": 2.0, "limit": 1.0}}], ids=["law", "integrator"])
def test_a_log_that_the_simulator_made_is_replayed_without_error(sound, effects):
    """Also with an integrator, whose first content is what makes the forces of the trial add up."""
    p, t = with_arm(effects), sound
    tau, memory = t.effort[0].copy(), np.zeros((1, loops().memory))
    effort = [tau[0]]
    for k in range(t.samples - 1):
        loops().step_row(p[None], tau, memory, t.position_command[k], t.position[k], t.velocity[k])
        # A simulator gives the torque at the position from which it steps on, a log that of its own row.
        effort.append(tau[0] * arm_of(t.position[k + 1, 0]) / arm_of(t.position[k, 0]))
    log = Trajectory(
        t.time, t.joints, t.position, t.velocity, np.array(effort)[:, None], position_command=t.position_command
    )
    error = residual_windows(p, windows_of([log], 0, STEPS, logged_speed=True))
    assert np.abs(error).max() < 1e-3 * np.std(effort)


def test_many_robots_step_as_one_does(sound):
    rows, t = np.array([with_arm({}), row({}, middle=MIDDLE)]), sound
    one, memory = np.full(2, 50.0), np.zeros((2, loops().memory))
    many, planes = np.full(2, 50.0), np.zeros((loops().memory, 2))
    for k in range(300):
        inputs = [np.repeat(x[k], 2) for x in (t.position_command, t.position, t.velocity)]
        loops().step_row(rows, one, memory, *inputs)
        loops().step_batch(*loops().prepare(rows), many, planes, *inputs, 2)
    np.testing.assert_allclose(many, one, rtol=1e-12)
    assert abs(one[0] - one[1]) > 1.0, "the arm does something"


def test_an_arm_never_vanishes():
    assert relative_arm(5.0, 0.0, 0.0, -1.0) == LEAST
    assert relative_arm(MIDDLE, MIDDLE, SLOPE, CURVE) == 1.0
