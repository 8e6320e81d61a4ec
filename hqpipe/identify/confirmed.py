"""What the held-out trials bear out of the causes that the fit trials ask for."""

from __future__ import annotations

import numpy as np

from hqpipe.identify.misfit import floor_of, misfit
from hqpipe.identify.search import Known, Search
from hqpipe.identify.thresholds import BORNE_OUT, LEAST_SHARE
from hqpipe.identify.worth_keeping import causes_of, is_admitted


def confirmed(search: Search, known: Known, base: Known) -> Known:
    """The set without causes that do not show in the held-out trials: a claim that they do not bear out is withdrawn, and with
    it what has no size without it.

    It has to close a share of their error, and `BORNE_OUT` of what it does to their prediction: a term that fits what the fit
    trials have by chance does as much to others, and closes little. They choose nothing else, and what is left is never made
    to look better by it.
    """
    if not len(search.model.heldout.trial):
        return known
    without_any = heldout_square(search, base)
    least = LEAST_SHARE * max(without_any - floor_of(search.model, True), 0.0)
    while causes := [name for name in causes_of(search, known, base) if name not in search.as_others]:
        closes, shown = {}, {}
        known, smaller = search.taken_apart(known, causes)
        with_all = heldout_square(search, known)
        for name in causes:
            closes[name] = heldout_square(search, smaller[name]) - with_all
            # What errs more than the base in all trials together is rejected even if it does well in most of them.
            usual = _usual_gain(search, smaller[name], known) if with_all < without_any else -1.0
            borne_out = closes[name] > least or usual > LEAST_SHARE
            borne_out &= _closed_of_done(search, smaller[name], known) >= BORNE_OUT
            if name in search.shared:
                borne_out |= closes[name] > 0.0 or usual > 0.0
            shown[name] = borne_out and is_admitted(search, known, name)
        name = min(causes, key=lambda name: (shown[name], closes[name]))
        if shown[name]:
            break
        known = search.without(known, name)
    return known


def _usual_gain(search: Search, small: Known, large: Known) -> float:
    """Share by which the squared error of a held-out trial grows without an effect, the geometric mean over the trials.

    In a trial where the machine does what it never does in the fit trials the error may be larger than in all others together,
    and says nothing of a cause that shows in these. Infinite if only the prediction without the effect overflows.
    """
    trial = search.model.heldout.trial
    present = np.bincount(trial) > 0
    with np.errstate(over="ignore", invalid="ignore"):
        squares = [np.bincount(trial, _heldout_error(search, k) ** 2) for k in (small, large)]
    if not np.isfinite(squares).all():
        return np.inf if np.isfinite(squares[1]).all() else -1.0
    small_squares, large_squares = (np.maximum(s[present], np.finfo(float).tiny) for s in squares)
    return float(np.expm1(np.mean(np.log(small_squares / large_squares))))


def _closed_of_done(search: Search, small: Known, large: Known) -> float:
    """What an effect takes off the squared error of the held-out trials, over the square of what it does to their prediction:
    of all together, or of the middle one, if that is more; see `_usual_gain` for why, and for predictions that overflow."""
    trial = search.model.heldout.trial
    with np.errstate(over="ignore", invalid="ignore"):
        without, error = _heldout_error(search, small), _heldout_error(search, large)
        closed, done = np.bincount(trial, without**2 - error**2), np.bincount(trial, (without - error) ** 2)
    if np.isfinite(error).all() and not np.isfinite(done).all():
        return np.inf
    if not (np.isfinite(closed).all() and done.any()):
        return -1.0
    return float(max(closed.sum() / done.sum(), np.median(closed[done > 0.0] / done[done > 0.0])))


def _heldout_error(search: Search, known: Known) -> np.ndarray:
    """(H,) of a set at the held-out samples."""
    return misfit(search.model, known.solution.values, True).copy()  # a model may use the array again


def heldout_square(search: Search, known: Known) -> float:
    if not len(search.model.heldout.trial):
        return 0.0
    error = _heldout_error(search, known)
    with np.errstate(over="ignore", invalid="ignore"):
        return float(error @ error)
