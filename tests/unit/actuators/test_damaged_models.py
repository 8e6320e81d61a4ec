"""actuator.json, weights.safetensors and posterior.json under every damage: an error that names file and remedy."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
from damage import (
    ANY_FILE,
    JSON_FILE,
    refused,
    refuses_every,
    survives_fields,
    survives_flips,
    write_json,
)
from net_examples import random_net
from safetensors.numpy import load_file, save_file

from hqpipe.actuators.files import FILE, load_actuator, save_actuator
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.posterior import Alternative, Choice, Group, Posterior, Range
from hqpipe.actuators.posterior_file import FILE as POSTERIOR
from hqpipe.actuators.posterior_file import load_posterior, save_posterior
from hqpipe.actuators.weights_file import FILE as WEIGHTS

JOINTS = ("LFR", "LFP")
MEAN, SPREAD = np.array([1.0e5, 0.05, 4.0e3, 20.0]), np.array([5e3, 2e-3, 2e2, 1.0])


@pytest.fixture(scope="module")
def fitted():
    columns = dict(zip(("k1", "k2", "k3", "k4"), MEAN, strict=True))
    return Hydraulic.build(JOINTS, dt=1e-3, sprocket_radius=0.06, effort_limit=[np.inf, 950.0], **columns)


@pytest.fixture
def folder(fitted, tmp_path):
    save_actuator(fitted, tmp_path)
    scatter = np.diag(SPREAD**2)
    upper = np.array([np.inf, 1.0, np.inf, np.inf])
    ranges = {"k4": Range(0.0, 8.0, "no impacts")}
    first, second = (Group((joint,), MEAN, scatter, scatter, 4, np.zeros(4), upper, ranges) for joint in JOINTS)
    choice = Choice((Alternative("as diagnosed", 0.75, (second,)), Alternative("another law", 0.25, (second,))))
    save_posterior(Posterior("hydraulic", ("k1", "k2", "k3", "k4"), (first,), (choice,)), fitted, tmp_path)
    return tmp_path


@pytest.fixture
def net(tmp_path):
    save_actuator(random_net("mlp", JOINTS, hidden=4, taps=(0, 2)), tmp_path)
    return tmp_path


@pytest.mark.parametrize("damages", [ANY_FILE, JSON_FILE], ids=["any file", "json"])
def test_a_damaged_actuator_json_is_refused(folder, damages):
    refuses_every(damages, lambda: load_actuator(folder), folder / FILE)


@pytest.mark.parametrize("damages", [ANY_FILE, JSON_FILE], ids=["any file", "json"])
def test_a_damaged_posterior_is_refused(folder, fitted, damages):
    damages = {name: damage for name, damage in damages.items() if name != "missing"}  # a model may have none
    refuses_every(damages, lambda: load_posterior(folder, fitted), folder / POSTERIOR)


def test_damaged_weights_are_refused(net):
    refuses_every(ANY_FILE, lambda: load_actuator(net), net / WEIGHTS)


@pytest.mark.parametrize("name", [FILE, POSTERIOR])
def test_a_flipped_bit_in_text_is_refused_or_harmless(folder, fitted, name):
    survives_flips(lambda: (load_actuator(folder), load_posterior(folder, fitted)), folder / name)


def test_a_flipped_bit_in_weights_is_refused_or_another_number(net):
    survives_flips(lambda: load_actuator(net), net / WEIGHTS)


def test_every_wrong_field_of_actuator_json_is_refused(folder):
    content = json.loads((folder / FILE).read_text())
    passed = survives_fields(content, write_json, lambda: load_actuator(folder), folder / FILE)
    values = {name.rpartition(" = ")[0] for name in passed}
    # Values of parameters within their bounds, joints of other names.
    assert all(name.startswith(("parameters.", "joints.")) for name in values), passed
    assert not {name for name in passed if "1e+300" in name or "inf" in name or "nan" in name}


def test_every_wrong_field_of_a_net_is_refused(net):
    content = json.loads((net / FILE).read_text())
    passed = survives_fields(content, write_json, lambda: load_actuator(net), net / FILE)
    assert {name for name in passed if name.startswith("net")} == {
        "net.delta = 'True'",
        "net.taps.0 = '0'",
        "net.per_joint missing",  # a file of before there was a choice
    }


def test_every_wrong_field_of_a_posterior_is_refused(folder, fitted):
    content = json.loads((folder / POSTERIOR).read_text())
    passed = survives_fields(content, write_json, lambda: load_posterior(folder, fitted), folder / POSTERIOR)
    assert not {name for name in passed if name.endswith((" missing", " misspelt")) and "ranges" not in name}, passed


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"hidden": 10**9}, "net.hidden: is 1000000000, expected 1 to 4096 .larger nets cannot be stepped"),
        ({"taps": [0, 10**9]}, r"net.taps\[1\]: is 1000000000, expected 0 to 4096 .every robot remembers"),
        ({"taps": list(range(5000))}, "net.taps: expected 1 to 4096 elements, got 5000"),
    ],
)
def test_a_net_cannot_ask_for_more_than_a_robot_has(net, change, words):
    content = json.loads((net / FILE).read_text())
    write_json(net / FILE, content | {"net": content["net"] | change})
    error = refused(lambda: load_actuator(net), net / FILE)
    assert pytest.raises(type(error), load_actuator, net).match(words) and error.field.startswith("net.")


def test_another_file_in_the_place_is_refused(folder, fitted):
    (folder / FILE).write_bytes((folder / POSTERIOR).read_bytes())
    refused(lambda: load_actuator(folder), folder / FILE)
    save_actuator(fitted, folder)
    (folder / POSTERIOR).write_bytes((folder / FILE).read_bytes())
    refused(lambda: load_posterior(folder, fitted), folder / POSTERIOR)


@pytest.mark.parametrize("length", [2**63, 2**64 - 1, 100_000_000, 10, 0])
def test_a_header_of_weights_may_declare_any_size(net, length):
    content = (net / WEIGHTS).read_bytes()
    (net / WEIGHTS).write_bytes(struct.pack("<Q", length) + content[8:])
    refused(lambda: load_actuator(net), net / WEIGHTS)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("output_bias", np.zeros(2, np.float16)),
        ("output_bias", np.zeros((2, 1))),
        ("output_bias", np.zeros(0)),
        ("output_bias", np.full(2, np.inf)),
        ("output_spread", -np.ones(2)),
        ("more", np.zeros(1)),
    ],
)
def test_wrong_tensors_are_refused_with_their_name(net, name, value):
    save_file(load_file(net / WEIGHTS) | {name: value}, net / WEIGHTS)
    assert refused(lambda: load_actuator(net), net / WEIGHTS).field == name
