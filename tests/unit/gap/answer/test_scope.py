"""The scope of a cause follows from the joints that it lies in."""

from __future__ import annotations

from hqpipe.gap.answer.scope import scope_of

QUADRUPED = tuple(leg + part for leg in ("LF", "RF", "LH", "RH") for part in "RPK")


def test_scope():
    assert scope_of(QUADRUPED, QUADRUPED) == "machine"
    assert scope_of(QUADRUPED[:10], QUADRUPED) == "machine", "two may be too still to show it"
    assert scope_of(QUADRUPED[:9], QUADRUPED) == "group"
    assert scope_of(QUADRUPED[:1], QUADRUPED) == "joint"
    assert scope_of(("LFR",), ("LFR",)) == "joint", "one of one says nothing about a machine"
