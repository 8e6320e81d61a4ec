"""actuator.json: what is written is what is read, and every defect is named."""

from __future__ import annotations

import json

import numpy as np
import pytest

from hqpipe.actuators.files import FILE, load_actuator, save_actuator
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.errors import ConfigError


@pytest.fixture
def model():
    return Hydraulic.build(
        ("LFR", "LFP"),
        dt=0.001,
        k1=[1 / 3, 5e4],
        k2=0.02,
        k3=3e3,
        k4=0.0,
        sprocket_radius=0.06,
        effort_limit=[np.inf, 950.0],
    )


def test_round_trip_is_exact_and_bytes_are_stable(model, tmp_path):
    first = save_actuator(model, tmp_path / "a").read_bytes()
    loaded = load_actuator(tmp_path / "a")
    assert type(loaded) is Hydraulic
    np.testing.assert_array_equal(loaded.parameters, model.parameters)
    assert (loaded.joints, loaded.dt, loaded.scope) == (model.joints, model.dt, model.scope)
    assert save_actuator(loaded, tmp_path / "b").read_bytes() == first


def edited(actuator, folder, **changes):
    raw = actuator.to_dict()
    for key, value in changes.items():
        if value is ...:
            del raw[key]
        else:
            raw[key] = value
    folder.mkdir(exist_ok=True)
    (folder / FILE).write_text(json.dumps(raw))
    return folder


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"modell": "hydraulic"}, "unknown field 'modell' – did you mean 'model'"),
        ({"dt": ...}, "missing field 'dt'"),
        ({"dt": None}, "dt is None"),
        ({"dt": "1 ms"}, "dt: expected a number in s"),
        ({"model": "hydrualic"}, "did you mean 'hydraulic'"),
        ({"format": "hqpipe-actuator/9"}, "format: .*expected hqpipe-actuator/1"),
        ({"joints": ["LFR", "LFR"]}, "distinct joint names"),
        ({"joints": "LFR"}, "joints: expected a list"),
        ({"scope": "global"}, "per_joint or shared"),
        ({"parameters": []}, "parameters: expected an object"),
    ],
)
def test_defects_are_named(model, tmp_path, changes, words):
    folder = edited(model, tmp_path / "x", **changes)
    with pytest.raises(ConfigError, match=words) as info:
        load_actuator(folder)
    assert str(folder / FILE) in str(info.value)


@pytest.mark.parametrize(
    ("name", "entry", "words"),
    [
        ("k2", {"unit": "1", "values": [0.1, 1.5]}, "k2 of joint LFP is 1.5"),
        ("k2", {"unit": "%", "values": [0.1, 0.2]}, "unit: expected .1., got .%."),
        ("k1", {"unit": "N/m", "values": [1.0]}, "expected 2 elements"),
        ("k1", {"unit": "N/m", "values": [1.0, None]}, "joint LFP: expected a number, got None"),
        ("k1", {"unit": "N/m", "values": [1.0, True]}, "joint LFP: expected a number, got True"),
        ("k5", {"unit": "1", "values": [0, 0]}, "unknown parameter .k5."),
    ],
)
def test_parameter_defects_are_named(model, tmp_path, name, entry, words):
    parameters = model.to_dict()["parameters"] | {name: entry}
    folder = edited(model, tmp_path / "x", parameters=parameters)
    with pytest.raises(ConfigError, match=words):
        load_actuator(folder)


def test_missing_and_broken_files_say_so(tmp_path):
    with pytest.raises(ConfigError, match="no such file"):
        load_actuator(tmp_path)
    (tmp_path / FILE).write_text("{")
    with pytest.raises(ConfigError, match="not JSON"):
        load_actuator(tmp_path)
