from __future__ import annotations

import shutil
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import yaml

from hqpipe.errors import ConfigError, UsageError
from hqpipe.rl import gait
from hqpipe.rl.controller import (
    EstimateLog,
    HeadingHold,
    PolicyController,
    Wiring,
    onnx_controller,
    read_wiring,
    torch_controller,
)
from hqpipe.rl.networks import LocomotionNetworks
from hqpipe.rl.onnx_export import export_onnx
from hqpipe.rl.policy_io import save_policy

JOINTS = tuple("ABC")
COMMAND = {"vx": 0.5, "vy": 0.0, "wz": 0.1}


def frame(q=(0.1, 0.2, 0.3), yaw: float = 0.0) -> SimpleNamespace:
    return SimpleNamespace(
        q=np.array(q),
        qd=np.array(q) * 10,
        gyro=np.zeros(3),
        orientation=np.array([0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)]),
    )


class Echo:
    """Writes down the observations and answers with 1, 2, 3."""

    def __init__(self) -> None:
        self.seen: list[np.ndarray] = []

    def __call__(self, observation: np.ndarray) -> list[np.ndarray]:
        self.seen.append(observation[0])
        return [np.array([[1.0, 2.0, 3.0]])]


def controller(echo: Echo, **kwargs) -> PolicyController:
    return PolicyController(Wiring(JOINTS, 0.01, 2.0, "position"), echo, **kwargs)


def test_previous_target_starts_at_the_position_and_then_follows():
    echo = Echo()
    run = controller(echo)
    run(frame(), COMMAND)
    run(frame(), COMMAND)
    np.testing.assert_allclose(echo.seen[0][9:12], [0.1, 0.2, 0.3], rtol=1e-6)
    np.testing.assert_allclose(echo.seen[1][9:12], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(echo.seen[0][12:15], [0.5, 0.0, 0.1], rtol=1e-6)


def test_clock_advances_with_every_call_and_restarts_on_reset():
    echo = Echo()
    run = controller(echo)
    for _ in range(3):
        run(frame(), COMMAND)
    run.reset()
    run(frame(), COMMAND)
    expected = [gait.clock(np.array(p)) for p in (0.0, 0.02, 0.04, 0.0)]
    np.testing.assert_allclose([s[-2:] for s in echo.seen], expected, atol=1e-6)


def test_joints_are_mapped_by_name():
    echo = Echo()
    run = controller(echo, joints=("C", "A", "B"))
    targets = run(frame(q=(0.3, 0.1, 0.2)), COMMAND)
    np.testing.assert_allclose(echo.seen[0][3:6], [0.1, 0.2, 0.3], rtol=1e-6)
    np.testing.assert_allclose(targets, [3.0, 1.0, 2.0])


def test_other_joints_are_refused():
    with pytest.raises(UsageError, match="cannot drive A, B, X"):
        controller(Echo(), joints=("A", "B", "X"))


@pytest.mark.parametrize(("yaw", "expected"), [(0.2, -0.3), (-0.1, 0.15), (3.0, -0.4)])
def test_heading_hold_steers_back(yaw, expected):
    echo = Echo()
    run = controller(echo, heading_hold=HeadingHold(gain=1.5, limit=0.4, heading=0.0))
    run(frame(yaw=yaw), COMMAND)
    assert echo.seen[0][14] == pytest.approx(expected, abs=1e-6)


def test_heading_hold_takes_the_first_heading():
    echo = Echo()
    run = controller(echo, heading_hold=HeadingHold(gain=1.0))
    run(frame(yaw=3.1), COMMAND)
    run(frame(yaw=-3.1), COMMAND)
    assert echo.seen[0][14] == pytest.approx(0.0, abs=1e-6)
    assert echo.seen[1][14] == pytest.approx(6.2 - 2 * np.pi, abs=1e-5)


@pytest.fixture(scope="module")
def folder(spec, tmp_path_factory):
    torch.manual_seed(0)
    networks, folder = LocomotionNetworks(spec), tmp_path_factory.mktemp("policy")
    save_policy(folder, spec, networks)
    export_onnx(folder, spec, networks)
    return folder


def test_torch_and_onnx_walk_in_step(robot, folder):
    first, second = torch_controller(folder), onnx_controller(folder)
    rng = np.random.default_rng(0)
    for _ in range(30):
        now = frame(q=robot.nominal_position + rng.normal(0, 0.05, 12))
        np.testing.assert_allclose(first(now, COMMAND), second(now, COMMAND), atol=1e-5)
    assert first.wiring == second.wiring


def test_what_the_estimator_believes_is_written_down_when_asked(robot, folder):
    logs = []
    for load in (torch_controller, onnx_controller):
        run = load(folder)
        run(frame(q=robot.nominal_position), COMMAND)
        run.record = EstimateLog()
        for _ in range(3):
            run(frame(q=robot.nominal_position), COMMAND)
        logs.append(run.record)
    first, second = logs
    assert first.names == second.names and "foot_contact/RH" in first.names
    assert np.shape(first.rows) == (3, len(first.names))
    np.testing.assert_allclose(first.rows, second.rows, atol=1e-5)


def test_a_graph_that_keeps_its_estimate_to_itself_still_walks(robot, folder, tmp_path):
    deploy = yaml.safe_load((folder / "deploy.yaml").read_text(encoding="utf-8"))
    del deploy["estimate"]
    (tmp_path / "deploy.yaml").write_text(yaml.safe_dump(deploy), encoding="utf-8")
    shutil.copy(folder / "policy.onnx", tmp_path)
    run, full = onnx_controller(tmp_path), onnx_controller(folder)
    run.record = EstimateLog()
    now = frame(q=robot.nominal_position)
    np.testing.assert_array_equal(run(now, COMMAND), full(now, COMMAND))
    assert run.record == EstimateLog()


def test_foreign_deploy_file_is_refused(folder, tmp_path):
    text = (folder / "deploy.yaml").read_text(encoding="utf-8")
    (tmp_path / "deploy.yaml").write_text(text.replace("name: joint_velocity", "name: joint_speed"), encoding="utf-8")
    with pytest.raises(ConfigError, match="expected base_angular_velocity"):
        read_wiring(tmp_path)
