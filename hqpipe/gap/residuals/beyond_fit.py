"""Held-out trials in which the machine does what it does in no fit trial: errors there come from motion that no fit saw."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.gap.residuals.layer_errors import JudgedJoint
from hqpipe.identify.model import Samples
from hqpipe.logs.findings import listed
from hqpipe.logs.joint_kinds import unit_of
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial, recording_of

MARGIN = 0.2  # of the largest value in the fit trials, beyond which another law may hold; assumption
MOST_OF_IT = 0.5  # of a trial's error, and
COUNTS = 0.1  # of the error of all trials, from which a trial is told: less would not change the stated gap by 5 %
SPEED, TRAVEL, TOGETHER = "speed", "travel from the middle", "all joints together"
_UNITS = {SPEED: "rad/s", TRAVEL: "rad"}


@dataclass(frozen=True)
class BeyondFit:
    """A held-out trial, and a line that says what it does."""

    file: str
    text: str


@dataclass(frozen=True, eq=False)
class _Beyond:
    """Of one joint in one held-out trial.

    Attributes:
        left, beyond: squared error over the joint's scale that is left in all, and in blocks beyond the fit trials.
        by: signal → (its largest value here, in the fit trials).
    """

    file: str
    joint: str
    left: float
    beyond: float
    by: dict[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class _Together:
    """Recording → (time, speed of all joints together, each over its usual speed), of either split."""

    fit: dict[str, tuple[np.ndarray, np.ndarray]]
    heldout: dict[str, tuple[np.ndarray, np.ndarray]]

    @classmethod
    def of(cls, log_set: LogSet) -> _Together:
        """Of all joints that move in the fit trials."""
        speeds = [_speeds(trial.trajectory) for trial in log_set.fit]
        usual = np.sqrt(np.mean(np.concatenate(speeds) ** 2, axis=0))
        weight = np.divide(1.0, usual, out=np.zeros_like(usual), where=usual > 0.0)
        return cls(*(_joined(trials, weight) for trials in (log_set.fit, log_set.heldout)))


def _joined(trials: Sequence[Trial], weight: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Recording → (time, speed) of its sections one after the other; weight: (J,) of each joint's speed."""
    parts: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for trial in trials:
        t = trial.trajectory
        parts.setdefault(recording_of(trial), []).append((t.time - t.time[0] + t.start, _speeds(t) @ weight))
    ordered = {file: sorted(sections, key=lambda part: part[0][0]) for file, sections in parts.items()}
    return {
        file: (np.concatenate([time for time, _ in sections]), np.concatenate([speed for _, speed in sections]))
        for file, sections in ordered.items()
    }


def _speeds(t: Trajectory) -> np.ndarray:
    """(T, J)"""
    return np.abs(t.velocity if t.velocity is not None else np.gradient(t.position, t.dt, axis=0))


def _signals(samples: Samples, middle: float) -> dict[str, np.ndarray]:
    """(N,) each; middle: of the positions in the fit trials."""
    return {SPEED: np.abs(samples.velocity), TRAVEL: np.abs(samples.position - middle)}


def beyond_fit(log_set: LogSet, joints: Sequence[JudgedJoint], window_s: float) -> list[BeyondFit]:
    """Held-out trials most of whose error lies where the fit trials never were.

    Args:
        joints: with their causes. window_s: an error is made within that time before it shows.
    """
    together = _Together.of(log_set)
    found = [part for joint in joints if joint.heldout for part in _of_joint(together, joint, window_s)]
    whole, told = sum(part.left for part in found), []
    for file in dict.fromkeys(part.file for part in found):
        parts = [part for part in found if part.file == file]
        left, beyond = (sum(getattr(part, name) for part in parts) for name in ("left", "beyond"))
        if left > 0.0 and beyond >= MOST_OF_IT * left and left >= COUNTS * whole:
            told.append(BeyondFit(file, _line(log_set, file, parts, beyond / left)))
    return told


def _line(log_set: LogSet, file: str, parts: Sequence[_Beyond], share: float) -> str:
    counts = Counter(name for part in parts for name in part.by)
    signal = max(counts, key=lambda name: (counts[name], name))
    shown = [part for part in parts if signal in part.by]
    names = listed(list(dict.fromkeys(part.joint for part in shown)))
    most = max(shown, key=lambda part: part.by[signal][0] / max(part.by[signal][1], 1e-300))
    here, then = most.by[signal]
    if signal == TOGETHER:
        what = f"all joints together move up to {here / max(then, 1e-300):.1f} times as fast as in any fit trial"
    else:
        unit = unit_of(_UNITS[signal], log_set.kinds.get(most.joint))
        what = f"{names} leave the {signal} of the fit trials ({most.joint} {here:.3g} {unit}, there {then:.3g} {unit} at most)"
    return (
        f"{file}, held out: {what}; {share:.0%} of the error that is left in it lies in such moments. No fit has seen them, "
        "so that effects which act only there cannot be named"
    )


def _of_joint(together: _Together, joint: JudgedJoint, window_s: float) -> Iterator[_Beyond]:
    fit, heldout = joint.found.model.fit, joint.samples
    square = (joint.error(joint.found.named) / joint.scale) ** 2
    middle = 0.5 * float(fit.position.max() + fit.position.min())
    limits = {name: float(values.max()) for name, values in _signals(fit, middle).items()}
    limits[TOGETHER] = max(float(speed.max()) for _, speed in together.fit.values())
    for number, file in enumerate(heldout.files):
        here = heldout.trial == number
        if not here.any():
            continue
        signals = {name: values[here] for name, values in _signals(heldout, middle).items()}
        if file in together.heldout:  # sections of a recording may go by names of their own
            signals[TOGETHER] = np.interp(heldout.time[here], *together.heldout[file])
        block = np.floor(heldout.time[here] / window_s).astype(np.int64)
        beyond, by = np.zeros(int(here.sum()), dtype=bool), {}
        for name, values in signals.items():
            out = np.isin(block, block[values > (1.0 + MARGIN) * limits[name]])
            if out.any():
                by[name] = float(values.max()), limits[name]
            beyond |= out
        yield _Beyond(file, joint.name, float(square[here].sum()), float(square[here][beyond].sum()), by)
