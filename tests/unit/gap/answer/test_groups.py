"""Groups are read off the joints' names."""

from __future__ import annotations

from hqpipe.gap.answer.groups import groups, scope_of

QUADRUPED = tuple(leg + part for leg in ("LF", "RF", "LH", "RH") for part in "RPK")


def test_quadruped_has_legs_and_kinds():
    found = groups(QUADRUPED)
    assert len(found) == 7
    assert found[:3] == [tuple(leg + part for leg in ("LF", "RF", "LH", "RH")) for part in "RPK"], "the largest first"
    assert ("LFR", "LFP", "LFK") in found and ("RHR", "RHP", "RHK") in found


def test_words_are_grouped_by_the_first_and_the_last():
    found = groups(("knee_left", "knee_right", "hip_left", "hip_right"))
    assert set(found) == {
        ("knee_left", "knee_right"),
        ("hip_left", "hip_right"),
        ("knee_left", "hip_left"),
        ("knee_right", "hip_right"),
    }


def test_a_group_is_neither_one_joint_nor_all():
    assert groups(("LFR", "LFP")) == []
    assert groups(("a", "b", "c")) == []
    assert groups(("LFR", "LFP", "XYZ")) == [("LFR", "LFP")]
    assert groups(()) == []


def test_scope():
    assert scope_of(QUADRUPED, QUADRUPED) == "machine"
    assert scope_of(QUADRUPED[:10], QUADRUPED) == "machine", "two may be too still to show it"
    assert scope_of(QUADRUPED[:9], QUADRUPED) == "group"
    assert scope_of(QUADRUPED[:1], QUADRUPED) == "joint"
    assert scope_of(("LFR",), ("LFR",)) == "joint", "one of one says nothing about a machine"
