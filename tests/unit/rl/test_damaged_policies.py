"""Every file of a trained and of an exported policy under every damage: an error that names file and remedy."""

from __future__ import annotations

import io
import json
import zipfile

import numpy as np
import onnx
import pytest
import torch
import yaml
from damage import (
    ANY_FILE,
    JSON_FILE,
    YAML_FILE,
    checked,
    refused,
    refuses_every,
    survives_fields,
    survives_flips,
    write_json,
    write_yaml,
)
from numpy.lib import format as npy
from onnx import TensorProto, helper

from hqpipe.errors import ConfigError
from hqpipe.rl.controller import onnx_controller, read_wiring, torch_controller
from hqpipe.rl.networks import LocomotionNetworks
from hqpipe.rl.onnx_export import export_onnx
from hqpipe.rl.onnx_session import latency, open_session, parity
from hqpipe.rl.parity_file import FILE as PARITY
from hqpipe.rl.parity_file import read_parity, save_parity
from hqpipe.rl.policy_io import SPEC, WEIGHTS, load_policy, save_policy

OBSERVED = 44  # numbers of an observation of twelve joints, with the clock


@pytest.fixture(scope="module")
def made(tmp_path_factory, spec):
    """A policy and its export, as bytes of each file."""
    folder = tmp_path_factory.mktemp("policy")
    torch.manual_seed(0)
    networks = LocomotionNetworks(spec)
    save_policy(folder, spec, networks)
    export_onnx(folder, spec, networks)
    rng = np.random.default_rng(0)
    save_parity(folder, rng.normal(size=(5, OBSERVED)).astype(np.float32), rng.normal(size=(5, 12)).astype(np.float32))
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def folder(made, tmp_path):
    for name, content in made.items():
        (tmp_path / name).write_bytes(content)
    return tmp_path


@pytest.mark.parametrize("damages", [ANY_FILE, JSON_FILE], ids=["any file", "json"])
def test_a_damaged_policy_json_is_refused(folder, damages):
    refuses_every(damages, lambda: load_policy(folder), folder / SPEC)


def test_damaged_weights_are_refused(folder):
    refuses_every(ANY_FILE, lambda: load_policy(folder), folder / WEIGHTS)


@pytest.mark.parametrize("damages", [ANY_FILE, YAML_FILE], ids=["any file", "yaml"])
def test_a_damaged_deploy_yaml_is_refused(folder, damages):
    # A cut behind the last field that is read leaves a whole description.
    refuses_every(
        {name: damage for name, damage in damages.items() if name != "cut at 0.9"},
        lambda: read_wiring(folder),
        folder / "deploy.yaml",
    )


def test_a_damaged_graph_is_refused(folder):
    refuses_every(ANY_FILE, lambda: open_session(folder / "policy.onnx"), folder / "policy.onnx")


def test_a_damaged_parity_file_is_refused(folder):
    refuses_every(ANY_FILE, lambda: read_parity(folder, 12), folder / PARITY)


@pytest.mark.parametrize(
    ("name", "read"),
    [
        (SPEC, load_policy),
        (WEIGHTS, load_policy),
        ("deploy.yaml", read_wiring),
        ("policy.onnx", onnx_controller),
        (PARITY, lambda folder: read_parity(folder, 12)),
    ],
)
def test_a_flipped_bit_is_refused_or_another_number(folder, name, read):
    survives_flips(lambda: read(folder), folder / name)


def test_every_wrong_field_of_policy_json_is_refused(folder):
    content = json.loads((folder / SPEC).read_text(encoding="utf-8"))
    passed = survives_fields(content, write_json, lambda: load_policy(folder), folder / SPEC)
    passed = {name for name in passed if name != "leg_odometry missing"}  # older policies lack it
    assert not {name for name in passed if name.endswith((" missing", " misspelt"))}, passed
    assert not {name for name in passed if "1e+300" in name or "null" in name or "None" in name}, passed


def test_every_wrong_field_of_deploy_yaml_is_refused_or_not_read(folder):
    content = yaml.safe_load((folder / "deploy.yaml").read_text(encoding="utf-8"))
    for unread in ("joints", "command_range", "model", "robot"):
        del content[unread]
    passed = survives_fields(content, write_yaml, lambda: read_wiring(folder), folder / "deploy.yaml")
    # Other fields are for other runners; an estimate may be left out, a term of it may be called anything.
    read = ("format", "control_mode", "actions.joints", "rates.policy_hz", "clock.frequency_hz")
    assert not {name for name in passed if name.startswith(read)}, passed


@pytest.mark.parametrize("hidden", [[10**9, 10**9], [4097], [64] * 9, [], [0], [1.5]])
def test_a_policy_cannot_ask_for_more_units_than_run_in_time(folder, hidden):
    content = json.loads((folder / SPEC).read_text(encoding="utf-8"))
    write_json(folder / SPEC, content | {"hidden": hidden})
    assert refused(lambda: load_policy(folder), folder / SPEC).field.startswith("hidden")


def test_a_large_net_that_the_weights_do_not_hold_is_refused_before_it_is_made(folder, monkeypatch):
    content = json.loads((folder / SPEC).read_text(encoding="utf-8"))
    write_json(folder / SPEC, content | {"hidden": [4096] * 8})
    monkeypatch.setattr(torch.nn.init, "orthogonal_", lambda weight, gain: _no_numbers(weight))
    refused(lambda: load_policy(folder), folder / WEIGHTS)


def _no_numbers(weight):
    assert weight.device.type == "meta"
    return weight


def test_weights_that_are_not_finite_are_refused(folder, spec):
    networks = LocomotionNetworks(spec)
    with torch.no_grad():
        networks.critic[0].bias[0] = float("nan")
    save_policy(folder, spec, networks)
    assert refused(lambda: torch_controller(folder), folder / WEIGHTS).field == "critic.0.bias"


def graph(nodes=None, inputs=None, outputs=None, initializers=(), opset=18, actions=12):
    """Bytes of an ONNX model; without arguments one that answers an observation with zeros."""
    if nodes is None:
        weight = helper.make_tensor("weight", TensorProto.FLOAT, [OBSERVED, actions], np.zeros(OBSERVED * actions))
        initializers, nodes = [*initializers, weight], [helper.make_node("MatMul", ["obs", "weight"], ["actions"])]
    inputs = inputs or [helper.make_tensor_value_info("obs", TensorProto.FLOAT, ["batch", OBSERVED])]
    outputs = outputs or [helper.make_tensor_value_info("actions", TensorProto.FLOAT, ["batch", actions])]
    body = helper.make_graph(nodes, "policy", inputs, outputs, initializers)
    model = helper.make_model(body, opset_imports=[helper.make_opsetid("", opset)])
    model.ir_version = 10
    return model


def external(path="../../../../etc/passwd"):
    model = graph()
    tensor = model.graph.initializer[0]
    tensor.ClearField("float_data")
    tensor.data_location = TensorProto.EXTERNAL
    for key, value in (("location", path), ("offset", "0"), ("length", "2112")):
        entry = tensor.external_data.add()
        entry.key, entry.value = key, value
    return model


def hidden_external():
    """The same inside of a node."""
    model, other = graph(), external()
    constant = helper.make_node("Constant", [], ["unused"])
    constant.attribute.add(name="value", type=onnx.AttributeProto.TENSOR).t.CopyFrom(other.graph.initializer[0])
    model.graph.node.append(constant)
    return model


def ends(name="obs", kind=TensorProto.FLOAT, shape=("batch", OBSERVED)):
    return [helper.make_tensor_value_info(name, kind, shape)]


WRONG_GRAPHS = {
    "external data": (external, "lies in another file"),
    "external data in a node": (hidden_external, "lies in another file"),
    "another input": (
        lambda: graph([helper.make_node("Identity", ["x"], ["actions"])], ends("x"), ends("actions")),
        "inputs are x, expected obs",
    ),
    "two inputs": (
        lambda: graph([helper.make_node("Add", ["obs", "x"], ["actions"])], ends() + ends("x"), ends("actions")),
        "inputs are obs, x, expected obs",
    ),
    "another output": (
        lambda: graph([helper.make_node("Identity", ["obs"], ["y"])], ends(), ends("y")),
        "outputs are y, expected actions",
    ),
    "float64": (
        lambda: graph(
            [helper.make_node("Identity", ["obs"], ["actions"])],
            ends(kind=TensorProto.DOUBLE),
            ends("actions", TensorProto.DOUBLE),
        ),
        "obs is tensor(double), expected tensor(float)",
    ),
    "three dimensions": (
        lambda: graph(
            [helper.make_node("Identity", ["obs"], ["actions"])],
            ends(shape=("b", 4, 11)),
            ends("actions", shape=("b", 4, 11)),
        ),
        "expected (B, n)",
    ),
    "an unknown size": (
        lambda: graph([helper.make_node("Identity", ["obs"], ["actions"])], ends(shape=("b", "n")), ends("actions")),
        "with a known n",
    ),
    "an operator from elsewhere": (
        lambda: graph([helper.make_node("Run", ["obs"], ["actions"], domain="mine")]),
        "ONNX Runtime cannot load it",
    ),
    "an opset of the future": (lambda: graph(opset=999), "ONNX Runtime cannot load it"),
    "no opset": (lambda: graph(opset=-1), "ONNX Runtime cannot load it"),
    "other sizes inside": (
        lambda: graph([helper.make_node("MatMul", ["obs", "obs"], ["actions"])], ends(shape=(1, OBSERVED))),
        "ONNX Runtime cannot",
    ),
    "another observation": (
        lambda: graph(
            [helper.make_node("Identity", ["obs"], ["actions"])],
            ends(shape=("b", 12)),
            ends("actions", shape=("b", 12)),
        ),
        "obs has 12 numbers, expected 44",
    ),
    "fewer actions": (lambda: graph(actions=11), "actions has shape (1, 11), expected (1, 12)"),
}


@pytest.fixture
def without_estimate(folder):
    description = yaml.safe_load((folder / "deploy.yaml").read_text(encoding="utf-8"))
    del description["estimate"]
    write_yaml(folder / "deploy.yaml", description)
    return folder


@pytest.mark.parametrize("name", WRONG_GRAPHS)
def test_another_graph_is_refused(without_estimate, name):
    make, words = WRONG_GRAPHS[name]
    path = without_estimate / "policy.onnx"
    path.write_bytes(make().SerializeToString())
    assert words in str(refused(lambda: onnx_controller(without_estimate), path))


def test_a_graph_without_the_estimate_that_is_described_is_refused(folder):
    (folder / "policy.onnx").write_bytes(graph().SerializeToString())
    assert refused(lambda: onnx_controller(folder), folder / "policy.onnx").field == "estimate"


def test_targets_that_are_no_numbers_never_reach_the_machine(without_estimate, robot):
    path = without_estimate / "policy.onnx"
    model = graph()
    model.graph.initializer[0].float_data[0] = float("nan")
    path.write_bytes(model.SerializeToString())
    run = onnx_controller(without_estimate)
    frame = type("Frame", (), {"q": np.zeros(12), "qd": np.zeros(12), "gyro": np.zeros(3), "orientation": np.eye(4)[3]})
    with pytest.raises(ConfigError, match="actions are not finite") as caught:
        run(frame, {"vx": 0.0, "vy": 0.0, "wz": 0.0})
    checked(caught.value, path)


def test_parity_and_latency_name_the_graph(folder):
    path = folder / "policy.onnx"
    assert "has 44 numbers" in str(refused(lambda: parity(path, np.zeros((2, 3), np.float32), np.zeros((2, 12))), path))
    path.write_bytes(b"no graph")
    refused(lambda: latency(path), path)


def archive(**members):
    """Bytes of a zip of files."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as made:
        for name, content in members.items():
            made.writestr(f"{name}.npy", content)
    return stream.getvalue()


def array(values=None, shape=None, dtype="<f4", version=(1, 0)):
    """Bytes of an .npy file, whose head may lie about the size."""
    stream = io.BytesIO()
    head = {"descr": dtype, "fortran_order": False, "shape": shape or values.shape}
    (npy.write_array_header_1_0 if version == (1, 0) else npy.write_array_header_2_0)(stream, head)
    return stream.getvalue() + (b"" if values is None else values.tobytes())


SOUND = np.zeros((5, 12), np.float32)
WRONG_ARCHIVES = {
    "a shape of 10^12": lambda: archive(observations=array(shape=(10**12, 12)), actions=array(SOUND)),
    "a negative shape": lambda: archive(observations=array(shape=(-1, 12)), actions=array(SOUND)),
    "a shape of 400 digits": lambda: archive(observations=array(shape=(10**400, 1)), actions=array(SOUND)),
    "pickled objects": lambda: archive(observations=array(shape=(5, 12), dtype="|O"), actions=array(SOUND)),
    "float64": lambda: archive(observations=array(SOUND.astype(float), dtype="<f8"), actions=array(SOUND)),
    "records": lambda: archive(observations=array(shape=(5, 12), dtype=[("a", "<f4")]), actions=array(SOUND)),
    "one dimension": lambda: archive(observations=array(SOUND[0]), actions=array(SOUND)),
    "another version": lambda: archive(observations=array(SOUND, version=(2, 0)), actions=array(SOUND)),
    "no head": lambda: archive(observations=b"", actions=array(SOUND)),
    "not finite": lambda: archive(observations=array(SOUND), actions=array(np.full((5, 12), np.nan, np.float32))),
    "no rows": lambda: archive(observations=array(SOUND[:0]), actions=array(SOUND[:0])),
    "other rows": lambda: archive(observations=array(SOUND), actions=array(SOUND[:4])),
    "other joints": lambda: archive(observations=array(SOUND), actions=array(SOUND[:, :11].copy())),
    "one array": lambda: archive(observations=array(SOUND)),
    "another array": lambda: archive(observations=array(SOUND), actions=array(SOUND), more=array(SOUND)),
    "no arrays": lambda: archive(),
}


@pytest.mark.parametrize("name", WRONG_ARCHIVES)
def test_wrong_arrays_are_refused(folder, name):
    (folder / PARITY).write_bytes(WRONG_ARCHIVES[name]())
    refused(lambda: read_parity(folder, 12), folder / PARITY)
