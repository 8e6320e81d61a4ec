"""Free runs of one record with one row of numbers after the other: what a change leaves as it was is not computed again."""

from __future__ import annotations

import numpy as np

from hqpipe.machine.layout import FIELDS
from hqpipe.machine.loops.augmented_columns import ALL, BEHIND, COMMAND, FOLLOW, K3, KI, VISCOUS
from hqpipe.machine.loops.augmented_errors import CHANGES, errors_of_windows
from hqpipe.machine.loops.augmented_output import grips
from hqpipe.machine.loops.augmented_signals import Signals, Work, make_work

_SETTINGS = np.array([owner == "setting" for owner, _ in FIELDS])
_RELAXING = [VISCOUS, BEHIND, K3]  # columns that the lag of a rubbing piston hangs on


class RepeatedRun:
    """The windows of one joint; not for several threads at a time."""

    def __init__(self, signals: Signals) -> None:
        self._signals = signals
        self._work: Work | None = None  # made by the first run: most joints that are tried are never run
        self._out = np.empty((0, 0))
        self._row: np.ndarray | None = None

    def errors(self, row: np.ndarray, velocity: np.ndarray, demand: np.ndarray, same: bool) -> np.ndarray:
        """(steps, W) what `residual_windows` gives; overwritten by the next call.

        Args:
            row: (WIDTH,). velocity, demand: (T,) of the signals. same: whether these are those of the call before.
        """
        signals = self._signals._replace(velocity=velocity, demand=demand)
        if self._work is None:
            self._work, self._out = make_work(signals), np.empty((signals.steps, len(signals.first)))
        inputs = ALL if self._row is None or not same else changed_inputs(self._row, row)
        self._row = None  # what a run that fails leaves is no start for the next
        self._work.held[:] = 0.0
        errors_of_windows(row, signals, self._work, self._out, inputs)
        self._row = row
        return self._out


def changed_inputs(before: np.ndarray, row: np.ndarray) -> int:
    """What has to be computed anew beside the core, see `hqpipe.machine.loops.augmented_windows.simulate`."""
    changed = before != row
    if np.any((before == 0.0) != (row == 0.0)) or np.any(changed & _SETTINGS):
        return ALL  # what an effect that was absent needs was not computed
    if row[BEHIND] != 0.0 and np.any(changed[_RELAXING]):
        return ALL
    inputs = int(np.bitwise_or.reduce(CHANGES[changed])) if changed.any() else 0
    if row[KI] != 0.0:
        inputs |= COMMAND | FOLLOW  # what the integrator holds at the start hangs on the core
    return inputs | FOLLOW if grips(row) else inputs
