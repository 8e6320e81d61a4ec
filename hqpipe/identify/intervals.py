"""95 % intervals of the numbers of a fit, from five sources of error.

- Within trials: the scatter of correlated errors, see `hqpipe.identify.uncertainty`.
- Between trials: what differs from one trial to the next, as oil temperature or a law that is wrong in another way at another
  motion, is one observation a trial. Leaving out one trial at a time (the jackknife of Quenouille and Tukey) shows it; with few
  trials its Student factor is large.
- The law, in ways that have a name or a shape: how far the number moves if one more effect or generic shape is let in, weighed
  with its probability (Bayesian model averaging, Hoeting et al. 1999). What closes too little to be a cause is still a way in
  which the law is wrong.
- The law, in unknown ways: what is left above the noise is a part of the law that is missing, and the fit has taken up as much
  of it as looks like the numbers (Brynjarsdóttir and O'Hagan 2014).
- Tolerances: what a model knows to within a tolerance only, see `hqpipe.identify.tolerances`.

The first two have a Student factor each, the others that of a normal distribution. The half widths add up in squares, as those
of independent errors do, and so do the covariances behind them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqpipe.identify.beside import sets_beside
from hqpipe.identify.correlation import correlation_time
from hqpipe.identify.least_squares import Fitter, lengths
from hqpipe.identify.misfit import floor_of
from hqpipe.identify.model import STATES
from hqpipe.identify.normal_equations import NormalEquations
from hqpipe.identify.sampling import blocks
from hqpipe.identify.search import Known, Search
from hqpipe.identify.thresholds import BLOCK
from hqpipe.identify.tolerances import corrections
from hqpipe.identify.uncertainty import NORMAL, student, uncertainty

_FAR = 50.0  # ln of odds beyond which nothing changes
_PRIOR_HOLDS = (
    0.5  # of the variance beforehand, that samples leave at most if they say something of a number; assumption
)
_FEWEST_BLOCKS = (
    50  # so that no block decides a number where many samples tell it; what blocks share, the estimator sees
)
_SINGULAR = 1e-10  # of the largest eigenvalue: what the samples do not show stays as it is


def half_widths(search: Search, known: Known) -> np.ndarray:
    """(F,) of the 95 % intervals of the free parameters of a set; infinite where the prediction overflows.

    Call `rank_beside` before: what else the logs may ask for counts.
    """
    if not np.isfinite(known.solution.square):
        return np.full(len(known.solution.free), np.inf)
    return NORMAL * np.sqrt(np.diag(normal_covariance(search, known)))


def normal_covariance(search: Search, known: Known, fitted_only: bool = False) -> np.ndarray:
    """(F, F) covariance of the normal distribution of the free parameters whose 95 % intervals are those of `half_widths`.

    Call `rank_beside` before. The prediction must not overflow.

    Args:
        fitted_only: see `sets_beside`.
    """
    beside = sets_beside(search, known, fitted_only)
    errors = _within(search.fitter, known) + _between(search.fitter, known)
    return errors + _law(search, known, beside) + _unknown_law(search, known)


def corrected(search: Search, known: Known) -> tuple[np.ndarray, np.ndarray]:
    """(P,) values of a set as they are told, and (F,) half widths of the 95 % intervals of its free parameters, tolerances
    included.

    Call `rank_beside` before.
    """
    values, half = known.solution.values.copy(), half_widths(search, known)
    step, covariance = corrections(search, known)
    free = known.solution.free
    values[free] = np.clip(values[free] + step, search.fitter.low[free], search.fitter.high[free])
    return values, np.sqrt(half**2 + NORMAL**2 * np.diag(covariance))


def _within(fitter: Fitter, known: Known) -> np.ndarray:
    """(F, F) from errors that are correlated in time, block by block."""
    solution, samples = known.solution, fitter.model.fit
    length = min(BLOCK * correlation_time(solution.error, samples), len(solution.error) / _FEWEST_BLOCKS)
    block, all_of_them = blocks(samples, length), np.ones(len(solution.free), dtype=bool)
    at = NormalEquations.of(solution.jacobian, solution.error, block, int(block.max()) + 1, all_of_them)
    weight = known.covariance.alike * known.covariance.noise
    prior = weight * fitter.precision(solution.values, solution.free)
    found = uncertainty(at, all_of_them, np.stack([prior, weight * prior]))
    return _scaled(found.covariance, student(found.freedom) / NORMAL)


def _between(fitter: Fitter, known: Known) -> np.ndarray:
    """(F, F) from the scatter of fits without one of the trials.

    A fit says nothing of a number that the rest of the trials leave as uncertain as it was beforehand, as of one that only one
    trial shows; where fewer than two fits say something of a number, its scatter is not known and counts as 0.
    """
    solution, trial = known.solution, fitter.model.fit.trial
    present = np.unique(trial)
    if len(present) < 2:
        return np.zeros((len(solution.free), len(solution.free)))
    columns, error, values = solution.jacobian, solution.error, solution.values
    steps, seen = [], []
    for left_out in present:
        rest = trial != left_out
        step, shown = _step(fitter, known, solution.free, values, columns[rest], error[rest])
        steps.append(step)
        seen.append(shown)
    count = np.sum(seen, axis=0)
    mean = np.sum(np.where(seen, steps, 0.0), axis=0) / np.maximum(count, 1)
    away = np.where(seen, np.array(steps) - mean, 0.0)
    factor = student(count - 1.0) / NORMAL * np.sqrt(np.maximum(count - 1.0, 0.0) / np.maximum(count, 1))
    return _scaled(away.T @ away, np.where(count > 1, factor, 0.0))


def _law(search: Search, known: Known, beside: Sequence[Known]) -> np.ndarray:
    """(F, F) from sets with one effect or shape more."""
    free, values = known.solution.free, known.solution.values
    covariance = np.zeros((len(free), len(free)))
    for larger in beside:
        probability = 1.0 / (1.0 + np.exp(-np.clip(search.gain(larger, known), -_FAR, _FAR)))
        move = _share(search, known, larger) * (larger.solution.values - values)[free]
        covariance += probability * np.outer(move, move)
    return covariance


def _unknown_law(search: Search, known: Known) -> np.ndarray:
    """(F, F) from a function of the joint's state that no effect or shape describes.

    It is taken to be as large as what is left above the noise, and to differ from one of the `STATES` cells to the next. Of
    such a function one part in `STATES` points along any one direction, so that a number takes up that much of it. Errors show
    nothing of this part, and more data do not make it smaller.
    """
    left = max(known.solution.square - floor_of(search.model), 0.0)
    return left / STATES * known.covariance.naive / known.covariance.noise


def _scaled(covariance: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """(F, F) with each deviation multiplied by its factor (F,)."""
    return covariance * np.outer(factor, factor)


def _share(search: Search, known: Known, larger: Known) -> float:
    """How much of an effect more counts: all of one with a name, for what closes too little to be told may be there all the
    same; of a generic shape as much as is no larger than the error that it is to explain.

    A shape beyond that does not correct the law but divides it in another way, as a curve that takes the place of a straight
    line and its slope.
    """
    values, (added,) = known.solution.values.copy(), larger.names - known.names
    if search.effects[added].named:
        return 1.0
    place = search.screening.places(added)
    values[place] = larger.solution.values[place]
    change = search.fitter.error(values) - known.solution.error
    size = float(change @ change)
    return min(1.0, float(np.sqrt(known.solution.square / size))) if 0.0 < size < np.inf else 0.0


def _step(
    fitter: Fitter, known: Known, free: np.ndarray, values: np.ndarray, columns: np.ndarray, error: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(F,) of one step of least squares with priors, and (F,) whether the samples say more of a number than its prior."""
    noise = known.covariance.noise
    prior = known.covariance.alike * noise * fitter.precision(values, free)
    normal = columns.T @ columns + np.diag(prior)
    scale = lengths(normal)
    slope = (columns.T @ error + fitter.pull(values, free, noise)) / scale
    unit = normal / np.outer(scale, scale)
    step = -np.linalg.lstsq(unit, slope, rcond=_SINGULAR)[0] / scale
    variance = np.diag(np.linalg.pinv(unit, rcond=_SINGULAR, hermitian=True)) / scale**2
    return step, variance * prior < _PRIOR_HOLDS
