"""Whether mending a defect of the wiring really helps the model: the second opinion before a log is refused.

The checks of `hqpipe.gap.sanity` know no actuator. A controller with an integrator, or a valve at its stop, can pull
away from its command for seconds, which looks like a flipped sign; but then the base model fits the log as it is better
than the mended one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hqpipe.gap.defect import Defect
from hqpipe.gap.joint_data import COMMAND_CHANNEL, joint_data
from hqpipe.gap.set_fit import JointFitter
from hqpipe.logs.trajectory import LogSet, Trajectory

WIRING = ("swapped", "sign_flipped")
BETTER = 0.7  # of the squared error that mending must leave at most; assumption


def confirmed(defect: Defect, log_set: LogSet, steps: int) -> bool:
    """Whether the base model fits the mended channels better, for a defect of the wiring; others are taken as found."""
    mode = log_set.control_mode
    used = (COMMAND_CHANNEL[mode], "position", "effort")
    if defect.kind not in WIRING or defect.channel not in used or not defect.joints:
        return True
    columns = [log_set.joints.index(joint) for joint in defect.joints]
    if defect.kind == "swapped":
        turns = range(1, len(columns))
        options = [(columns, columns[turn:] + columns[:turn], 1.0) for turn in turns]
    else:
        options = [(columns, columns, -1.0)]
    as_is = _loss(log_set, columns, steps, mode)
    return any(
        _loss(_mended(log_set, defect, *option), columns, steps, mode) < as_is + len(columns) * np.log(BETTER)
        for option in options
    )


def _mended(log_set: LogSet, defect: Defect, to: list[int], source: list[int], sign: float) -> LogSet:
    def mend(t: Trajectory) -> Trajectory:
        values = getattr(t, defect.channel).copy()
        values[:, to] = sign * getattr(t, defect.channel)[:, source]
        return replace(t, **{defect.channel: values})

    trials = tuple(
        replace(trial, trajectory=mend(trial.trajectory)) if trial.file in defect.trials else trial
        for trial in log_set.trials
    )
    return replace(log_set, trials=trials)


def _loss(log_set: LogSet, columns: list[int], steps: int, mode: str) -> float:
    """Summed logarithm of the base model's loss in all trials."""
    trials = [t.trajectory for t in log_set.trials if t.trajectory.samples > steps]
    data = [joint_data(trials, trials, j, mode, steps, 0.0) for j in columns]
    return float(sum(np.log(JointFitter(d).fit().loss + 1e-300) for d in data))
