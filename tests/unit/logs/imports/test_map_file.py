"""The mapping file is read strictly; whatever is wrong names file, field and remedy."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from damage import YAML_FILE, refuses_every, survives_fields, write_yaml
from foreign_tables import MAP, write_map

from hqpipe.logs.imports.mapping import read_map
from hqpipe.logs.imports.recording import ImportLogError
from hqpipe.logs.imports.units import KINDS, UNITS, to_si

FULL = MAP | {
    "robot": "rig",
    "rate_hz": 200,
    "clocks": {"pressures": {"field": "t", "unit": "samples", "rate_hz": 500}},
    "trials": [{"files": "a*", "split": "heldout", "command": {"vx": 1}, "base": "fixed", "drive": {"hip": {"kp": 1}}}],
    "load": {"knee": {"mass_kg": 3}},
    "join": "{trial}/{part}.csv",
}


def changed(*path, value):
    content = copy.deepcopy(FULL)
    node = content
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    return content


def refused(tmp_path, content) -> ImportLogError:
    path = write_map(tmp_path / "map.yaml", content)
    with pytest.raises(ImportLogError) as caught:
        read_map(path)
    assert caught.value.file == str(path) and caught.value.fix and "\n" not in str(caught.value)
    return caught.value


HIP = ("joints", "hip")
WRONG = [
    (("control_mode",), "valve", "control_mode", "valve control has valve_command as its input, which no joint has"),
    ((*HIP, "effort"), {"field": "i", "integral": True}, "joints.hip.effort", "integral belongs to a position"),
    ((*HIP, "position"), {"field": "n", "unit": "rpm", "integral": "yes"}, "joints.hip.position", "expected true"),
    ((*HIP, "position"), {"field": "n", "unit": "deg", "integral": True}, "joints.hip.position.unit", "unit of angle"),
    (("clock",), {"rate_hz": 0}, "clock.rate_hz", "expected 0.001 to"),
    (("clock",), {"unit": "samples", "rate_hz": 50}, "clock", "a unit belongs to a field"),
    (("join",), "{trial}.csv", "join", "{part} once"),
    (("format",), "hqpipe-log-map/2", "format", "expected hqpipe-log-map/1"),
    (("joint",), {}, "joint", "did you mean 'joints'"),
    (("joints",), {}, "joints", "at least one joint"),
    ((*HIP, "positon"), "q", "joints.hip.positon", "did you mean 'position'"),
    ((*HIP, "position", "unit"), "dge", "joints.hip.position.unit", "did you mean 'deg'"),
    ((*HIP, "position", "unit"), "Deg", "joints.hip.position.unit", "did you mean 'deg'"),
    ((*HIP, "position", "unit"), "bar", "joints.hip.position.unit", "bar is a unit of pressure, expected angle"),
    ((*HIP, "position", "unit"), "mm", "joints.hip", "mix a joint that turns with one that slides"),
    ((*HIP, "type"), "prismatik", "joints.hip.type", "did you mean 'prismatic'"),
    ((*HIP, "type"), "prismatic", "joints.hip", "its type is prismatic, its units are angular"),
    ((*HIP, "position", "unit"), "counts", "joints.hip.position.unit", "counts_per_turn"),
    ((*HIP, "position", "sgin"), -1, "joints.hip.position.sgin", "did you mean 'sign'"),
    ((*HIP, "position", "sign"), 2, "joints.hip.position.sign", "expected -1 to 1"),
    ((*HIP, "position", "sign"), 0, "joints.hip.position.sign", "expected 1 or -1"),
    ((*HIP, "position", "scale"), 0, "joints.hip.position.scale", "other than 0"),
    ((*HIP, "position", "field"), "", "joints.hip.position.field", "name of a field"),
    ((*HIP, "position"), {"sum": []}, "joints.hip.position.sum", "expected 1 to 8 elements"),
    ((*HIP, "pressure_b"), "pb", "joints", "joint 'hip' has pressure_b, joint 'knee' has not"),
    (("joints", "a/b"), {"position": "q"}, "joints.a/b", "is no name of a joint"),
    (("joints", "foot"), {"effort": "tau"}, "joints.foot", "has no position"),
    (("shared", "supply/presure"), "p", "shared.supply/presure", "did you mean 'supply/pressure'"),
    (("clock", "unit"), "deg", "clock.unit", "a unit of time"),
    (("clock", "unit"), "samples", "clock.unit", "rate_hz"),
    (("clock", "rate_hz"), 100, "clock.rate_hz", "belongs to unit: samples"),
    (("control_mode",), "positon", "control_mode", "did you mean 'position'"),
    (("trials", 0, "split"), "held", "trials[0].split", "did you mean 'heldout'"),
    (("trials", 0, "drive"), {"hipp": {}}, "trials[0].drive.hipp", "did you mean 'hip'"),
    (("load",), {"hip": {"mass_kg": "3"}}, "load.hip.mass_kg", "expected a number"),
]


@pytest.mark.parametrize(("path", "value", "field", "part"), WRONG)
def test_a_wrong_field_is_named(tmp_path, path, value, field, part):
    error = refused(tmp_path, changed(*path, value=value))
    assert error.field == field and part in str(error)


def test_a_unit_of_another_kind_needs_a_scale(tmp_path):
    error = refused(tmp_path, changed("joints", "hip", "effort", value={"field": "vir", "unit": "V"}))
    assert "V is a unit of voltage" in str(error) and "add scale: what one V is" in str(error)
    content = changed("joints", "hip", "effort", value={"field": "vir", "unit": "V", "scale": 35.15})
    (term,) = read_map(write_map(tmp_path / "map.yaml", content)).sources["joint/hip/effort"].terms
    assert term.scale == 35.15 and term.unit.kind == "voltage"


def test_damaged_files(tmp_path):
    path = write_map(tmp_path / "map.yaml", FULL)
    refuses_every(YAML_FILE, lambda: read_map(path), path, exit_code=1)


def test_every_damaged_field(tmp_path):
    path = write_map(tmp_path / "map.yaml", FULL)
    passed = survives_fields(FULL, write_yaml, lambda: read_map(path), path, exit_code=1)
    assert not {name for name in passed if name.endswith("misspelt") and name.startswith(("format", "clock.", "rate"))}


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (180.0, "deg", np.pi),
        (2.0, "inch", 0.0508),
        (1.0, "psi", 6894.757293),
        (1.0, "bar", 1e5),
        (60.0, "rpm", 2 * np.pi),
        (1.0, "kgf", 9.80665),
        (1.0, "lbf", 4.4482216153),
        (1.0, "ft·lbf", 1.3558179483),
        (1000.0, "N·mm", 1.0),
        (25.0, "°C", 25.0),
        (212.0, "°F", 100.0),
        (273.15, "K", 0.0),
        (7.0, "µs", 7e-6),
        (5.0, "%", 0.05),
        (36.0, "km/h", 10.0),
    ],
)
def test_units_by_their_definitions(value, unit, expected):
    assert to_si(np.array([value]), UNITS[unit])[0] == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_every_kind_has_its_si_unit():
    for kind, symbol in KINDS.items():
        assert UNITS[symbol].kind == kind and UNITS[symbol].factor == 1.0 and UNITS[symbol].zero == 0.0
