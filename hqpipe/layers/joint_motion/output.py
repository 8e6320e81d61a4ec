"""The measured torque of a joint, or its motor current: the output that is predicted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hqpipe.logs.drive import of_joint
from hqpipe.logs.joint_kinds import PRISMATIC, unit_of
from hqpipe.logs.trajectory import LogSet

STANDARD_GRAVITY = 9.80665  # m/s², ISO 80000-3
NEWTON_METRE, AMPERE = "N·m", "A"
CONSTANT = "torque_constant"  # of `hqpipe.logs.drive`


@dataclass(frozen=True, eq=False)
class Output:
    """Attributes:
    kind: "revolute", "prismatic" or None where nobody says it.
    unit: N·m, N or A. values: (T,) of each trial of the log set.
    moment: N·m, gravity of a stated load at a right angle, and inertia: kg·m², of it; 0 where none is stated.
    notes: where the unit comes from.
    """

    kind: str | None
    unit: str
    values: tuple[np.ndarray, ...]
    moment: float
    inertia: float
    notes: tuple[str, ...]

    @property
    def turns(self) -> bool:
        """A joint of unknown kind is taken for one that turns, as the format does: gravity's sine and cosine over a small
        travel are a line and a parabola, which do no harm to one that slides."""
        return self.kind != PRISMATIC

    def unit_of(self, unit: str) -> str:
        """The unit of a joint that turns as that of this output: kg·m² is N·m·s²/rad, and A in place of N·m without a
        torque constant."""
        stated = unit_of("N·m·s²/rad" if unit == "kg·m²" and self.unit == AMPERE else unit, self.kind)
        if self.unit != AMPERE:
            return stated
        torque = unit_of(NEWTON_METRE, self.kind)
        return AMPERE + stated.removeprefix(torque) if stated.startswith(torque) else stated

    def scaled(self, factor: float, note: str) -> Output:
        """In N·m (N) instead of A, with `factor` N·m/A."""
        unit = unit_of(NEWTON_METRE, self.kind)
        return replace(self, unit=unit, values=tuple(factor * v for v in self.values), notes=(note,))


def has_output(log_set: LogSet) -> bool:
    """Whether a torque or a motor current was recorded."""
    first = log_set.trials[0].trajectory
    return first.effort is not None or first.current is not None


def output_of(log_set: LogSet, joint: str) -> Output:
    """The torque if it was recorded, else the current, times the torque constant if that is stated."""
    kind = log_set.kinds.get(joint)
    first = log_set.trials[0]
    j = first.trajectory.joint(joint)
    load, drive, differing = _stated(log_set, joint)
    lever, mass, arm = (load.get(name, 0.0) for name in ("lever_m", "mass_kg", "arm_mass_kg"))
    moment = (mass + 0.5 * arm) * lever * STANDARD_GRAVITY if kind != PRISMATIC else 0.0  # the arm a uniform rod
    inertia = (mass + arm / 3.0) * lever**2
    unit, notes, factor = unit_of(NEWTON_METRE, kind), (), 1.0
    torque = first.trajectory.effort is not None
    if torque and log_set.effort_source == "current":
        notes = ("the torque is computed from motor current: an error of its torque constant scales all numbers alike",)
    elif not torque and CONSTANT in drive:
        factor = drive[CONSTANT]
        notes = (f"torque is current times the stated torque constant, {factor:g} N·m/A",)
    elif not torque:
        unit = AMPERE
        notes = (
            "no torque constant is known (drive: torque_constant): inertia, friction and gravity are stated as motor "
            "current, in A per unit, and only their ratios are those of the joint",
        )
    channel = [t.trajectory.effort if torque else t.trajectory.current for t in log_set.trials]
    values = tuple(factor * np.asarray(c[:, j], dtype=float) for c in channel)
    return Output(kind or None, unit, values, moment, inertia, (*notes, *differing))


def _stated(log_set: LogSet, joint: str) -> tuple[dict[str, float], dict[str, float], tuple[str, ...]]:
    """Load and drive as stated alike of all trials, for one model holds for all; and a sentence on what differs."""
    loads = [of_joint(trial.load, joint) for trial in log_set.trials]
    drives = [of_joint(trial.drive, joint) for trial in log_set.trials]
    notes = []
    if any(load != loads[0] for load in loads):
        loads = [{}]
        notes.append(
            "the stated load differs between the trials: it is not used, and inertia and gravity are means over them"
        )
    if any(drive.get(CONSTANT) != drives[0].get(CONSTANT) for drive in drives):
        drives = [{}]
        notes.append("the stated torque constant differs between the trials: it is not used")
    return loads[0], drives[0], tuple(notes)
