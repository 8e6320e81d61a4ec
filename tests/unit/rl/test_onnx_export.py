from __future__ import annotations

from dataclasses import replace

import numpy as np
import onnx
import pytest
import torch
import yaml

from hqpipe.rl.config import GaitConfig
from hqpipe.rl.networks import LocomotionNetworks
from hqpipe.rl.observation import observation_layout
from hqpipe.rl.onnx_export import export_onnx, onnx_bytes, sample_observations, torch_actions
from hqpipe.rl.onnx_session import latency, open_session, parity


def exported(spec, robot, prior: str, folder):
    spec = replace(spec, gait=GaitConfig(prior=prior), observation=observation_layout(robot, prior))
    torch.manual_seed(0)
    networks = LocomotionNetworks(spec)
    return spec, networks, export_onnx(folder, spec, networks)


@pytest.fixture(scope="module")
def trot(spec, robot, tmp_path_factory):
    return exported(spec, robot, "trot_residual", tmp_path_factory.mktemp("trot"))


def test_onnx_equals_torch_over_the_whole_clock(trot):
    spec, networks, path = trot
    seen = sample_observations(spec, 256, np.random.default_rng(0))
    angles = np.arange(8) * np.pi / 4
    seen[:8, spec.observation.part("clock")] = np.stack((np.sin(angles), np.cos(angles)), axis=1)
    assert parity(path, seen, torch_actions(spec, networks, seen)) < 1e-5


@pytest.mark.parametrize("prior", ["none", "clock"])
def test_onnx_equals_torch_without_a_trot(spec, robot, tmp_path, prior):
    spec, networks, path = exported(spec, robot, prior, tmp_path)
    seen = sample_observations(spec, 64, np.random.default_rng(0))
    assert parity(path, seen, torch_actions(spec, networks, seen)) < 1e-5


def test_onnx_equals_torch_in_a_symmetric_policy(spec, robot, tmp_path):
    spec, networks, path = exported(replace(spec, symmetric=True), robot, "trot_residual", tmp_path)
    seen = sample_observations(spec, 64, np.random.default_rng(0))
    assert parity(path, seen, torch_actions(spec, networks, seen)) < 1e-5


@pytest.mark.parametrize("symmetric", [True, False])
def test_onnx_equals_torch_with_leg_odometry(spec, robot, tmp_path, symmetric):
    """Targets and x̃_t; the graph still takes o_t alone."""
    spec = replace(spec, symmetric=symmetric, leg_odometry=True)
    spec, networks, path = exported(spec, robot, "none", tmp_path)
    seen = sample_observations(spec, 64, np.random.default_rng(0))
    assert parity(path, seen, torch_actions(spec, networks, seen)) < 1e-5
    (told,) = open_session(path).run(["estimate"], {"obs": seen})
    with torch.no_grad():
        believed = networks.normalise_state.restore(networks.estimate(torch.as_tensor(seen))).numpy()
    np.testing.assert_allclose(told, believed, atol=1e-4)


def test_the_graph_tells_what_the_estimator_believes(trot):
    """x̃_t in physical units, element by element as deploy.yaml names it."""
    spec, networks, path = trot
    seen = sample_observations(spec, 64, np.random.default_rng(1))
    (told,) = open_session(path).run(["estimate"], {"obs": seen})
    with torch.no_grad():
        believed = networks.estimate(torch.as_tensor(seen)).numpy() / spec.state.scale + spec.state.offset
    np.testing.assert_allclose(told, believed, atol=1e-5)
    rows = yaml.safe_load((path.parent / "deploy.yaml").read_text(encoding="utf-8"))["estimate"]
    assert [(row["name"], row["start"], row["size"]) for row in rows] == [
        (term.name, spec.state.part(term.name).start, term.size) for term in spec.state.terms
    ]


def test_same_policy_same_bytes_and_no_paths(trot):
    spec, networks, path = trot
    data = path.read_bytes()
    assert onnx_bytes(spec, networks) == data
    for trace in (b"site-packages", b"/networks.py", b"stack_trace", b".py"):
        assert trace not in data


def test_graph_is_one_file_of_opset_18_with_a_free_batch(trot):
    model = onnx.load(trot[2], load_external_data=False)
    assert [o.version for o in model.opset_import if o.domain == ""] == [18]
    assert [i.name for i in model.graph.input] == ["obs"]
    assert [o.name for o in model.graph.output] == ["actions", "estimate"], "a runner takes the first"
    assert model.graph.input[0].type.tensor_type.shape.dim[0].dim_param
    assert not any(t.external_data for t in model.graph.initializer)


def test_metadata_speaks_to_public_runners(trot):
    spec, _, path = trot
    props = {p.key: p.value for p in onnx.load(path).metadata_props}
    assert props["joint_names"].split(",") == list(spec.joints)
    for key in ("joint_stiffness", "joint_damping", "default_joint_pos", "action_scale"):
        assert len(props[key].split(",")) == 12
    names, sizes = props["observation_names"].split(","), props["observation_terms_size"].split(",")
    assert sum(map(int, sizes)) == spec.observation.size
    assert len(props["observation_terms_scale"].split(",")) == len(names)
    assert props["command_names"] == "velocity_command"


def test_deploy_file_describes_the_wiring(trot):
    raw = yaml.safe_load((trot[2].parent / "deploy.yaml").read_text(encoding="utf-8"))
    assert raw["rates"]["policy_hz"] == 100
    assert raw["clock"]["frequency_hz"] == GaitConfig().frequency_hz
    assert list(raw["joints"]) == raw["actions"]["joints"]
    last = raw["observation"][-1]
    assert (last["name"], last["start"], last["size"]) == ("clock", 42, 2)


def test_latency_is_measured(trot):
    times = latency(trot[2], repeats=50)
    assert 0.0 < times["median_us"] <= times["p99_us"]
