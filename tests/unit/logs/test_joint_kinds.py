"""Which joints slide: logset.yaml, a URDF, and the units that follow."""

from __future__ import annotations

import pytest

from hqpipe.errors import LogError
from hqpipe.logs.joint_kinds import completed, from_urdf, unit_of
from hqpipe.logs.manifest import Manifest, TrialEntry, read_manifest, write_manifest

HEAD = "format: hqpipe-log/1\n"
TRIALS = "trials:\n- {file: a.parquet, split: fit}\n"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "a.parquet").write_bytes(b"")
    return tmp_path


def manifest(folder, joints):
    path = folder / "logset.yaml"
    path.write_text(f"{HEAD}joints: {joints}\n{TRIALS}", encoding="utf-8")
    return read_manifest(path, ["a.parquet"])


def test_a_manifest_names_the_joints_that_slide(folder):
    assert manifest(folder, "{boom: {type: prismatic}}").kinds == {"boom": "prismatic"}
    assert read_back(folder) == {"boom": "prismatic", "swing": "revolute"}


def read_back(folder):
    path = folder / "logset.yaml"
    kinds = {"boom": "prismatic", "swing": "revolute"}
    write_manifest(path, Manifest((TrialEntry("a.parquet", "fit"),), kinds=kinds))
    return read_manifest(path, ["a.parquet"]).kinds


@pytest.mark.parametrize(
    ("joints", "field", "message"),
    [
        ("[boom]", "joints", "expected the joints by name"),
        ("{boom: prismatic}", "joints.boom", "expected {type: prismatic}"),
        ("{boom: {}}", "joints.boom.type", "expected one of revolute, prismatic"),
        ("{boom: {type: prismtic}}", "joints.boom.type", "prismatic"),
        ("{boom: {kind: prismatic}}", "joints.boom.kind", "unknown field"),
    ],
)
def test_a_wrong_entry_is_named(folder, joints, field, message):
    with pytest.raises(LogError, match=message) as error:
        manifest(folder, joints)
    assert error.value.field == field and error.value.fix


def test_joints_that_are_not_named_turn_where_some_are():
    assert completed({"boom": "prismatic"}, ("swing", "boom")) == {"swing": "revolute", "boom": "prismatic"}
    assert completed({}, ("swing", "boom")) == {}


def test_a_urdf_says_it_of_all_joints_or_of_none():
    types = {"swing": "continuous", "boom": "prismatic", "hook": "fixed"}
    assert from_urdf(types, ("swing", "boom")) == {"swing": "revolute", "boom": "prismatic"}
    assert from_urdf(types, ("swing", "hook")) == {} == from_urdf(types, ("swing", "bucket"))


@pytest.mark.parametrize(
    ("turns", "slides"), [("N·m", "N"), ("rad/s", "m/s"), ("N·m/rad", "N/m"), ("s", "s"), ("1", "1")]
)
def test_units_of_joints_that_slide(turns, slides):
    assert unit_of(turns, "prismatic") == slides and unit_of(turns, "revolute") == unit_of(turns, None) == turns


def test_every_unit_of_an_effect_is_known_for_joints_that_slide():
    from hqpipe.machine import EFFECTS

    for effect in EFFECTS.values():
        for parameter in effect.parameters:
            rotary = "rad" in parameter.unit or "N·m" in parameter.unit
            assert (unit_of(parameter.unit, "prismatic") != parameter.unit) == rotary, parameter.unit
