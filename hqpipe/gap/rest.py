"""What the reference model predicts of the error that a machine leaves, where somebody asks."""

from __future__ import annotations

from functools import cached_property

from hqpipe.gap.reference import explain
from hqpipe.gap.replay import Replay
from hqpipe.gap.row_model import RowModel, replay_all
from hqpipe.logs.trajectory import LogSet


class Rest:
    """The error of a machine's model on the held-out trials.

    Args:
        machine: with its effects. log_set: fit and held-out trials. steps: samples per window.
    """

    def __init__(self, machine: RowModel, log_set: LogSet, steps: int) -> None:
        self._machine, self._log_set, self._steps = machine, log_set, steps

    @cached_property
    def _replays(self) -> tuple[list[Replay], list[Replay]]:
        fit, heldout = (
            replay_all(self._machine, trials, self._steps) for trials in (self._log_set.fit, self._log_set.heldout)
        )
        return fit, heldout

    def predictable(self, joint: str) -> float:
        """Share of a joint's squared error that logged signals predict, held out; 0 where they do not."""
        j = self._machine.joints.index(joint)
        found = explain(*self._replays, j, self._machine.memory[j])
        before = found.before.sum()
        return float(max(1.0 - found.after.sum() / before, 0.0)) if before > 0.0 else 0.0
