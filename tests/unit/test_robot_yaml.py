"""robot.yaml under every damage, and beside a URDF that it does not fit."""

from __future__ import annotations

import shutil

import pytest
import yaml
from damage import ANY_FILE, YAML_FILE, refused, refuses_every, survives_fields, survives_flips, write_yaml

from hqpipe.robots import load_robot, robot_folder

SHIPPED = robot_folder("hydraulic_quadruped")


@pytest.fixture
def folder(tmp_path):
    return shutil.copytree(SHIPPED, tmp_path / "mine")


@pytest.fixture
def content():
    return yaml.safe_load((SHIPPED / "robot.yaml").read_text(encoding="utf-8"))


def test_the_shipped_robot_passes_and_keeps_its_hash(folder):
    assert load_robot(folder).hash == load_robot("hydraulic_quadruped").hash


@pytest.mark.parametrize("damages", [ANY_FILE, YAML_FILE], ids=["any file", "yaml"])
def test_a_damaged_robot_yaml_is_refused(folder, damages):
    # Cut in the middle of the hydraulics it may be whole YAML: what lacks there is for the plant to say.
    elsewhere = ("missing", "a folder", "a link to itself", "cut at 0.5", "cut at 0.9")
    there = {name: damage for name, damage in damages.items() if name not in elsewhere}
    refuses_every(there, lambda: load_robot(folder), folder / "robot.yaml")


@pytest.mark.parametrize("name", ["missing", "a folder", "a link to itself"])
def test_a_folder_without_robot_yaml_is_no_robot(folder, name):
    path = folder / "robot.yaml"
    ANY_FILE[name](path)
    refused(lambda: load_robot(folder), folder)


def test_a_flipped_bit_is_refused_or_another_number(folder):
    survives_flips(lambda: load_robot(folder), folder / "robot.yaml")


def test_every_wrong_field_is_refused(folder, content):
    content["hydraulics"] = {}  # read by the plant
    write_yaml(folder / "robot.yaml", content)
    passed = survives_fields(content, write_yaml, lambda: load_robot(folder), folder / "robot.yaml")
    names = {name for name in passed if not name.endswith("= '0'")}  # a gain or an angle may be 0
    allowed = {"name = 'text'", "hydraulics = '{}'", "feet.0 missing", "nominal_position.knee = '-1'"}
    allowed |= {f"joint_limits.{kind}.lower = '-1'" for kind in ("roll", "pitch", "knee")}
    allowed |= {"joint_limits.knee.upper = '-1'"}
    assert names <= allowed, names - allowed


@pytest.mark.parametrize(
    ("change", "field", "words"),
    [
        ({"base_link": "trunc"}, "base_link", "no link 'trunc' in robot.urdf – did you mean 'trunk'"),
        ({"base_link": "LF_hip"}, "base_link", "expected the root of robot.urdf, 'trunk'"),
        ({"feet": ["LF", "RF", "LH", "RX"]}, "feet[3]", "no link 'RX_foot' in robot.urdf"),
        ({"feet": ["LF", "LF"]}, "feet", "'LF' stands twice"),
        ({"joints": []}, "joints", "expected 1 to 200 elements, got 0"),
        ({"urdf": "../mine/robot.urdf"}, "urdf", "no file '../mine/robot.urdf'"),
        ({"urdf": "/etc/passwd"}, "urdf", "no file '/etc/passwd'"),
        ({"urdf": "other.urdf"}, "urdf", "no file 'other.urdf'"),
        ({"urdf": "robot.urdf" * 1000}, "urdf", "no file 'robot.urdfrobot.urdf"),
        ({"name": "$\\frac{a}$"}, "name", "expected a name"),
        ({"name": "<b>robot</b>"}, "name", "expected a name"),
        ({"stiff_pd": {"kp": -1.0, "kd": 1.0}}, "stiff_pd.kp", "is -1, expected 0 to 1e+09 N·m/rad"),
        ({"stiff_pd": {"kp": 1.0}}, "stiff_pd.kd", "stiff_pd: missing field 'kd'"),
        ({"torque_pd": {"kp": 1.0, "kd": 1.0, "ki": 1.0}}, "torque_pd.ki", "torque_pd: unknown field 'ki'"),
        ({"nominal_height": 0.0}, "nominal_height", "is 0, expected 1e-06 to 100 m"),
        (
            {"hydraulics": {"chain": {"stiffness": "7.0e6"}}},
            "hydraulics.chain.stiffness",
            "write the exponent with a sign",
        ),
        (
            {"nominal_position": {"roll": 2.0, "pitch": 0.5, "knee": -1.0}},
            "nominal_position.roll",
            "LFR within its limits",
        ),
        ({"sprocket_raduis": 0.06}, "sprocket_raduis", "did you mean 'sprocket_radius'"),
    ],
)
def test_what_does_not_fit_is_named(folder, content, change, field, words):
    write_yaml(folder / "robot.yaml", content | change)
    error = refused(lambda: load_robot(folder), folder / "robot.yaml")
    assert error.field == field and words in str(error), (error.field, str(error))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("LFX", "no joint 'LFX' in robot.urdf – did you mean 'LF"),
        ("$\\frac$", "expected a name"),
        ("<script>", "expected a name"),
        (1, "the name 1 is no text"),
        ("RFR", "'RFR' stands twice"),
        ("LF_ankle", "'LF_ankle' is fixed in robot.urdf"),
    ],
)
def test_a_wrong_joint_is_named(folder, content, wrong, words):
    per_joint = {"joints": [wrong, *content["joints"][1:]]}
    for table in ("nominal_position", "joint_limits"):
        per_joint[table] = content[table] | {wrong: content[table]["roll"]}
    write_yaml(folder / "robot.yaml", content | per_joint)
    assert words in str(refused(lambda: load_robot(folder), folder / "robot.yaml"))


def test_a_joint_that_moves_must_be_listed(folder, content):
    write_yaml(folder / "robot.yaml", content | {"joints": content["joints"][1:]})
    error = refused(lambda: load_robot(folder), folder / "robot.yaml")
    assert error.field == "joints" and "'LFR' is missing, which moves in robot.urdf" in str(error)


@pytest.mark.parametrize(
    "limits", [{"lower": 1.0, "upper": 1.0}, {"velocity": 0.0}, {"effort": -5.0}, {"effort": 1e300}]
)
def test_impossible_limits_are_refused(folder, content, limits):
    content["joint_limits"]["roll"] |= limits
    write_yaml(folder / "robot.yaml", content)
    assert refused(lambda: load_robot(folder), folder / "robot.yaml").field.startswith("joint_limits.roll")
