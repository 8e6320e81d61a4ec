"""The error that a machine's model leaves on logs, and what the reference model predicts of it."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from hqpipe.gap.reference import Explained, explain
from hqpipe.gap.replay import Replay
from hqpipe.gap.row_model import RowModel, replay_all
from hqpipe.logs.trajectory import LogSet


class Rest:
    """Worked out where somebody asks, and once.

    Args:
        machine: with its effects. log_set: fit and held-out trials. steps: samples per window.
    """

    def __init__(self, machine: RowModel, log_set: LogSet, steps: int) -> None:
        self.machine, self._log_set, self._steps = machine, log_set, steps
        self._explained: dict[int, Explained] = {}

    def of(self, machine: RowModel) -> Rest:
        """The same logs under another model of the machine; what is known of joints that are the same in both is kept."""
        other, changed = Rest(machine, self._log_set, self._steps), {*machine.spans, *self.machine.spans}
        for j, explained in self._explained.items():
            same = np.array_equal(machine.rows[j], self.machine.rows[j], equal_nan=True)
            if same and j not in changed:
                other._explained[j] = explained
        return other

    @cached_property
    def fit(self) -> list[Replay]:
        """The fit trials."""
        return replay_all(self.machine, self._log_set.fit, self._steps)

    @cached_property
    def heldout(self) -> list[Replay]:
        """The held-out trials."""
        return replay_all(self.machine, self._log_set.heldout, self._steps)

    def explained(self, j: int) -> Explained:
        """What the reference model says of joint `j`."""
        if j not in self._explained:
            self._explained[j] = explain(self.fit, self.heldout, j, self.machine.memory[j])
        return self._explained[j]

    def predictable(self, joint: str) -> float:
        """Share of a joint's squared error that logged signals predict, held out; 0 where they do not."""
        found = self.explained(self.machine.joints.index(joint))
        before = found.before.sum()
        return float(max(1.0 - found.after.sum() / before, 0.0)) if before > 0.0 else 0.0
