"""How much more probable the logs are with some parameters than without them.

For a set of effects and a smaller one, the logarithm of the Bayes factor by Laplace's method (Kass and Raftery 1995) is

    ln B = ½ c ΔRSS/σ² + ½ ln det(2π V) + Σ ln p(θ)

with ΔRSS what the parameters take off the squared error, σ² the variance of the errors left, V the posterior covariance of the
parameters and p a Cauchy prior as wide as their spread (half of it where a bound lies at neutral). c turns the likelihood of
independent samples into that of correlated ones: the ratio of robust to naive information in the direction of the parameters
(Chandler and Bate 2007). A parameter that is no better known than beforehand changes nothing: V is never wider than the prior.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import norm

from hqpipe.identify.correlation import correlation_time
from hqpipe.identify.least_squares import Fitter, Solution
from hqpipe.identify.model import Samples
from hqpipe.identify.sampling import Covariance


def log_bayes_factor(
    fitter: Fitter, large: Solution, known: Covariance, small: Solution, overstated: float = 1.0
) -> float:
    """ln B of a set of effects against a smaller one that is a part of it.

    Args:
        large, small: fits of both; the free parameters of `small` are among those of `large`. known: of `large`.
        overstated: how many times more the errors seem to say than they do.
    """
    extra = np.flatnonzero(~np.isin(large.free, small.free))
    difference = small.square - large.square
    if not np.isfinite(large.square) or difference <= 0.0:
        return -np.inf
    worth = 0.5 * independence(fitter, large, known, extra) * difference / (overstated * known.noise)
    return worth + occam(fitter, large, known, extra, overstated)


def independence(fitter: Fitter, solution: Solution, known: Covariance, places: np.ndarray) -> float:
    """What a sample counts for in the direction of some parameters, 0 … 1.

    Args:
        places: among the free parameters.
    """
    index = solution.free[places]
    away = (solution.values - fitter.neutral)[index]
    robust, naive = (matrix[np.ix_(places, places)] for matrix in (known.robust, known.naive))
    scale = np.sqrt(np.maximum(np.diag(naive), np.finfo(float).tiny))
    direction = away / scale
    if not np.any(direction):
        direction = np.ones(len(places))
    unit = np.outer(scale, scale)
    with_correlation = direction @ np.linalg.pinv(robust / unit, hermitian=True) @ direction
    without = direction @ np.linalg.pinv(naive / unit, hermitian=True) @ direction
    return float(np.clip(with_correlation / max(without, np.finfo(float).tiny), 0.0, 1.0))


def occam(fitter: Fitter, solution: Solution, known: Covariance, places: np.ndarray, overstated: float = 1.0) -> float:
    """½ ln det(2π V) + Σ ln p(θ) of some parameters with a spread: the price of their freedom.

    Args:
        places: among the free parameters. overstated: as of `log_bayes_factor`; V grows by it.
    """
    index = solution.free[places]
    finite = np.isfinite(fitter.spread[index])
    places, index = places[finite], index[finite]
    if not len(places):
        return 0.0
    within = fitter.within[index]  # anywhere between the bounds, with a density of 1 / √2π in this unit
    spread = np.where(within, (fitter.high - fitter.low)[index] / np.sqrt(2.0 * np.pi), fitter.spread[index])
    # V no wider than the prior: the precisions add up
    relative = overstated * known.posterior[np.ix_(places, places)] / np.outer(spread, spread)
    values, vectors = np.linalg.eigh(relative)
    values = np.maximum(values, np.finfo(float).eps)
    posterior = 1.0 / (1.0 / values + 1.0)
    deviation = (solution.values - fitter.neutral)[index] / spread
    price = 0.5 * float(np.sum(np.log(2.0 * np.pi * posterior)))
    price -= float(np.sum(np.where(within, 0.5 * np.log(2.0 * np.pi), np.log(np.pi * (1.0 + deviation**2)))))
    sure = np.sqrt(np.maximum(np.diag((vectors * posterior) @ vectors.T), np.finfo(float).tiny))
    one_sided = (fitter.low[index] == fitter.neutral[index]) | (fitter.high[index] == fitter.neutral[index])
    one_sided &= ~within
    # the prior is twice as dense on one side, and the posterior is cut at the bound
    price += float(np.sum(np.where(one_sided, np.log(2.0) + norm.logcdf(np.abs(deviation) / sure), 0.0)))
    return price


def settled_price(solution: Solution, samples: Samples, settled: Sequence[int]) -> float:
    """ln of the price of numbers that a prediction takes from the logs by itself, each charged as by Schwarz (1978): half the
    logarithm of its share of the independent samples.

    Args:
        solution: a fit, whose errors say how many samples are independent. settled: how many numbers each effect takes.
    """
    if not any(settled) or not np.isfinite(solution.square):
        return 0.0
    independent = len(solution.error) / correlation_time(solution.error, samples)
    return sum(0.5 * number * float(np.log(max(independent / number, 1.0))) for number in settled if number)
