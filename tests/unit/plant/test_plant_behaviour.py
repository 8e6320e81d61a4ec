"""The whole plant: it stands, holds, steps, walks its channels into the log, and repeats itself."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.errors import UsageError
from hqpipe.plant import Plant, PlantConfig
from hqpipe.plant.trial import BASE_COLUMNS, ORIENTATION


@pytest.fixture(scope="module")
def stand(robot):
    plant = Plant(robot)
    return plant, plant.run(lambda frame, command: robot.nominal_position, 1.0, command={"vx": 0.5})


def step_response(robot, joint: str, size: float, overrides=None):
    """Normalised response of one joint in the gantry, the step at 0.1 s."""
    plant, index = Plant(robot, PlantConfig(overrides or {}), base="fixed"), robot.joints.index(joint)

    def controller(frame, command):
        target = robot.nominal_position.copy()
        target[index] += size * (frame.time >= 0.1)
        return target

    trial = plant.run(controller, 0.6)
    position = trial.columns[f"joint/{joint}/position"]
    return (position - position[99]) / size


def test_stands_under_its_own_weight_without_drift_or_oscillation(robot, stand):
    plant, trial = stand
    height = trial.columns["base/position/z"]
    assert not trial.fell
    assert plant.body.mass == pytest.approx(317.2, abs=0.1)
    assert np.ptp(height) < 2e-3
    assert height[-1] == pytest.approx(robot.nominal_height, abs=0.03)
    assert trial.joint("velocity", robot.joints)[-300:].std(axis=0).max() < 0.02
    weight = sum(trial.columns[f"foot/{foot}/force/z"][-300:].mean() for foot in robot.feet)
    assert weight == pytest.approx(317.2 * 9.81, rel=0.01)


def test_holds_in_the_gantry(robot):
    trial = Plant(robot, base="fixed").run(lambda frame, command: robot.nominal_position, 0.5)
    position = trial.joint("position", robot.joints)
    assert np.abs(position - robot.nominal_position).max() < 0.02
    assert np.ptp(position, axis=0).max() < 5e-4
    assert not any(name.startswith(("base/", "foot/", "imu/", "command/")) for name in trial.columns)


@pytest.mark.parametrize("joint", ["LFR", "LFP", "LFK"])
def test_position_loop_has_a_time_constant_of_30_to_50_ms_and_does_not_ring(robot, joint):
    response = step_response(robot, joint, 0.1)
    rise = np.argmax(response > 0.632) * 1e-3 - 0.1
    assert 0.030 < rise < 0.050
    assert response.max() < 1.12
    assert np.ptp(response[-200:]) < 0.03
    assert response[-1] == pytest.approx(1.0, abs=0.05)


def test_columns_are_those_of_the_log_format(robot, stand):
    _, trial = stand
    signals = (
        "position",
        "velocity",
        "effort",
        "position_command",
        "valve_command",
        "pressure_a",
        "pressure_b",
    )
    expected = {"time", "supply/pressure", "supply/oil_temperature", *BASE_COLUMNS}
    expected |= {f"joint/{joint}/{signal}" for joint in robot.joints for signal in signals}
    expected |= {f"foot/{foot}/{leaf}" for foot in robot.feet for leaf in ("contact", "force/x", "force/y", "force/z")}
    expected |= {"command/vx", "command/vy", "command/wz"}
    assert set(trial.columns) == expected
    np.testing.assert_allclose(np.diff(trial.time), 1e-3, atol=1e-12)
    assert trial.columns["command/vx"][0] == 0.5
    assert all(np.isfinite(column).all() and len(column) == 1000 for column in trial.columns.values())
    assert not set(trial.truth) <= set(trial.columns)
    seen, true = (np.stack([of[name] for name in ORIENTATION]) for of in (trial.columns, trial.truth))
    assert 0.0 < np.abs(seen - true).max() < 0.01, "the attitude filter errs by 2 mrad"


def test_pressures_times_area_are_the_effort(robot, stand):
    _, trial = stand
    difference = trial.joint("pressure_a", robot.joints) - trial.joint("pressure_b", robot.joints)
    np.testing.assert_allclose(trial.joint("effort", robot.joints), 0.06 * 8.0e-4 * difference, atol=1e-9)


def test_same_seed_gives_the_same_bytes_and_another_seed_does_not(robot):
    def record(plant):
        trial = plant.run(lambda frame, command: robot.nominal_position + 0.1 * np.sin(9.0 * frame.time), 0.3)
        return np.stack(list(trial.columns.values())).tobytes()

    plant = Plant(robot, seed=3)
    first = record(plant)
    plant.reset()
    assert record(plant) == first
    assert record(Plant(robot, seed=3)) == first
    assert record(Plant(robot, seed=4)) != first


def test_asking_twice_gives_the_same_frame(robot):
    plant = Plant(robot, base="fixed")
    assert plant.sense() is plant.sense()


def test_torque_mode_follows_a_torque_step(robot):
    plant, knee = Plant(robot, base="fixed"), robot.joints.index("LFK")

    def controller(frame, command):
        torque = 1500.0 * (robot.nominal_position - frame.q) - 60.0 * frame.qd
        torque[knee] += 60.0 * (frame.time >= 0.2)
        return torque

    trial = plant.run(controller, 0.8, control_period_s=0.001, mode="torque", targets="effort")
    wanted, got = trial.columns["joint/LFK/effort_command"], trial.columns["joint/LFK/effort"]
    assert np.sqrt(np.mean((wanted - got)[500:] ** 2)) < 10.0
    assert "joint/LFK/position_command" not in trial.columns


def test_torque_mode_turns_joint_targets_into_torque_with_the_robots_gains(robot):
    trial = Plant(robot).run(lambda frame, command: robot.nominal_position, 0.05, mode="torque")
    q, qd = trial.joint("position", robot.joints), trial.joint("velocity", robot.joints)
    expected = robot.torque_pd.kp * (robot.nominal_position - q) - robot.torque_pd.kd * qd
    np.testing.assert_allclose(trial.joint("effort_command", robot.joints), expected, atol=1e-9)


def test_valve_mode_moves_at_a_speed_that_grows_with_the_opening(robot):
    def speed(opening: float) -> float:
        command = np.zeros(12)
        command[2] = opening
        trial = Plant(robot, base="fixed").run(lambda frame, _: command, 0.15, mode="valve")
        return trial.columns["joint/LFK/velocity"][-50:].mean()

    slow, fast = speed(0.1), speed(0.3)
    assert slow == pytest.approx(1.13, rel=0.2)
    assert fast == pytest.approx(3.0 * slow, rel=0.15)


def test_a_fall_ends_the_trial(robot):
    folded = robot.nominal_position.copy()
    folded[[2, 8]] = -2.1  # both left knees fold
    folded[[1, 7]] = 1.6
    trial = Plant(robot).run(lambda frame, command: folded, 4.0)
    assert trial.fell
    assert trial.fall_time == pytest.approx(trial.time[-1])
    assert trial.time[-1] < 3.9


def test_the_robot_stands_anywhere_it_is_put(robot):
    plant = Plant(robot)
    plant.reset(yaw=1.0)
    x, y, z, w = plant.body.base_orientation
    assert np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)) == pytest.approx(1.0, abs=0.01)
    crouch = robot.nominal_position + np.tile([0.0, 0.15, -0.3], 4)
    plant.reset(position=crouch)
    assert np.abs(plant.body.joint_position - crouch).max() < 0.06


def test_wrong_use_is_refused_with_the_mend(robot):
    plant = Plant(robot, base="fixed")
    with pytest.raises(UsageError, match="did you mean 'torque'"):
        plant.step(np.zeros(12), "torqe")
    with pytest.raises(UsageError, match="expected 12 finite numbers"):
        plant.step(np.zeros(11))
    with pytest.raises(UsageError, match="multiple of 0.001"):
        plant.run(lambda frame, command: np.zeros(12), 0.1, control_period_s=0.0015)
    with pytest.raises(UsageError, match="in mode 'valve' expected one of valve"):
        plant.run(lambda frame, command: np.zeros(12), 0.1, mode="valve", targets="effort")
    with pytest.raises(UsageError, match="command: expected vx, vy, wz, got 'vz'"):
        plant.run(lambda frame, command: np.zeros(12), 0.1, command={"vz": 1.0})


def test_coupling_with_the_body_loses_and_makes_little_energy(robot):
    plant = Plant(robot)
    swing = np.tile([0.0, 0.2, -0.4], 4)
    trial = plant.run(lambda frame, command: robot.nominal_position + swing * np.sin(12.0 * frame.time), 1.5)
    torque = np.stack([trial.truth[f"joint/{name}/torque"] for name in robot.joints])
    speed = np.stack([trial.truth[f"joint/{name}/velocity"] for name in robot.joints])
    exchanged = np.abs(torque * speed).sum() * 1e-3
    assert exchanged > 500.0
    assert abs(plant.interface_error) < 0.02 * exchanged
