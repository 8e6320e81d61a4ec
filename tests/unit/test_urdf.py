"""robot.urdf: whatever a simulator would choke on is named before one sees it."""

from __future__ import annotations

import shutil

import pytest
from damage import ANY_FILE, TEXT_FILE, refused, refuses_every, survives_flips

from hqpipe.robots import load_robot, robot_folder

SHIPPED = robot_folder("hydraulic_quadruped")
WRONG_NUMBERS = ("inf", "-inf", "nan", "1e300", "1" + "0" * 400, "text", "", "1 2", "1,0", "${mass}", "0x10")


@pytest.fixture
def folder(tmp_path):
    return shutil.copytree(SHIPPED, tmp_path / "mine")


def refused_with(folder, *changes):
    path = folder / "robot.urdf"
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text, encoding="utf-8")
    return refused(lambda: load_robot(folder), path)


@pytest.mark.parametrize("damages", [ANY_FILE, TEXT_FILE], ids=["any file", "text"])
def test_a_damaged_urdf_is_refused(folder, damages):
    there = {
        name: damage for name, damage in damages.items() if name not in ("missing", "a folder", "a link to itself")
    }
    refuses_every(there, lambda: load_robot(folder), folder / "robot.urdf")


def test_a_flipped_bit_is_refused_or_another_number(folder):
    survives_flips(lambda: load_robot(folder), folder / "robot.urdf")


@pytest.mark.parametrize("number", WRONG_NUMBERS)
@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ('mass value="208"', 'mass value="{}"', "link trunk: mass"),
        ('ixx="5.07"', 'ixx="{}"', "link trunk: inertia"),
        ('ixy="0"', 'ixy="{}"', "link trunk: inertia"),
        ('origin xyz="0.62 0.26 -0.06"', 'origin xyz="0.62 {} -0.06"', "joint LFR: origin"),
        ('origin xyz="0 0 0"', 'origin xyz="0 0 0" rpy="0 {} 0"', "link trunk: inertial: origin"),
        ('axis xyz="1 0 0"', 'axis xyz="{} 0 0"', "joint LFR: axis"),
        ('lower="-0.7"', 'lower="{}"', "joint LFR: limit"),
        ('upper="0.7"', 'upper="{}"', "joint LFR: limit"),
        ('effort="950"', 'effort="{}"', "joint LFR: limit"),
        ('velocity="11"', 'velocity="{}"', "joint LFR: limit"),
        ('box size="1.85 0.50 0.34"', 'box size="1.85 {} 0.34"', "link trunk: visual: box"),
        ('sphere radius="0.05"', 'sphere radius="{}"', "link LF_foot: visual: sphere"),
    ],
)
def test_a_number_without_physical_sense_is_refused(folder, old, new, field, number):
    assert refused_with(folder, (old, new.format(number))).field == field


@pytest.mark.parametrize(
    ("old", "new", "field", "words"),
    [
        ('mass value="208"', 'mass value="-1"', "link trunk: mass", "value is '-1', expected a number from 1e-06"),
        ('mass value="208"', 'mass value="0"', "link trunk: mass", "value is '0'"),
        ('<mass value="208"/>', "", "link trunk", "no <mass>"),
        ('mass value="208"', "mass", "link trunk: mass", "no value"),
        ('ixx="5.07"', 'ixx="-5.07"', "link trunk: inertia", "expected all of at least 1e-12"),
        ('ixx="5.07"', 'ixx="1e-320"', "link trunk: inertia", "expected all of at least 1e-12"),
        ('ixx="5.07"', 'ixx="90"', "link trunk: inertia", "none larger than the other two together"),
        ('ixy="0"', 'ixy="50"', "link trunk: inertia", "expected all of at least 1e-12"),
        ('axis xyz="1 0 0"', 'axis xyz="0 0 0"', "joint LFR: axis", "is zero, expected a direction"),
        ('axis xyz="1 0 0"', 'axis xyz="1 0"', "joint LFR: axis", "expected 3 numbers"),
        ('lower="-0.7"', 'lower="0.7"', "joint LFR: limit", "expected lower below upper"),
        ('effort="950"', 'effort="0"', "joint LFR: limit", "expected a number above 0"),
        ('velocity="11"', 'velocity="-11"', "joint LFR: limit", "expected a number above 0"),
        ('name="LFP" type="revolute"', 'name="LFR" type="revolute"', "joint LFR", "stands twice"),
        ('link name="LF_hip"', 'link name="trunk"', "link trunk", "stands twice"),
        ('link name="LF_hip"', 'link name="$x$"', "link 2", "expected a letter, then letters"),
        ('name="LFR" type="revolute"', 'name="LFR" type="revolut"', "joint LFR", "did you mean 'revolute'"),
        ('name="LFR" type="revolute"', 'name="LFR" type="floating"', "joint LFR", "expected one of revolute"),
        ('parent link="LF_hip"', 'parent link="LF_hib"', "joint LFP: parent", "did you mean 'LF_hip'"),
        ('parent link="trunk"', 'parent link="LF_foot"', "joint LFR", "is part of a loop"),
        ('<child link="RF_hip"/>', '<child link="LF_hip"/>', "link LF_hip", "is the child of two joints, LFR and RFR"),
        ('<box size="1.85 0.50 0.34"/>', '<bax size="1 1 1"/>', "link trunk: visual: geometry", "did you mean 'box'"),
        ('<box size="1.85 0.50 0.34"/>', "", "link trunk: visual: geometry", "expected one shape, got 0"),
        (
            '<box size="1.85 0.50 0.34"/>',
            '<mesh filename="a.stl"/>',
            "link trunk: visual: mesh",
            "'a.stl', but the simulators get",
        ),
        ('<box size="1.85 0.50 0.34"/>', '<mesh filename="../../etc/passwd"/>', "link trunk: visual: mesh", "passwd"),
        ("<robot", "<model", None, "not XML"),
    ],
)
def test_what_is_no_robot_is_named(folder, old, new, field, words):
    error = refused_with(folder, (old, new))
    assert error.field == field and words in str(error), (error.field, str(error))


def test_another_document_is_refused(folder):
    error = refused_with(folder, ("<robot", "<mujoco"), ("</robot>", "</mujoco>"))
    assert "the outermost element is <mujoco>, expected <robot>" in str(error)


def test_two_trees_are_refused(folder):
    import re

    path = folder / "robot.urdf"
    path.write_text(re.sub(r'<joint name="LFR".*?</joint>', "", path.read_text(encoding="utf-8")), encoding="utf-8")
    assert "2 links without a parent (trunk, LF_hip)" in str(refused(lambda: load_robot(folder), path))


def test_a_link_without_mass_is_refused(folder):
    import re

    path = folder / "robot.urdf"
    text = re.sub(r"<inertial>.*?</inertial>", "", path.read_text(encoding="utf-8"), count=1)
    path.write_text(text, encoding="utf-8")
    assert "link trunk: no <inertial>" in str(refused(lambda: load_robot(folder), path))


@pytest.mark.parametrize(
    "content",
    [
        "<robot>" + "<a>" * 10_000 + "</a>" * 10_000 + "</robot>",
        "<robot>" + "<a/>" * 60_000 + "</robot>",
        "<robot/>",
        '<robot name="a"><link/></robot>',
        '<robot name="a"><joint name="b"/></robot>',
    ],
    ids=["deep", "many", "no links", "no name", "a joint alone"],
)
def test_other_xml_is_refused(folder, content):
    (folder / "robot.urdf").write_text(content, encoding="utf-8")
    refused(lambda: load_robot(folder), folder / "robot.urdf")


def test_entities_are_refused_before_they_grow(folder):
    laughs = "".join(f'<!ENTITY l{n} "{f"&l{n - 1};" * 10}">' for n in range(1, 10))
    head = f'<!DOCTYPE robot [<!ENTITY l0 "ha">{laughs}]><robot name="&l9;"/>'
    (folder / "robot.urdf").write_text(head, encoding="utf-8")
    assert "holds a DOCTYPE" in str(refused(lambda: load_robot(folder), folder / "robot.urdf"))


def test_a_file_of_the_machine_cannot_be_included(folder):
    text = '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="&x;"/>'
    (folder / "robot.urdf").write_text(text, encoding="utf-8")
    assert "holds a DOCTYPE" in str(refused(lambda: load_robot(folder), folder / "robot.urdf"))
