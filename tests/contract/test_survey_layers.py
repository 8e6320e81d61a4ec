"""What `hqpipe logs check` says can be diagnosed is what the intake of the diagnosis takes."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from hqpipe.errors import IdentificationError
from hqpipe.gap.intake import take_in
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


CHANNELS = [[n for n, taken in zip(OPTIONAL, chosen, strict=True) if taken] for chosen in product([0, 1], repeat=4)]
"""Every choice of the optional channels."""


@pytest.mark.parametrize(
    ("mode", "channels"),
    # A log set is refused where it lacks the command of its control mode, and has a mode where it has a command.
    [(mode, each) for mode in COMMAND_OF for each in CHANNELS if COMMAND_OF[mode] in each]
    + [(None, []), (None, ["effort"])],
)
def test_layers_are_those_that_the_intake_takes(mode, channels):
    evaluated = {x.layer for x in layers(["position", "velocity", *channels], mode) if x.evaluated}
    try:
        intake = take_in(log_set(channels, mode), 0.1)
    except IdentificationError:
        assert evaluated == set()
        return
    only_sensing = any("only the sensing layer was evaluated" in reason for reason in intake.reasons)
    assert evaluated == ({"sensing"} if only_sensing else {"actuator", "sensing"})


def test_the_missing_columns_are_named():
    (position, torque, valve, sensing, *_) = layers(["position", "velocity", "position_command"], "position")
    assert position.missing == sensing.missing == ("joint/<name>/effort",)
    assert torque.missing == ("joint/<name>/effort_command", "joint/<name>/effort")
    assert valve.missing == ("joint/<name>/valve_command",)
