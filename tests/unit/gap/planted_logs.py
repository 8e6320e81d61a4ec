"""Log sets with planted effects, and the joints of them as the fits want them."""

from __future__ import annotations

import sys
from pathlib import Path

from hqpipe.gap.accuse import output_noise
from hqpipe.gap.joint_data import JointData, joint_data
from hqpipe.logs.trajectory import LogSet

sys.path.insert(0, str(Path(__file__).parents[2] / "recovery"))
import planted_effects as planted

STEPS = 100
TYPICAL = planted.TYPICAL
logs_of = planted.logs_of


def size(*names: str) -> dict[str, dict[str, float]]:
    """Effects at their typical size."""
    return {name: TYPICAL[name] for name in names}


def data_of(log_set: LogSet, j: int = 0, steps: int = STEPS) -> JointData:
    """One joint of a log set."""
    fit, heldout = ([t.trajectory for t in trials] for trials in (log_set.fit, log_set.heldout))
    return joint_data(fit, heldout, j, "position", steps, output_noise(heldout, j, "position"))
