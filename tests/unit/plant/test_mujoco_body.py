"""The rigid body and its floor against elementary mechanics."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.errors import ConfigError
from hqpipe.sim.body_changes import BodyChanges, Ground, LinkChange, Payload
from hqpipe.sim.mujoco_body import GRAVITY, MujocoBody


def hold(body: MujocoBody, duration: float, kp: float = 6000.0, kd: float = 200.0) -> None:
    for _ in range(round(duration / body.timestep)):
        body.step(kp * (body.robot.nominal_position - body.joint_position) - kd * body.joint_velocity)


def test_mass_is_that_of_the_urdf_plus_payload_and_link_error(robot):
    changes = BodyChanges(payloads=(Payload("trunk", 30.0),), links={"LF_shank": LinkChange(mass_scale=2.0)})
    assert MujocoBody(robot).mass == pytest.approx(317.2)
    assert MujocoBody(robot, changes=changes).mass == pytest.approx(317.2 + 30.0 + 5.5)


def test_free_fall(robot):
    body = MujocoBody(robot)
    body.reset(robot.nominal_position, clearance=1.0)
    start = body.base_position[2]
    for _ in range(400):
        body.step(np.zeros(12))
    assert start - body.base_position[2] == pytest.approx(0.5 * GRAVITY * 0.2**2, rel=0.01)
    assert np.linalg.norm(body.imu_acceleration()) < 0.05


def test_standing_feet_carry_the_weight_and_the_imu_reads_gravity(robot):
    body = MujocoBody(robot)
    hold(body, 2.0, kp=20000.0, kd=600.0)
    body.imu_acceleration()
    hold(body, 0.05, kp=20000.0, kd=600.0)
    force, illegal = body.contacts()
    assert force[:, 2].sum() == pytest.approx(317.2 * GRAVITY, rel=0.01)
    assert not illegal
    np.testing.assert_allclose(body.imu_acceleration()[2], GRAVITY, rtol=0.01)


def test_ground_stiffness_is_newton_per_metre(robot):
    def sink(stiffness: float) -> tuple[float, float]:
        body = MujocoBody(robot, changes=BodyChanges(ground=Ground(stiffness=stiffness)))
        hold(body, 2.0, kp=50000.0, kd=1000.0)
        return body.base_position[2], body.contacts()[0][:, 2].mean()

    (soft, load), (hard, _) = sink(1.0e5), sink(1.0e6)
    assert hard - soft == pytest.approx(load / 1.0e5 - load / 1.0e6, rel=0.1)


@pytest.mark.parametrize(("friction", "slides"), [(0.5, False), (0.25, True)])
def test_friction_decides_whether_it_slides_down_a_slope(robot, friction, slides):
    """tan 0.35 = 0.365."""
    ground = Ground(friction=friction, slope=0.35)
    body = MujocoBody(robot, changes=BodyChanges(ground=ground))
    hold(body, 0.5, kp=20000.0, kd=600.0)
    start = body.base_position[0]
    hold(body, 0.5, kp=20000.0, kd=600.0)
    moved = start - body.base_position[0]
    assert (moved > 0.03) if slides else (abs(moved) < 0.01)


def test_a_trunk_on_the_ground_is_an_illegal_contact_and_a_foot_is_not(robot):
    body = MujocoBody(robot)
    body.reset(robot.nominal_position, clearance=-0.75)
    body.step(np.zeros(12))
    assert body.contacts()[1]


def test_gantry_holds_the_trunk(robot):
    body = MujocoBody(robot, base="fixed")
    start = body.base_position
    hold(body, 0.2)
    np.testing.assert_array_equal(body.base_position, start)
    assert np.abs(body.contacts()[0]).max() == 0.0


def test_uneven_ground_lifts_the_feet_differently(robot):
    body = MujocoBody(robot, changes=BodyChanges(ground=Ground(roughness=0.04)))
    hold(body, 1.5)
    flat = MujocoBody(robot)
    hold(flat, 1.5)
    x, y, _, _ = body.base_orientation
    flat_x, flat_y, _, _ = flat.base_orientation
    assert np.hypot(x - flat_x, y - flat_y) > 1e-3
    assert not body.contacts()[1]


def test_unknown_base_names_the_near_match(robot):
    with pytest.raises(ConfigError, match="did you mean 'floating'"):
        MujocoBody(robot, base="floatin")
