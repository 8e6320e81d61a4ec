"""The chain of a base model and its effects, compiled: windows of a log, one robot, and many robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numba import njit

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


SLOTS = 2  # results of a step along a log that are kept: a difference moves a number and puts it back


class Kept(NamedTuple):
    """What the results that are kept of each step along a log, S of them, were made from.

    Attributes:
        columns: (SLOTS, S, P) row of parameters. reads: (SLOTS, S, N) versions of the signals that it reads.
        version: (SLOTS, S) of what it writes; 0 where nothing is kept. used: (SLOTS, S) run in which it was used last.
        runs: (1,) how many there were.
    """

    columns: np.ndarray
    reads: np.ndarray
    version: np.ndarray
    used: np.ndarray
    runs: np.ndarray


class Work(NamedTuple):
    """Scratch of the windows of one record.

    Attributes:
        along: (SLOTS × S, T) signals along the log. states: (N, W) torque of the base and states behind it, before each window.
        laid: (SLOTS × L, steps + 1, W) signals in windows, side by side. lines: (B, W) what the windows work with.
        kept: what of it is known.
    """

    along: np.ndarray
    states: np.ndarray
    laid: np.ndarray
    lines: np.ndarray
    kept: Kept


class _Links(NamedTuple):
    """The steps along a log, S of them, in their order.

    Attributes:
        columns: (S, P) that each reads. when: (S, P) of which one is not 0 where it is present. always: (S,) whether it
            always is.
        reads, writes: (S, N) signals.
    """

    columns: np.ndarray
    when: np.ndarray
    always: np.ndarray
    reads: np.ndarray
    writes: np.ndarray


class _Plan(NamedTuple):
    """names: signal → its place among those of the links."""

    names: dict[str, int]
    links: _Links

    @classmethod
    def of(cls, plan: Sequence[tuple], columns: int) -> _Plan:
        """Args: plan: `PLAN` of a module of loops."""
        signals = {name for _, _, reads, writes in plan for name in (*reads, *writes)}
        names = {name: i for i, name in enumerate(sorted({*signals, *INPUTS, "raw_velocity"}))}
        count = len(plan)
        links = _Links(
            *(np.zeros((count, size), dtype=np.bool_) for size in (columns, columns)),
            np.array([not when for _, when, *_ in plan], dtype=np.bool_),
            *(np.zeros((count, size), dtype=np.bool_) for size in (len(names), len(names))),
        )
        for i, (own, when, reads, writes) in enumerate(plan):
            links.columns[i, list(own)], links.when[i, list(when)] = True, True
            links.reads[i, [names[name] for name in reads]] = True
            links.writes[i, [names[name] for name in writes]] = True
        return cls(names, links)


@njit(cache=True, nogil=True)
def _arranged(links: _Links, kept: Kept, row: np.ndarray, now: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`Loops.arranged`; now: (N,) versions of the signals, overwritten. A version that a step makes is below 0."""
    steps = links.always.shape[0]
    anew, slot = np.zeros(steps, np.bool_), np.zeros(steps, np.int64)
    kept.runs[0] += 1
    for i in range(steps):
        present = links.always[i]
        for c in range(row.shape[0]):
            present |= links.when[i, c] and row[c] != 0.0
        if not present:
            continue
        found = -1
        for k in range(SLOTS):
            same = kept.version[k, i] != 0
            for c in range(row.shape[0]):
                same &= not links.columns[i, c] or kept.columns[k, i, c] == row[c]
            for n in range(now.shape[0]):
                same &= not links.reads[i, n] or kept.reads[k, i, n] == now[n]
            if same:
                found = k
        if found < 0:
            found = np.argmin(kept.used[:, i])
            anew[i] = True
            kept.version[found, i] = -(kept.runs[0] * steps + i)
            kept.columns[found, i], kept.reads[found, i] = row, now
        slot[i], kept.used[found, i] = found, kept.runs[0]
        for n in range(now.shape[0]):
            if links.writes[i, n]:
                now[n] = kept.version[found, i]
    return anew, slot


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
        self._plan = _Plan.of(self._module.PLAN, len(chain.fields))

    def make_work(self, signals: Signals) -> Work:
        """Scratch for windows of `signals`, of which nothing is known."""
        m, samples, windows = self._module, len(signals.command), len(signals.first)
        plan, steps = self._plan, len(self._plan.links.always)
        return Work(
            np.zeros((SLOTS * m.SCRATCH, samples)),
            np.zeros((m.STATES, windows)),
            np.zeros((SLOTS * m.LAID, signals.steps + 1, windows)),
            np.zeros((m.LINES, windows)),
            Kept(
                np.zeros((SLOTS, steps, len(self.chain.fields))),
                np.zeros((SLOTS, steps, len(plan.names))),
                *(np.zeros((SLOTS, steps), dtype=np.int64) for _ in range(2)),
                np.zeros(1, dtype=np.int64),
            ),
        )

    def residual_windows(self, row: np.ndarray, signals: Signals) -> np.ndarray:
        """(steps, W) predicted less logged torque of every window; 0 where the target is NaN.

        Args:
            row: (P,) parameters, see hqpipe.machine.layout.
        """
        out = np.empty((signals.steps, len(signals.first)))
        self.fill_errors(row, signals, self.make_work(signals), out)
        return out

    def fill_errors(
        self,
        row: np.ndarray,
        signals: Signals,
        work: Work,
        out: np.ndarray,
        versions: Mapping[str, float] | None = None,
    ) -> None:
        """Fill `out` (steps, W) with what `residual_windows` gives; what `work` holds of earlier runs is not computed again.

        Args:
            versions: of inputs that were not always the same, see `arranged`.
        """
        anew, slot = self.arranged(row, work, versions or {})
        try:
            self._module.errors_of_windows(row, signals, work, out, anew, slot)
        except BaseException:
            work.kept.version[:] = 0  # what a run that fails leaves is no start for the next
            raise

    def arranged(self, row: np.ndarray, work: Work, versions: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """(S,) whether each step along a log has to be computed anew, and (S,) the slot of its result.

        Args:
            row: (P,) parameters. work: in which the results of the steps are then taken for made.
            versions: signal of the log, of `hqpipe.machine.signals.INPUTS` and `raw_velocity`, → a number from 0 on that says
                which of several it is; the others were the same in every run.
        """
        now = np.zeros(len(self._plan.names))
        for name, version in versions.items():
            now[self._plan.names[name]] = version
        return _arranged(self._plan.links, work.kept, row, now)

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
