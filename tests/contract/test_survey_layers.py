"""What `hqpipe logs check` says can be diagnosed is what the diagnosis asks."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from hqpipe.errors import IdentificationError
from hqpipe.gap.intake import take_in
from hqpipe.gap.routing import route
from hqpipe.logs.survey.layers import COMMAND_OF, layers
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

OPTIONAL = ("effort", "position_command", "effort_command", "valve_command")
TIME = np.arange(3000) * 1e-3


def log_set(channels, mode) -> LogSet:
    """Two trials of one joint that have these channels."""

    def trajectory(phase):
        command = 0.4 * np.sin(8.0 * TIME + phase)[:, None]
        position = 0.4 * np.sin(8.0 * TIME + phase - 0.2)[:, None]
        effort = 3000.0 * (command - position)
        signals = {"effort": effort, "position_command": command, "effort_command": effort, "valve_command": command}
        velocity = np.gradient(position[:, 0], 1e-3)[:, None]
        return Trajectory(TIME, ("hip",), position, velocity, **{name: signals[name] for name in channels})

    trials = tuple(Trial(f"{s}.parquet", s, None, trajectory(i)) for i, s in enumerate(("fit", "heldout")))
    return LogSet(Path("logs"), "", "hqpipe-log/1", None, None, mode, None, 1000.0, ("hip",), trials)


REPORTED = {"valve": "actuator", "torque": "actuator"}
"""Layer → its name in diagnosis.json, where that is another."""
CHANNELS = [[n for n, taken in zip(OPTIONAL, chosen, strict=True) if taken] for chosen in product([0, 1], repeat=4)]
"""Every choice of the optional channels."""


@pytest.mark.parametrize(
    ("mode", "channels"),
    # A log set is refused where it lacks the command of its control mode, and has a mode where it has a command.
    [(mode, each) for mode in COMMAND_OF for each in CHANNELS if COMMAND_OF[mode] in each]
    + [(None, []), (None, ["effort"])],
)
def test_layers_are_those_that_the_diagnosis_asks(mode, channels):
    evaluated = {x.layer for x in layers(["position", "velocity", *channels], mode) if x.evaluated} - {"sensing"}
    try:
        chosen = route(log_set(channels, mode))
    except IdentificationError:
        assert evaluated == set()
        return
    asked = [*(["actuator"] if chosen.actuator else []), *(REPORTED.get(name, name) for name in chosen.layers[:1])]
    assert evaluated == set(asked)
    if chosen.actuator:
        assert not any("only the sensing layer" in reason for reason in take_in(log_set(channels, mode), 0.1).reasons)


@pytest.mark.parametrize(
    ("source", "base", "extra", "evaluated"),
    [
        ("current", "fixed", (), True),
        ("estimate", None, (), True),
        ("pressure", "fixed", (), False),
        ("load_cell", None, (), False),
        ("current", "floating", (), False),
        ("current", None, ("foot/LF/contact",), False),
    ],
)
@pytest.mark.parametrize("mode", ["position", "torque"])
def test_motion_is_asked_where_the_torque_is_that_of_the_drive(mode, source, base, extra, evaluated):
    channels = ["effort", "position_command", "effort_command"]
    logs = replace(log_set(channels, mode), effort_source=source, base=base)
    more = {name: np.zeros(3000) for name in extra}
    trials = tuple(replace(t, trajectory=replace(t.trajectory, extra=more)) for t in logs.trials)
    found = layers(["position", "velocity", *channels], mode, extra=extra, base=base, effort_source=source)
    expected = evaluated and (mode == "position" or base == "fixed")
    assert any(x.layer == "joint_motion" and x.evaluated for x in found) == expected
    chosen = route(replace(logs, trials=trials))
    of_loop = ("torque",) if mode == "torque" and not expected else ()
    assert chosen.layers == (("joint_motion",) if expected else of_loop)
    assert chosen.actuator == (not expected and not of_loop)
    assert any(x.layer == "actuator" and x.evaluated for x in found) != expected


def test_the_missing_columns_are_named():
    (position, torque, valve, _, motion, sensing, *_) = layers(["position", "velocity", "position_command"], "position")
    assert motion.missing == position.missing == sensing.missing == ("joint/<name>/effort",)
    assert torque.missing == ("joint/<name>/effort_command", "joint/<name>/effort")
    assert valve.missing == ("joint/<name>/valve_command",)
