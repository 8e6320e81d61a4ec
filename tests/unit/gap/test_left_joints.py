"""Joints without an answer in the actuator of a simulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken, values
from planted_logs import logs_of, planted, size

from hqpipe.gap.checks.left_out import of_joints
from hqpipe.gap.diagnosis import diagnose
from hqpipe.gap.fitted_joints import FittedJoints
from hqpipe.gap.intake import take_in
from hqpipe.gap.left_joints import left_joints, plain_joints, whole_actuator
from hqpipe.layers.actuator import Actuator
from hqpipe.machine.layout import slot

LIMIT = np.array([3e3, 4e3, 5e3])  # N·m


@pytest.fixture(scope="module")
def logs():
    return logs_of([size("command_delay"), {}, {}], seconds=3.0)


@pytest.fixture(scope="module")
def two(logs):
    """The actuator of all joints but the second."""
    models = Actuator().joints(of_joints(logs, [logs.joints[0], logs.joints[2]]), 0.1).models
    values = [[p.neutral for p in (*m.base, *(p for e in m.effects for p in e.parameters))] for m in models]
    return FittedJoints.of(models, [np.array(numbers) for numbers in values]).actuator()


@pytest.fixture(scope="module")
def intake(logs):
    """The intake of logs whose second joint was left out, and is sound in other trials."""
    found = take_in(logs, 0.1)
    rest = of_joints(logs, [logs.joints[0], logs.joints[2]])
    return replace(found, log_set=rest, spare={logs.joints[1]: of_joints(logs, [logs.joints[1]])})


def test_a_joint_that_was_left_out_gets_the_base_of_its_sound_logs(logs, two, intake):
    whole = whole_actuator(two, left_joints(intake, logs.joints, two.joints, LIMIT), logs.joints)
    assert whole.joints == logs.joints and whole.dt == two.dt
    np.testing.assert_array_equal(whole.parameters[[0, 2]], two.parameters)
    found = [whole.parameters[1, slot("base", name)] for name in planted.GAINS]
    np.testing.assert_allclose(found, list(planted.GAINS.values()), rtol=0.05)
    assert whole.parameters[1, slot("setting", "effort_limit")] == LIMIT[1]
    assert logs.joints[1] not in {joint for joints in whole.effects.values() for joint in joints}
    (told,) = plain_joints(intake, logs.joints, True)
    assert "without effects" in told and logs.joints[1] in told


def test_no_actuator_without_sound_logs(logs, two, intake):
    short = of_joints(logs, [logs.joints[1]])
    trials = tuple(replace(t, trajectory=t.trajectory.section(0, 500)) for t in short.trials)
    for spare in (None, replace(short, trials=trials), replace(short, control_mode="torque", trials=_unread(short))):
        lacking = replace(intake, spare={logs.joints[1]: spare})
        assert whole_actuator(two, left_joints(lacking, logs.joints, two.joints), logs.joints) is None
    assert "no actuator.json" in plain_joints(intake, logs.joints, False)[0]


def test_a_whole_machine_stays_as_it_is(logs, two, intake):
    left = left_joints(intake, two.joints, two.joints)
    np.testing.assert_array_equal(whole_actuator(two, left, two.joints).parameters, two.parameters)
    assert plain_joints(intake, two.joints, True) == []


def test_a_diagnosis_writes_joints_that_it_left_out(logs):
    """The sign of the third joint's torque is wrong, and can be repaired."""
    found = diagnose(broken(logs, values("effort", np.negative, 2)), window_s=0.1)
    assert found.content["left_out"][0]["joints"] == [logs.joints[2]]
    assert found.base.joints == found.augmented.joints == logs.joints
    np.testing.assert_array_equal(found.augmented.parameters[2], found.base.parameters[2])
    assert found.augmented.parameters[2, slot("base", "k1")] == pytest.approx(planted.GAINS["k1"], rel=0.05)
    assert any("without effects" in text for text in found.content["warnings"])
    (group,) = (group for group in found.posterior.held if logs.joints[2] in group.joints)
    k1 = found.posterior.fields.index("k1")
    assert 0.0 < group.scatter[k1, k1] < group.mean[k1] ** 2


def _unread(logs):
    """Trials without the command of position mode."""
    return tuple(
        replace(t, trajectory=replace(t.trajectory, position_command=None, effort_command=t.trajectory.effort))
        for t in logs.trials
    )
