"""How long the windows of the free run should be, from the fit trials alone and without a model.

A window must be long beside the joints' response, or the logged output that it starts from explains it and any model looks
right; and short beside the log, or there are too few of them. 100 ms suit a hydraulic leg at 1 kHz; at 25 Hz they hold two
samples.

The response of a joint is how far back its inputs reach: the output is regressed on the means of the inputs over bins of
the past, and the past is long enough where a longer one explains no more. Outputs are targets only, so that their noise, and
disturbances that the inputs know nothing of, do not lengthen the answer, as they would in an autoregression.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.identify.free_run import WINDOW_S
from hqpipe.logs.end_stops import at_end_stop
from hqpipe.logs.survey.signal import difference_noise
from hqpipe.logs.trajectory import LogSet, Trajectory

LEAST_SAMPLES = 10  # in a window; assumption: fewer are hardly more than one step ahead
FEWEST_SAMPLES = 4  # where ten would leave too few windows; assumption
MIN_WINDOWS = 20  # of each split, as hqpipe.gap.checks.sanity asks for
LADDER = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0)
"""Windows that are tried, over the shortest one; the last is the furthest past that is looked at."""
NEARER = (0.25, 0.5, 0.75)  # pasts that are looked at beside, likewise
OPEN = 0.05
"""Of the output's variance: an older past that explains less is no part of the response; 5 %, as of the usual settling time. It
also has to explain something in every fold, for motions repeat, and in a short log the far past foretells the near one."""
SETTLED = 2.0
"""Of that past: 5 % of the variance are 22 % of an amplitude, and what decays exponentially takes twice as long to 5 %."""
KNOWN = 0.5  # of the output's variance that its inputs must explain to say anything of the response; assumption
ABOVE_NOISE = 1.5  # error of holding the output over that which noise alone makes; assumption
LEAST_KEPT = 0.5  # of the fit trials must have the whole past before them; assumption
ROWS_PER_COLUMN = 10  # of the regression; assumption
FOLDS = 5  # stretches of the fit trials, one of them predicted from the others at a time
FINER = 0.98  # steps in which the longest windows are looked for
MOST_ROWS = 4000  # per joint: more of a correlated signal say no more
RIDGE = 1e-6  # of the mean diagonal, against bins that are the same
_INPUTS = {"position": "position_command", "torque": "effort_command"}


@dataclass(frozen=True)
class WindowChoice:
    """Length of the windows, s, and why."""

    seconds: float
    reason: str


def window_for(log_set: LogSet, given: float | None) -> WindowChoice:
    """The windows that were asked for, or those that suit the logs."""
    return WindowChoice(given, "as given") if given is not None else choose_window(log_set)


def choose_window(log_set: LogSet) -> WindowChoice:
    """The shortest windows that hold ten samples, show the joints' response and rise above the noise.

    Args:
        log_set: only its fit trials are looked at, and of the others how long they are.

    Returns:
        At least `WINDOW_S`; if longer, so that it leaves `MIN_WINDOWS` in the fit and in the held-out trials.
    """
    dt = max(trial.trajectory.dt for trial in log_set.trials)
    shortest, reason = WINDOW_S, f"longer than the joints take to respond, and {LEAST_SAMPLES} samples or more"
    if _longer(LEAST_SAMPLES * dt, shortest):
        shortest, reason = _digits(LEAST_SAMPLES * dt), f"{LEAST_SAMPLES} samples at {1.0 / dt:.4g} Hz"
    most = max(_longest(log_set), FEWEST_SAMPLES * dt, WINDOW_S)
    if _longer(shortest, most):
        return WindowChoice(_digits(most), f"of longer ones the trials hold fewer than {MIN_WINDOWS} ({reason})")
    seconds, longer = _shown(log_set, [w for f in LADDER if (w := _digits(shortest * f)) <= max(most, shortest)])
    return WindowChoice(seconds, longer if _longer(seconds, shortest) else reason)


def _shown(log_set: LogSet, windows: Sequence[float]) -> tuple[float, str]:
    """The first of `windows` that shows the joints' response above the noise, s, and what it was chosen for."""
    mode, trials = log_set.control_mode, [trial.trajectory for trial in log_set.fit]
    if mode not in _INPUTS or not trials or any(getattr(trials[0], name) is None for name in ("effort", _INPUTS[mode])):
        return windows[0], ""
    pasts = [*(windows[0] * part for part in NEARER), *windows]
    settled = [SETTLED * reach(trials, j, mode, pasts) for j in range(len(log_set.joints))]
    slowest = int(np.argmax(settled))
    seconds, reason = windows[0], f"{log_set.joints[slowest]} takes {1e3 * settled[slowest]:.0f} ms to respond"
    if _longer(settled[slowest], seconds):
        seconds = min(_digits(settled[slowest]), windows[-1])
        if settled[slowest] > seconds:
            reason += f", and of longer ones the trials hold fewer than {MIN_WINDOWS}"
    clear = _above_noise(trials, [w for w in windows if w >= seconds])
    if clear is not None and _longer(clear, seconds):
        return clear, "in shorter ones the outputs change by no more than their noise"
    return seconds, reason


def reach(trials: Sequence[Trajectory], j: int, mode: str, pasts: Sequence[float]) -> float:
    """The shortest of `pasts`, s, within which a joint's inputs explain its output as well as those of any longer one do.

    Args:
        trials: with the channels of the control mode. pasts: s, rising.

    Returns:
        The first one where the past says nothing of the output, or where the trials are too short for any other.
    """
    whole = sum(t.duration for t in trials)
    pasts = [w for w in pasts if sum(max(t.duration - w, 0.0) for t in trials) >= LEAST_KEPT * whole]
    if len(pasts) < 2:
        return (pasts or [WINDOW_S])[0]
    edges, bins = _edges(trials[0].dt, pasts)
    past, present, target = _rows(trials, j, mode, edges)
    columns = past.shape[1] * past.shape[2] + present.shape[1]
    if len(target) < ROWS_PER_COLUMN * columns or not target.std() > 0.0:
        return pasts[0]
    left = np.array([_left(past[:, :count], present, target) for count in bins]) / float(target.var())
    if left.sum(axis=1).min() > 1.0 - KNOWN:
        return pasts[0]
    for i, past_s in enumerate(pasts):
        fall = left[i] - left[i + 1 :]
        if not np.any((fall.sum(axis=1) > OPEN) & (fall > 0.0).all(axis=1)):
            return past_s
    return pasts[-1]


def _edges(dt: float, pasts: Sequence[float]) -> tuple[np.ndarray, list[int]]:
    """Edges of the bins of the past in samples, doubling up to the shortest past, and how many bins each of the pasts has."""
    first = round(pasts[0] / dt)
    doubling = [2**n for n in range(1, 64) if 2**n <= 0.75 * first]
    edges = [0, 1, *doubling, *(round(w / dt) for w in pasts)]
    inner = len(edges) - len(pasts) - 1
    return np.array(edges), [inner + 1 + n for n in range(len(pasts))]


def _rows(
    trials: Sequence[Trajectory], j: int, mode: str, edges: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means of the inputs over the bins of the past (N, B, inputs), what stands beside them (N, S), and the output (N,)."""
    every = max(1, sum(t.samples for t in trials) // MOST_ROWS)
    past, present, target = [], [], []
    for t in trials:
        at = np.arange(edges[-1], t.samples, every)
        marks = at_end_stop(t)
        at = at if marks is None else at[~marks[at, j]]
        if len(at):
            sums = np.concatenate([np.zeros((1, 2)), np.cumsum(_inputs(t, j, mode), axis=0)])
            bins = sums[at[:, None] - edges[None, :-1]] - sums[at[:, None] - edges[None, 1:]]
            past.append(bins / np.diff(edges)[None, :, None])
            present.append(np.column_stack([np.ones(len(at)), t.position[at, j]]))
            target.append(t.effort[at, j])
    if not target:
        return np.zeros((0, len(edges) - 1, 2)), np.zeros((0, 2)), np.zeros(0)
    return np.concatenate(past), np.concatenate(present), np.concatenate(target)


def _inputs(t: Trajectory, j: int, mode: str) -> np.ndarray:
    """(T, 2) what drives the joint: the command or its error, and the speed."""
    command = getattr(t, _INPUTS[mode])[:, j]
    return np.column_stack([command - t.position[:, j] if mode == "position" else command, t.velocity[:, j]])


def _left(past: np.ndarray, present: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(FOLDS,) part of the mean squared error of the output, each stretch predicted from the others by ridge regression."""
    x = np.column_stack([past.reshape(len(past), -1), present])
    x = x / (np.sqrt(np.mean(x**2, axis=0)) + 1e-300)
    fold = np.arange(len(x)) * FOLDS // len(x)
    grams = [x[fold == f].T @ x[fold == f] for f in range(FOLDS)]
    sides = [x[fold == f].T @ target[fold == f] for f in range(FOLDS)]
    gram, side, square = sum(grams), sum(sides), np.zeros(FOLDS)
    for f in range(FOLDS):
        ridge = RIDGE * len(x) * np.eye(x.shape[1])
        theta = np.linalg.solve(gram - grams[f] + ridge, side - sides[f])
        square[f] = np.sum((target[fold == f] - x[fold == f] @ theta) ** 2)
    return square / len(x)


def _above_noise(trials: Sequence[Trajectory], windows: Sequence[float]) -> float | None:
    """The shortest window over which most joints' outputs change by more than their noise; None if none does."""
    outputs = [t.effort for t in trials]
    noise = np.array([difference_noise([y[:, j] for y in outputs]) for j in range(outputs[0].shape[1])])
    for window in windows:
        steps = [round(part * window / trials[0].dt) for part in (0.25, 0.5, 0.75, 1.0)]
        changes = [y[step:] - y[:-step] for y in outputs for step in steps if 0 < step < len(y)]
        if not changes:
            return None
        held = np.sqrt(np.mean(np.concatenate(changes) ** 2, axis=0))
        if np.mean(held > ABOVE_NOISE * np.sqrt(2.0) * noise) >= 0.5:
            return window
    return None


def _longest(log_set: LogSet) -> float:
    """The longest windows of which each split holds `MIN_WINDOWS`, s."""
    found = []
    for trials in (log_set.fit, log_set.heldout):
        lengths = [trial.trajectory.duration for trial in trials]
        options = [sum(lengths) / MIN_WINDOWS * FINER**n for n in range(500)]
        found += [next(w for w in options if sum(int(x / w) for x in lengths) >= MIN_WINDOWS)] if sum(lengths) else []
    return min(found, default=WINDOW_S)


def _longer(a: float, b: float) -> bool:
    """Whether a length is more than a rounding error above another."""
    return a > 1.001 * b


def _digits(seconds: float) -> float:
    return float(f"{seconds:.3g}")
