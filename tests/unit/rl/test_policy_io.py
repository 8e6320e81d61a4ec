from __future__ import annotations

import json
from dataclasses import replace

import pytest
import torch

from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.errors import ConfigError
from hqpipe.rl.networks import LocomotionNetworks
from hqpipe.rl.policy_io import load_policy, save_policy
from hqpipe.rl.policy_spec import PolicySpec, position_stiffness


@pytest.fixture
def folder(tmp_path, spec):
    torch.manual_seed(0)
    save_policy(tmp_path, spec, LocomotionNetworks(spec))
    return tmp_path


def test_round_trip_keeps_every_bit(folder, spec, tmp_path):
    again, networks = load_policy(folder)
    assert again.to_dict() == spec.to_dict()
    copy = tmp_path / "copy"
    save_policy(copy, again, networks)
    for name in ("policy.json", "policy.safetensors"):
        assert (copy / name).read_bytes() == (folder / name).read_bytes()


def test_missing_file_is_named(folder):
    (folder / "policy.safetensors").unlink()
    with pytest.raises(ConfigError, match="policy.safetensors: no such file"):
        load_policy(folder)


def test_weights_of_another_size_are_refused(folder):
    raw = json.loads((folder / "policy.json").read_text())
    raw["hidden"] = [8, 8]
    (folder / "policy.json").write_text(json.dumps(raw))
    with pytest.raises(ConfigError, match="does not fit"):
        load_policy(folder)


def test_a_policy_from_before_leg_odometry_has_the_estimator_of_then(folder, spec):
    raw = json.loads((folder / "policy.json").read_text())
    assert raw.pop("leg_odometry") is False
    (folder / "policy.json").write_text(json.dumps(raw))
    assert load_policy(folder)[0].to_dict() == spec.to_dict()


def test_leg_odometry_needs_its_own_weights(folder, spec, tmp_path):
    raw = json.loads((folder / "policy.json").read_text())
    (folder / "policy.json").write_text(json.dumps(raw | {"leg_odometry": True}))
    with pytest.raises(ConfigError, match="does not fit"):
        load_policy(folder)
    other = replace(spec, leg_odometry=True)
    save_policy(tmp_path / "other", other, LocomotionNetworks(other))
    assert load_policy(tmp_path / "other")[0].leg_odometry


def test_other_formats_are_refused(folder):
    (folder / "policy.json").write_text('{"format": "hqpipe-policy/9"}')
    with pytest.raises(ConfigError, match="format: 'hqpipe-policy/9', expected hqpipe-policy/1"):
        load_policy(folder)


def test_torque_control_carries_the_robot_s_gains(robot, actuator, small):
    spec = PolicySpec.build(robot, actuator, small, "torque")
    assert set(spec.kp) == {robot.torque_pd.kp} and set(spec.kd) == {robot.torque_pd.kd}
    with pytest.raises(ConfigError, match="control_mode"):
        PolicySpec.build(robot, actuator, small, "valve")


def test_stiffness_at_rest_is_that_of_the_fixed_point():
    model = Hydraulic.build(["A"], dt=1e-3, k1=1e5, k2=0.1, k3=10.0, k4=0.0, sprocket_radius=0.06, effort_limit=1e9)
    import numpy as np

    tau = np.zeros((1, 1))
    for _ in range(500):
        model.step(tau, model.fresh_memory(1), np.full((1, 1), 0.01), np.zeros((1, 1)), np.zeros((1, 1)), 1e-3)
    assert tau[0, 0] / 0.01 == pytest.approx(position_stiffness(model)[0], rel=1e-6)
