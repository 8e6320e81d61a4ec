"""The chain of a base model and its effects, compiled: windows of a log, one robot, and many robots."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from hqpipe.machine.compose.build import loops_of
from hqpipe.machine.compose.wiring import Chain
from hqpipe.machine.layout import WIRING
from hqpipe.machine.signals import INPUTS

BLOCK = 384  # joints (32 quadrupeds): measured; the columns in use of a block stay in the cache


class Signals(NamedTuple):
    """One joint over several trials, end to end; SI units, (T,) each unless stated.

    Attributes:
        command, position, velocity, effort: rad, rad, rad/s, N·m.
        time: s since the trial's start.
        demand: flow that all joints draw from the supply, counted in rad/s.
        bounds: (trials + 1,) first sample of each trial, and the end.
        first: (W,) first sample of each window.
        steps: samples that a window predicts.
        target: (steps + 1, W) logged effort; NaN where it was not recorded, never in row 0.
    """

    command: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    time: np.ndarray
    demand: np.ndarray
    bounds: np.ndarray
    first: np.ndarray
    steps: int
    target: np.ndarray


class Work(NamedTuple):
    """Scratch of the windows of one record.

    Attributes:
        along: (S, T) signals along the log. states: (N, T) torque of the base and states behind it.
        laid: (L, steps + 1, W) signals in windows, side by side. lines: (B, W) what the windows work with.
    """

    along: np.ndarray
    states: np.ndarray
    laid: np.ndarray
    lines: np.ndarray


class Loops:
    """The compiled loops of a chain.

    Attributes:
        chain: the wiring. memory: M, how many numbers a joint of a simulator remembers.
        step_row: advances the joints of one robot by one sample, in place: (J, P) rows of parameters, (J,) torque, (J, M)
            memory (zeros before the first sample), (J,) commanded position, position and speed.
        step_batch: the same for the joints of many robots that lie end to end: what `prepare` returns, (n,) torque, (M, n)
            memory, (n,) commanded position, position and speed, and the joints of a robot.
    """

    def __init__(self, chain: Chain) -> None:
        self.chain, self._module = chain, loops_of(chain)
        self.memory: int = self._module.MEMORY
        self.step_row, self.step_batch = self._module.step_row, self._module.step_batch

    def make_work(self, signals: Signals) -> Work:
        """Scratch for windows of `signals`."""
        m, samples, windows = self._module, len(signals.command), len(signals.first)
        return Work(
            np.zeros((m.SCRATCH, samples)),
            np.zeros((m.STATES, samples)),
            np.zeros((m.LAID, signals.steps + 1, windows)),
            np.zeros((m.LINES, windows)),
        )

    def residual_windows(self, row: np.ndarray, signals: Signals) -> np.ndarray:
        """(steps, W) predicted less logged torque of every window; 0 where the target is NaN.

        Args:
            row: (P,) parameters, see hqpipe.machine.layout.
        """
        out = np.empty((signals.steps, len(signals.first)))
        self.fill_errors(row, signals, self.make_work(signals), out, self.changed(None, row))
        return out

    def fill_errors(self, row: np.ndarray, signals: Signals, work: Work, out: np.ndarray, anew: np.ndarray) -> None:
        """Fill `out` (steps, W) with what `residual_windows` gives.

        Args:
            anew: of `changed`, since the row with which `work` was last filled.
        """
        self._module.errors_of_windows(row, signals, work, out, anew)

    def changed(self, before: np.ndarray | None, row: np.ndarray) -> np.ndarray:
        """(S,) whether each step along a log has to be computed anew, as it hangs on what differs between two rows.

        Args:
            before, row: (P,) parameters; no `before`: everything that is present.
        """
        plan = self._module.PLAN
        anew = np.zeros(len(plan), dtype=np.bool_)
        now, then = (row != 0.0).tolist(), [False] * len(row)
        differs, moved = (row == row).tolist(), set(INPUTS)
        if before is not None:
            differs, then, moved = (before != row).tolist(), (before != 0.0).tolist(), set()
        some = any(differs)
        for i, (columns, when, reads, writes, always) in enumerate(plan):
            present, was = (not when or any(flags[c] for c in when) for flags in (now, then))
            anew[i] = present and (
                not was or any(differs[c] for c in columns) or not moved.isdisjoint(reads) or (always and some)
            )
            if anew[i] or present != was:
                moved.update(writes)
        return anew

    def prepare(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """What `step_batch` needs of a table, repeated for as many robots as a block holds.

        Args:
            parameters: (J, P).

        Returns:
            (P, B) parameters, (C, B) what follows from them, bool links that some joint has, and bool delays that are as many
            whole samples in all joints.
        """
        m, p = self._module, parameters.T
        derived = np.empty((m.CONSTANTS + 2 * len(m.DELAYS), len(parameters)))
        for j, row in enumerate(parameters):
            column = np.empty(m.CONSTANTS)
            m.derive(np.ascontiguousarray(row), column)
            derived[: m.CONSTANTS, j] = column
        dt = p[self.chain.column("setting", "sample_time")]
        alike = np.ones(len(m.DELAYS), dtype=np.bool_)
        for i, column in enumerate(m.DELAYS):
            lag = np.clip(p[column] / dt, 0.0, m.RING - 2.0)
            whole = np.floor(lag)
            derived[m.CONSTANTS + 2 * i], derived[m.CONSTANTS + 2 * i + 1] = whole, lag - whole
            alike[i] = np.all(whole == whole[0])
        on = np.array([not columns or np.any(p[list(columns)] != 0.0) for columns in m.FLAGS], dtype=np.bool_)
        robots = max(1, BLOCK // len(parameters))
        return np.tile(p, robots), np.tile(derived, robots), on, alike


@cache
def loops() -> Loops:
    """The loops of the paper's law with all effects."""
    return Loops(WIRING)


def residual_windows(row: np.ndarray, signals: Signals) -> np.ndarray:
    """`Loops.residual_windows` of the paper's law with all effects."""
    return loops().residual_windows(row, signals)
