"""What acts from outside: impulses by the book, a grip that makes the torque oppose the command, drops and falls."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.errors import UsageError
from hqpipe.plant import Grip, Plant, Push
from hqpipe.plant.disturbance import acting
from hqpipe.plant.excitation import excitation
from hqpipe.plant.postures import postures
from hqpipe.sim.mujoco_body import GRAVITY, MujocoBody


def standing(robot):
    return lambda frame, command: robot.nominal_position


def bytes_of(trial) -> bytes:
    return np.stack([*trial.columns.values(), *trial.truth.values()]).tobytes()


def test_a_push_adds_up_to_its_impulse_in_the_heading_of_the_trunk():
    push, times = Push(0.2, (100.0, 40.0, -10.0), duration=0.15), np.arange(0.0, 1.0, 1e-3)
    impulse = sum(push.force(t, 0.5 * np.pi) for t in times) * 1e-3
    np.testing.assert_allclose(
        impulse, [-40.0, 100.0, -10.0], atol=0.1
    )  # forwards is the world's y after a quarter turn
    assert not push.force(0.19, 0.0).any() and not push.force(0.36, 0.0).any()


def test_a_grip_pulls_towards_the_command_or_away_within_its_limit():
    error = np.array([0.1, -0.01, 1.0])
    np.testing.assert_allclose(Grip(0.0, 1.0, 1000.0, 300.0).torque(0.5, error), [100.0, -10.0, 300.0])
    np.testing.assert_allclose(Grip(0.0, 1.0, -1000.0, 300.0).torque(0.5, error), [-100.0, 10.0, -300.0])
    late = Grip(0.2, 1.0, 1000.0, 300.0)
    assert not late.torque(0.2, error).any() and not late.torque(1.3, error).any()
    np.testing.assert_allclose(late.torque(0.25, error), 0.5 * late.torque(0.7, error))


def test_disturbances_add_up():
    both = acting([Push(0.0, (10.0, 0.0, 0.0)), Push(0.0, (5.0, 0.0, 0.0))], 0.05, np.zeros(2), 0.0)
    assert both.force[0] == pytest.approx(1.5 * Push(0.0, (10.0, 0.0, 0.0)).force(0.05, 0.0)[0])
    assert not both.torque.any()


def test_a_steady_push_is_carried_by_the_feet(robot):
    body = MujocoBody(robot)
    for _ in range(round(2.0 / body.timestep)):
        torque = 20000.0 * (robot.nominal_position - body.joint_position) - 600.0 * body.joint_velocity
        body.step(torque, np.array([0.0, 0.0, -500.0]))
    assert body.contacts()[0][:, 2].sum() == pytest.approx(317.2 * GRAVITY + 500.0, rel=0.01)


def test_a_push_moves_the_robot_to_its_side(robot):
    def sideways(disturbances) -> float:
        trial = Plant(robot).run(standing(robot), 0.35, disturbances=disturbances)
        return trial.columns["base/linear_velocity/y"].max()

    assert sideways((Push(0.05, (0.0, 150.0, 0.0)),)) > 0.2 > 0.05 > sideways(())


def test_a_grip_makes_the_torque_oppose_the_position_error(robot):
    def against(disturbances) -> float:
        motion = excitation(robot, "multisine", 1.2, seed=1)
        trial = Plant(robot, base="fixed").run(motion, 1.2, disturbances=disturbances)
        torque = trial.joint("effort", robot.joints)
        error = trial.joint("position_command", robot.joints) - trial.joint("position", robot.joints)
        return float(np.mean((torque * error < 0.0)[np.abs(torque) > 50.0]))

    dragged, free, forced = (
        against((Grip(0.0, 1.2, 3000.0, 400.0),)),
        against(()),
        against((Grip(0.0, 1.2, -3000.0, 500.0),)),
    )
    assert dragged > 0.5 > free > forced


def test_a_dropped_robot_falls_freely_from_rest_and_lands(robot):
    plant = Plant(robot)
    plant.reset(clearance=0.25)
    assert plant.body.base_position[2] == pytest.approx(robot.nominal_height + 0.25)
    assert not plant.body.base_linear_velocity.any()
    trial = plant.run(standing(robot), 0.5)
    height, force = trial.columns["base/position/z"], trial.columns["foot/LF/force/z"]
    assert height[0] - height[200] == pytest.approx(0.5 * GRAVITY * 0.2**2, rel=0.05)
    assert not force[:200].any() and force.max() > 317.2 * GRAVITY / 4.0
    assert not trial.fell


def test_a_fall_can_be_recorded_to_its_end(robot):
    trial = Plant(robot).run(postures(robot, "collapse", 2.0), 2.0, stop_at_fall=False)
    assert trial.fell and 0.4 < trial.fall_time < 2.0
    assert len(trial.time) == 2000
    assert trial.columns["base/position/z"][-1] < 0.6 * robot.nominal_height
    assert all(np.isfinite(column).all() for column in trial.columns.values())


def test_disturbed_trials_repeat_and_what_never_acts_changes_no_byte(robot):
    def record(disturbances) -> bytes:
        return bytes_of(Plant(robot, seed=3).run(standing(robot), 0.2, disturbances=disturbances))

    pushed = (Push(0.05, (50.0, 80.0, 0.0)), Grip(0.05, 0.1, -500.0, 100.0))
    assert record(pushed) == record(pushed) != record(())
    assert record((Push(5.0, (50.0, 80.0, 0.0)),)) == record(())


def test_a_grip_without_joint_targets_is_refused(robot):
    plant = Plant(robot, base="fixed")
    with pytest.raises(UsageError, match="a grip needs joint angles as targets, got 'effort'"):
        plant.run(standing(robot), 0.1, mode="torque", targets="effort", disturbances=(Grip(0.0, 1.0, 1.0, 1.0),))
