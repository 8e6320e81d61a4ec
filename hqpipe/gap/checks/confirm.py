"""Whether a defect matters: the second opinion, by comparing models, before anything is left out for it.

The checks of `hqpipe.gap.checks.sanity` know no actuator, and can be wrong: a controller with an integrator, or a valve at its
stop, pulls away from its command for seconds, which looks like a flipped sign; a slow machine repeats its samples. A
defect costs something only if the answer would be another without it. The base model is fitted to the logs as they are
and to what they would be without the defect:

- where it can be repaired, to the repaired logs;
- where it shows in some rows, to the windows without those rows: if they matter, they are far worse than the others;
- where no sample resembles the one before it, to the same rows in random orders: if they are as good in one, theirs is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.gap.checks.base_fit import BaseFit
from hqpipe.gap.checks.defect import Defect
from hqpipe.gap.checks.repair import repairs
from hqpipe.gap.checks.signs import with_signs
from hqpipe.logs.columns import COMMAND_CHANNEL
from hqpipe.logs.trajectory import LogSet, Trajectory

SIGMAS = 3.0  # of the difference of two fits' errors, by the jackknife: less may be chance
BLOCKS = 16  # of the jackknife
FEW = 8  # windows: fewer have no scatter, and no fit of their own
BETTER = 0.7  # of the squared error that the other rows, or joined-up samples, must leave at most; assumption
RAN_AWAY = 10.0  # × the output's mean square: a window that is worse says no more than that; assumption
SEED, ORDERS = 0, 6  # of the random orders; two fits to noise differ by more than their windows tell
TAKEN = ("too_short",)  # no question of the model


def confirmed(defect: Defect, log_set: LogSet, steps: int, signless: Sequence[str] = ()) -> bool:
    """Whether the logs without the defect would give another answer.

    Args:
        defect: of the log set. log_set: with the channels of its control mode. steps: samples per window.
        signless: joints whose effort has no sign in `log_set`. It is restored in whatever is compared: the sign comes from the
            command of its row, and would make an order of any if it were shuffled along with the rows.
    """
    if defect.kind in TAKEN or not used(defect, log_set):
        return True
    logged = defect.channel == "velocity"
    joints = defect.joints or log_set.joints
    columns = [log_set.joints.index(joint) for joint in joints]
    windows = _Windows.of(log_set, columns, steps, logged, signless)
    if not any(len(fit.first) for fit in windows.fits):
        return True  # no window is left to tell
    if repaired := repairs(defect, log_set):
        inside = [np.isin(fit.windows.trial, _indices(windows.files, defect.trials)) for fit in windows.fits]
        as_is = windows.errors()
        ratio = BETTER if defect.kind == "held_samples" else 1.0
        options = [_Windows.of(option, columns, steps, logged, signless).errors() for option in repaired]
        return any(_fell(option, as_is, inside, ratio) for option in options)
    if defect.rows:
        return _stand_out(defect, log_set, windows, joints)
    return defect.kind != "rows_out_of_order" or not _ordered(defect, log_set, columns, steps, logged, signless)


def used(defect: Defect, log_set: LogSet) -> bool:
    """Whether the models of the control mode read a channel that the defect is in."""
    channels = {COMMAND_CHANNEL[log_set.control_mode], "position", "effort", "velocity"}
    return bool(channels & set(defect.channels or (defect.channel or "position",)))


@dataclass(frozen=True, eq=False)
class _Windows:
    """The windows of some joints.

    Attributes:
        files: of the trials that hold a window. fits: of each joint; none where no trial holds one.
    """

    files: list[str]
    fits: list[BaseFit]

    @classmethod
    def of(
        cls, log_set: LogSet, columns: Sequence[int], steps: int, logged_speed: bool, signless: Sequence[str] = ()
    ) -> _Windows:
        log_set = with_signs(log_set, signless) if signless else log_set
        kept = [trial for trial in log_set.trials if trial.trajectory.samples > steps]
        parts = [trial.trajectory for trial in kept]
        fits = [BaseFit.of(parts, j, log_set.control_mode, steps, logged_speed) for j in columns if parts]
        return cls([trial.file for trial in kept], fits)

    def errors(self) -> list[np.ndarray]:
        """Per joint (W,) squared error of the base model fitted to all windows, in units of the output's mean square."""
        return [_in_units(fit.errors(), fit) for fit in self.fits]

    def errors_fitted_to(self, kept: list[np.ndarray]) -> list[np.ndarray]:
        """Likewise of every window, with the model fitted to some of them."""
        return [_in_units(fit.errors(some), fit) for fit, some in zip(self.fits, kept, strict=True)]


def _in_units(errors: np.ndarray, fit: BaseFit) -> np.ndarray:
    if not len(errors):
        return errors
    return np.minimum(errors / (fit.mean_square + np.finfo(float).tiny), RAN_AWAY)


def _fell(new: list[np.ndarray], old: list[np.ndarray], inside: list[np.ndarray], ratio: float) -> bool:
    """Whether errors fell in all, and for certain in the trials that have the defect or in those that it spoils.

    Args:
        new, old: per joint (W,). inside: per joint (W,) windows of the trials that have it. ratio: see `_less`.
    """
    if not np.mean([a.sum() / (b.sum() + np.finfo(float).tiny) for a, b in zip(new, old, strict=True)]) < ratio:
        return False
    for part in (inside, [~here for here in inside]):
        if all(here.any() for here in part):
            cut = [[errors[here] for errors, here in zip(side, part, strict=True)] for side in (new, old)]
            if _less(*cut, ratio):
                return True
    return False


def _indices(files: list[str], wanted: Sequence[str]) -> list[int]:
    return [i for i, file in enumerate(files) if file in wanted]


def _less(new: list[np.ndarray], old: list[np.ndarray], ratio: float = 1.0) -> bool:
    """Whether errors fell for certain, to less than `ratio` of what they were, in the mean over the joints.

    The jackknife is one of (new − old)/(new + old), which no single window of an impact can carry away, as it can a logarithm.

    Args:
        new, old: per joint (W,).
    """
    least = (ratio - 1.0) / (ratio + 1.0)
    terms = []
    for a, b in zip(new, old, strict=True):
        parts = np.array_split(np.arange(len(a)), BLOCKS)
        sums = np.array([[values[part].sum() for part in parts] for values in (a, b)])
        after, before = sums.sum(axis=1, keepdims=True) - sums
        terms.append((after - before) / (after + before + np.finfo(float).tiny))
    fall = np.mean(terms, axis=0)  # (BLOCKS,) without one block each
    if min(len(errors) for errors in new) < FEW:
        return bool(fall.mean() < min(least, (BETTER - 1.0) / (BETTER + 1.0)))
    error = np.sqrt((BLOCKS - 1) * np.mean((fall - fall.mean()) ** 2))
    return bool(fall.mean() < least - SIGMAS * error)


def _stand_out(defect: Defect, log_set: LogSet, windows: _Windows, joints: Sequence[str]) -> bool:
    """Whether a model of the windows that hold none of the defect's rows is far worse in those that do."""
    lengths = {trial.file: trial.trajectory.samples for trial in log_set.trials}
    touched = []
    for joint, fit in zip(joints, windows.fits, strict=True):
        first, last = fit.first, fit.first + fit.windows.samples + 1
        inside = np.zeros(len(first), dtype=bool)
        for i, file in enumerate(windows.files):
            rows = defect.rows.get((file, joint), defect.rows.get((file, None)))
            if rows is None:
                continue
            before = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=lengths[file]))])
            mine = fit.windows.trial == i
            inside[mine] = before[np.minimum(last[mine], lengths[file])] > before[first[mine]]
        touched.append(inside)
    if any((~inside).sum() < FEW for inside in touched):
        return True  # nothing sound is left to fit
    if not any(inside.any() for inside in touched):
        return False
    errors = windows.errors_fitted_to([~inside for inside in touched])
    ratio = [
        e[~t].mean() / (e[t].mean() + np.finfo(float).tiny) for e, t in zip(errors, touched, strict=True) if t.any()
    ]
    return bool(np.mean(np.log(np.array(ratio) + np.finfo(float).tiny)) < np.log(BETTER))


def _ordered(
    defect: Defect, log_set: LogSet, columns: Sequence[int], steps: int, logged: bool, signless: Sequence[str]
) -> bool:
    """Whether the model fits the trials with the defect better than the same rows in a random order."""
    rng = np.random.default_rng(SEED)
    names = (defect.channel,) if defect.channel else tuple(log_set.trials[0].trajectory.channels())
    some = replace(log_set, trials=tuple(t for t in log_set.trials if t.file in defect.trials))
    as_is = _Windows.of(some, columns, steps, logged, signless).errors()
    if not as_is:
        return False
    chance = []
    for _ in range(ORDERS):
        trials = tuple(replace(t, trajectory=_mixed(t.trajectory, names, rng)) for t in some.trials)
        random = _Windows.of(replace(some, trials=trials), columns, steps, logged, signless).errors()
        if not _less(as_is, random):
            return False
        chance.append(_logarithm(random))
    return _logarithm(as_is) < np.mean(chance) - SIGMAS * np.std(chance, ddof=1)


def _logarithm(errors: list[np.ndarray]) -> float:
    """Of the mean error, mean over the joints."""
    return float(np.mean([np.log(e.mean() + np.finfo(float).tiny) for e in errors]))


def _mixed(t: Trajectory, names: Sequence[str], rng: np.random.Generator) -> Trajectory:
    order = rng.permutation(t.samples)
    return replace(t, **{name: getattr(t, name)[order] for name in names})
