"""Which layers a log set is asked about, and what is said where two answer."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from layer_cases import layer_found, log_set, made_up, toy
from planted_logs import logs_of

import hqpipe.gap.diagnosis as diagnosis
from hqpipe.errors import IdentificationError, UsageError
from hqpipe.gap.answer.diagnosis_files import Diagnosis
from hqpipe.gap.change.since import EarlierLogs
from hqpipe.gap.layer_diagnosis import layer_diagnosis
from hqpipe.gap.routing import Route, route, route_since


@pytest.fixture(scope="module")
def logs():
    """Position mode, fixed base, torque of a load cell."""
    return logs_of([{}], seconds=2.0, joints=("LFR",))


def changed(logs, mode="position", source=None, base="fixed", **channels):
    trials = tuple(replace(t, trajectory=replace(t.trajectory, **channels)) for t in logs.trials)
    return replace(logs, trials=trials, control_mode=mode, effort_source=source, base=base)


SHAPE = np.zeros((2000, 1))


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"source": "load_cell"}, Route(True)),
        ({"source": "pressure"}, Route(True)),
        ({"source": "current"}, Route(False, ("joint_motion",))),
        ({"source": "estimate", "base": None}, Route(False, ("joint_motion",))),
        ({"source": "current", "base": "floating"}, Route(True)),
        ({}, Route(True, ("joint_motion",))),
        ({"effort": None}, Route(False, ("servo",))),
        ({"effort": None, "current": SHAPE}, Route(False, ("joint_motion", "servo"))),
        ({"mode": None, "position_command": None}, Route(False, ("joint_motion",))),
        ({"mode": None, "position_command": None, "base": "floating"}, Route(True)),
        ({"mode": "torque", "effort_command": SHAPE, "source": "current"}, Route(False, ("joint_motion",))),
        ({"mode": "torque", "effort_command": SHAPE, "source": "current", "base": None}, Route(False, ("torque",))),
        ({"mode": "torque", "effort_command": SHAPE, "source": "load_cell"}, Route(False, ("torque",))),
        (
            {"mode": "torque", "effort_command": SHAPE, "source": "load_cell", "base": "floating"},
            Route(False, ("torque",)),
        ),
        (
            {"mode": "torque", "effort_command": SHAPE, "source": "current", "base": "floating"},
            Route(False, ("torque",)),
        ),
        ({"mode": "valve", "valve_command": SHAPE, "effort": None}, Route(False, ("valve",))),
    ],
)
def test_route(logs, change, expected):
    assert route(changed(logs, **change)) == expected


def test_duty_and_supply_stand_for_the_command(logs):
    driven = changed(logs, mode=None, effort=None, position_command=None, duty=SHAPE)
    with pytest.raises(IdentificationError, match="no layer can be evaluated"):
        route(driven)
    assert route(changed(driven, mode=None, extra={"supply/voltage": np.zeros(2000)})) == Route(False, ("servo",))


def test_what_changed_is_asked_of_the_motion_where_the_command_is_a_torque(logs):
    torque = changed(logs, "torque", "load_cell", effort_command=SHAPE)
    assert route(torque) == Route(False, ("torque",)) and route_since(torque) == Route(False, ("joint_motion",))
    free = replace(torque, base="floating")
    assert route(free) == route_since(free) == Route(False, ("torque",)), "a joint of it moves by more than its torque"


def law(after, persistence=1.0):
    """An answer of the actuator layer with these sizes over the joints' spread."""
    made = layer_found(made_up(toy("hip", 0, seconds=6.0), 1.0, 1.0))
    content = layer_diagnosis(None, log_set([made.found[0].model]), made).content
    content["gap"]["layer"] = "actuator"
    content["gap"]["normalised"] |= {"after": after, "persistence": persistence}
    return Diagnosis(content, law=deepcopy(content["gap"]))


@pytest.mark.parametrize(("after", "blind"), [(0.3, False), (2.7, True)])
def test_the_law_predicts_nothing_where_it_errs_as_persistence(after, blind):
    assert diagnosis.errs_as_persistence(law(after)) == blind


def test_the_layer_answers_where_the_law_predicts_nothing():
    second = law(0.3)
    second.content["gap"]["layer"] = "joint_motion"
    content = diagnosis._in_its_place(law(2.7), second).content
    assert content["gap"]["layer"] == "joint_motion"
    assert [gap["layer"] for gap in content["gaps"]] == ["joint_motion", "actuator"]
    assert sum("it is not the law of this machine" in text for text in content["warnings"]) == 1


def test_earlier_logs_of_another_machine_are_refused(logs):
    servo = changed(logs, effort=None)
    other = replace(servo, joints=("KNEE",))
    with pytest.raises(UsageError, match="without 'LFR'"):
        diagnosis.diagnose(servo, earlier=EarlierLogs(other))
    with pytest.raises(UsageError, match="control modes position and valve"):
        diagnosis.diagnose(servo, earlier=EarlierLogs(replace(servo, control_mode="valve")))
