"""Neural actuator models: joints by name, what they remember, and their two files."""

from __future__ import annotations

import json

import numpy as np
import pytest
from net_examples import NETS, driven, random_net
from safetensors.numpy import load_file, save_file

from hqpipe.actuators import ACTUATOR_MODELS
from hqpipe.actuators.files import FILE, load_actuator, save_actuator
from hqpipe.actuators.weights_file import FILE as WEIGHTS
from hqpipe.errors import ConfigError, UsageError

JOINTS = ("hip", "knee", "ankle")
EACH_JOINT = [
    ("mlp", {"taps": (0, 2, 5), "delta": True, "per_joint": True}),
    ("lstm", {"per_joint": True}),
    ("gru", {"delta": True, "per_joint": True}),
]
EVERY_NET = [
    ("mlp", {}),
    ("mlp", {"taps": (0, 2, 5), "delta": True}),
    ("lstm", {}),
    ("gru", {"delta": True}),
    *EACH_JOINT,
]


def run(model, signals):
    """(T, J) torque on logged inputs and the model's own torque, and the memory at the end."""
    effort, *inputs = signals
    torque, memory, history = effort[:1].copy(), model.fresh_memory(1), []
    for k in range(len(effort)):
        model.step(torque, memory, *(a[k : k + 1] for a in inputs), dt=1e-3)
        history.append(torque[0].copy())
    return np.array(history), memory


@pytest.mark.parametrize(("kind", "options"), EVERY_NET)
def test_permuted_joints_stay_permuted_over_time(kind, options):
    model, order = random_net(kind, JOINTS, **options), [2, 0, 1]
    signals = driven(model)
    expected, _ = run(model, signals)
    moved, _ = run(model.for_joints([JOINTS[i] for i in order]), [a[:, order] for a in signals])
    np.testing.assert_allclose(moved, expected[:, order], rtol=1e-6, atol=2e-4)  # single precision


def test_a_net_needs_all_of_its_joints():
    model = random_net("gru", JOINTS)
    with pytest.raises(UsageError, match="joint 'ankle' is missing: the net reads all of 3"):
        model.for_joints(("hip", "knee"))
    with pytest.raises(UsageError, match="no joint 'kne' – did you mean 'knee'"):
        model.for_joints(("hip", "kne", "ankle"))


@pytest.mark.parametrize(("kind", "options"), EACH_JOINT)
def test_a_net_of_each_joint_does_without_the_other_joints(kind, options):
    model = random_net(kind, JOINTS, effort_limit=[900.0, 500.0, 700.0], **options)
    signals = driven(model)
    expected, _ = run(model, signals)
    alone, _ = run(model.for_joints(("ankle",)), [a[:, [2]] for a in signals])
    np.testing.assert_allclose(alone, expected[:, [2]], rtol=1e-12)


@pytest.mark.parametrize(("kind", "options"), EACH_JOINT)
def test_a_net_of_each_joint_is_the_net_of_a_robot_with_that_joint(kind, options):
    model = random_net(kind, JOINTS, **options)
    signals = driven(model)
    expected, _ = run(model, signals)
    for j, joint in enumerate(JOINTS):
        own = {name: value[j] for name, value in model.tensors.items()}
        single = type(model).build(
            (joint,), dt=1e-3, effort_limit=np.inf, tensors=own, taps=model.taps, delta=model.delta
        )
        found, _ = run(single, [a[:, [j]] for a in signals])
        np.testing.assert_allclose(found, expected[:, [j]], rtol=1e-12)
        assert single.mean("velocity") == model.mean("velocity")[j]


def test_a_file_without_the_choice_has_one_net_for_all_joints(tmp_path):
    model = random_net("gru", JOINTS)
    path = save_actuator(model, tmp_path)
    raw = json.loads(path.read_text())
    assert raw["net"].pop("per_joint") is False
    path.write_text(json.dumps(raw))
    np.testing.assert_array_equal(load_actuator(tmp_path).weights, model.weights)


def test_a_history_starts_filled_with_the_first_sample():
    """A joint that has always been as it is now: the taps cannot tell a reset from a long rest."""
    model = random_net("mlp", JOINTS, taps=(0, 3, 7))
    still = [np.repeat(a, 20, axis=0) for a in driven(model, 1)]
    torque, memory = np.empty((20, 3)), model.fresh_memory(1)
    for k in range(20):
        now = still[0][:1].copy()
        model.step(now, memory, *(a[:1] for a in still[1:]), dt=1e-3)
        torque[k] = now
    np.testing.assert_array_equal(torque, torque[:1].repeat(20, axis=0))


def test_taps_read_what_was_that_many_samples_ago():
    """Against a net of one tap whose only nonzero inputs are those of the past."""
    lag, model = 4, random_net("mlp", JOINTS, taps=(0, 4))
    weight = model.tensors["input_weight"].copy()
    weight[:, :12] = 0.0
    past = random_net("mlp", JOINTS)
    past = type(past).build(
        JOINTS, dt=1e-3, effort_limit=np.inf, tensors={**model.tensors, "input_weight": weight[:, 12:]}
    )
    model = type(model).build(
        JOINTS, dt=1e-3, effort_limit=np.inf, taps=(0, lag), tensors={**model.tensors, "input_weight": weight}
    )
    effort, *inputs = driven(model)
    memory = model.fresh_memory(1)
    for k in range(len(effort)):
        torque, then = effort[k : k + 1].copy(), max(k - lag, 0)
        model.step(torque, memory, *(a[k : k + 1] for a in inputs), dt=1e-3)
        expected = effort[then : then + 1].copy()
        past.step(expected, past.fresh_memory(1), *(a[then : then + 1] for a in inputs), dt=1e-3)
        np.testing.assert_allclose(torque, expected, rtol=1e-12)


@pytest.mark.parametrize("kind", ["lstm", "gru"])
def test_zeroed_memory_is_a_fresh_start(kind):
    model = random_net(kind, JOINTS)
    signals = driven(model)
    torque, memory = run(model, signals)
    assert memory.any() and not np.allclose(torque[0], run(model, [a[20:] for a in signals])[0][0])
    memory[:] = 0.0
    again = signals[0][:1].copy()
    model.step(again, memory, *(a[:1] for a in signals[1:]), dt=1e-3)
    np.testing.assert_array_equal(again[0], torque[0])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"taps": (1, 2)}, "increase from 0"),
        ({"taps": (0, 2, 2)}, "increase from 0"),
        ({"tensors": {}}, "missing tensor 'input_mean'"),
        ({"dt": None}, "dt is None"),
    ],
)
def test_nonsense_is_refused(changes, words):
    model = random_net("mlp", JOINTS)
    values = {"dt": 1e-3, "effort_limit": 1.0, "tensors": model.tensors} | changes
    with pytest.raises(UsageError, match=words):
        ACTUATOR_MODELS["mlp"].build(JOINTS, **values)


def test_recurrent_nets_have_no_taps():
    with pytest.raises(UsageError, match=r"expected \[0\]: its memory is recurrent"):
        random_net("gru", JOINTS, taps=(0, 3))


@pytest.mark.parametrize(("kind", "options"), EVERY_NET)
def test_both_files_are_exact_and_their_bytes_stable(kind, options, tmp_path):
    model = random_net(kind, JOINTS, effort_limit=[900.0, np.inf, 1.0 / 3.0], **options)
    save_actuator(model, tmp_path / "a")
    loaded = load_actuator(tmp_path / "a")
    for what in ("taps", "delta", "hidden", "per_joint"):
        assert getattr(loaded, what) == getattr(model, what)
    assert type(loaded) is type(model) and loaded.hidden == 8
    np.testing.assert_array_equal(loaded.parameters, model.parameters)
    np.testing.assert_array_equal(loaded.weights, model.weights)
    save_actuator(loaded, tmp_path / "b")
    for name in (FILE, WEIGHTS):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


@pytest.fixture
def saved(tmp_path):
    save_actuator(random_net("lstm", JOINTS), tmp_path)
    return tmp_path


def change(folder, name, value):
    tensors = load_file(folder / WEIGHTS)
    if value is None:
        del tensors[name]
    else:
        tensors[name] = value
    save_file(tensors, folder / WEIGHTS)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("input_bias", None, "missing tensor 'input_bias'"),
        ("input_bais", np.zeros(32), "unknown tensor 'input_bais' – did you mean 'input_bias'"),
        ("output_bias", np.zeros(4), r"output_bias has shape \(4,\), expected \(3,\)"),
        ("output_bias", np.zeros(3, np.float32), "output_bias is of type F32, expected F64"),
        ("recurrent_bias", np.full(32, np.nan), "recurrent_bias holds numbers that are not finite"),
        ("recurrent_bias", np.full(32, 1e39), "recurrent_bias holds numbers that are not finite in single precision"),
        ("input_spread", np.zeros(12), "input_spread holds 0.0, expected spreads above 0"),
    ],
)
def test_defects_of_the_weights_are_named(saved, name, value, words):
    change(saved, name, value)
    with pytest.raises(ConfigError, match=words) as info:
        load_actuator(saved)
    assert str(saved / WEIGHTS) in str(info.value)


def test_missing_and_broken_weights_say_so(saved):
    (saved / WEIGHTS).write_bytes(b"no tensors")
    with pytest.raises(ConfigError, match="not a safetensors file"):
        load_actuator(saved)
    (saved / WEIGHTS).unlink()
    with pytest.raises(ConfigError, match=f"{WEIGHTS}: no such file"):
        load_actuator(saved)


@pytest.mark.parametrize(
    ("net", "words"),
    [
        (None, "missing field 'net'"),
        ({"hidden": "8"}, "net.hidden: expected a whole number"),
        ({"hidden": 9}, "output_weight has shape|input_weight has shape"),
        ({"taps": 0}, "net.taps: expected a list"),
        ({"delta": 1}, "net.delta: expected true or false"),
        ({"per_joint": "yes"}, "net.per_joint: expected true or false"),
        ({"per_joint": True}, "has shape"),
        ({"inputs": ["effort"]}, "net.inputs: expected"),
        ({"hiden": 8}, "net: unknown field 'hiden' – did you mean 'hidden'"),
    ],
)
def test_defects_of_the_description_are_named(saved, net, words):
    raw = json.loads((saved / FILE).read_text())
    raw = {key: value for key, value in raw.items() if key != "net"} | ({"net": raw["net"] | net} if net else {})
    (saved / FILE).write_text(json.dumps(raw))
    with pytest.raises(ConfigError, match=words):
        load_actuator(saved)


def test_only_a_net_is_described_as_one(saved):
    raw = json.loads((saved / FILE).read_text())
    (saved / FILE).write_text(json.dumps(raw | {"model": "stiff_pd"}))
    with pytest.raises(ConfigError, match="unknown field 'net'"):
        load_actuator(saved)


@pytest.mark.parametrize("kind", NETS)
def test_the_paper_s_size(kind):
    model = random_net(kind, tuple(f"joint{j}" for j in range(12)), hidden=64)
    assert model.tensors["input_weight"].shape[1] == 48 and model.tensors["output_weight"].shape == (12, 64)
