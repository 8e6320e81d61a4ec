"""Signals that are made anew only where a share has changed are those that are made from the record, and are told apart."""

from __future__ import annotations

import numpy as np
import pytest
from position_loop_logs import planted_logs

from hqpipe.layers.actuator import Actuator
from hqpipe.layers.actuator.driven_signals import DrivenSignals

SHARES = [
    (0.0, 0.0, ()),
    (0.5, 0.0, ()),
    (0.5, 0.3, (0.2, 0.7)),
    (0.5, 0.3, (0.2, 0.1)),
    (0.0, 0.3, (0.0, 0.1)),
    (0.0, 0.0, (0.0, 0.0)),
]


@pytest.fixture(scope="module")
def record():
    return Actuator().joints(planted_logs({}, {}, seconds=3.0, fit=2)).models[0].records[0]


def test_they_are_those_of_the_record_after_any_change(record):
    driven = DrivenSignals(record)
    for shares in [*SHARES, *reversed(SHARES)]:
        found, expected = driven.by(shares), record.driven_by(*shares)
        for name in ("velocity", "demand", "command", "position", "effort", "time"):
            assert np.array_equal(getattr(found, name), getattr(expected, name)), (shares, name)


def test_a_share_moves_the_versions_of_its_own_signals_alone(record):
    driven = DrivenSignals(record)
    before = driven.versions
    driven.by((0.5, 0.0, ()))
    moved = {name for name, version in driven.versions.items() if version != before[name]}
    assert moved == {"raw_velocity", "velocity", "sliding"}


def test_each_play_beside_each_command_has_a_version_of_its_own(record):
    driven, found = DrivenSignals(record), []
    for share, half_play in [(0.0, 0.01), (0.0, 0.02), (0.4, 0.01), (0.0, 0.01)]:
        driven.by((0.0, 0.0, (share, 0.0)))
        found.append(driven.versions_inside(0.0, half_play)["command"])
    assert len(set(found[:3])) == 3
    assert found[3] == found[0]
    assert driven.versions_inside(0.0, 0.0)["command"] == 0.0
    assert driven.versions_inside(0.1, 0.0)["time"] != driven.versions_inside(0.0, 0.0)["time"]
