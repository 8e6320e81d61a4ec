"""How many independent samples correlated errors are worth, and what a parameter's uncertainty is then.

Errors of a free run at 1 kHz stay alike for tenths of a second. Blocks of three autocorrelation times are taken as independent;
the scatter of the blocks' contributions to the slope gives a covariance that holds for errors of any correlation (Huber 1967,
White 1980).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.identify.correlation import correlation_time
from hqpipe.identify.least_squares import Fitter, Solution, lengths
from hqpipe.identify.model import STATES, Samples
from hqpipe.identify.thresholds import BLOCK


def blocks(samples: Samples, length: float) -> np.ndarray:
    """(N,) number of the block of each sample, from 0; no block holds samples of two trials."""
    found, first = np.empty(len(samples.trial), dtype=np.int64), 0
    for k in range(len(samples.files)):
        here = np.flatnonzero(samples.trial == k)
        if not len(here):
            continue
        count = max(int(len(here) / max(length, 1.0)), 1)
        found[here] = first + np.arange(len(here)) * count // len(here)
        first += count
    return found


@dataclass(frozen=True, eq=False)
class Covariance:
    """Of the free parameters of a solution.

    Attributes:
        robust: (F, F), correlation of the errors accounted for. naive: (F, F), as if they were independent.
        posterior: (F, F), as robust, and what is known beforehand weighed with samples for as little as they say.
        noise: variance of the errors, above 0; infinite where the prediction overflows. blocks: how many there are.
        alike: how many times the squares of deviations are those of independent errors; 1 or more.
    """

    robust: np.ndarray
    naive: np.ndarray
    posterior: np.ndarray
    noise: float
    blocks: int
    alike: float


def covariance(fitter: Fitter, solution: Solution) -> Covariance:
    """The covariance of what a fit found.

    Errors are alike in time, and alike where the joint is in the same state, however often it comes back there: a wrong law
    of friction is wrong in the same way each time. The scatter is taken over blocks of time and over states, less what is
    counted twice (Cameron, Gelbach and Miller 2011). With few blocks the scatter is itself uncertain: it is averaged with
    that of independent samples times the correlation time, which counts as many blocks as there are parameters.

    A prior is weighed with samples for as many as they say something of (Ribatet, Cooley and Davison 2012): beside samples that
    were taken for independent it would limit nothing, and a number between 0 and 1 could be uncertain by 4.
    """
    jacobian, error, free = solution.jacobian, solution.error, solution.free
    samples = fitter.model.fit
    if not np.isfinite(solution.square):
        return _unknown(len(free))
    noise = max(float(error @ error) / max(len(error) - len(free), 1), np.finfo(float).tiny)
    normal = jacobian.T @ jacobian
    spread = fitter.spread[free]
    prior = np.where(np.isfinite(spread), noise / spread**2, 0.0)
    known = noise * fitter.precision(solution.values, free)
    scale = lengths(normal + np.diag(prior))
    unit = np.outer(scale, scale)
    inverse = scaled_inverse(normal + np.diag(prior), unit)
    time = correlation_time(error, samples)
    block = blocks(samples, BLOCK * time)
    count = int(block.max()) + 1 if len(block) else 1
    scatter = _scatter_in_time_and_state(jacobian.T * error / scale[:, None], block, samples.state)
    values, vectors = np.linalg.eigh(scatter)
    scatter = (vectors * np.maximum(values, 0.0)) @ vectors.T * unit
    expected = noise * time * normal
    meat = (count * scatter + len(free) * expected) / (count + len(free))
    robust = inverse @ (meat + noise * np.diag(prior)) @ inverse
    alike = max(float(np.sum(inverse * meat)) / max(noise * float(np.sum(inverse * normal)), np.finfo(float).tiny), 1.0)
    inner = scaled_inverse(normal + alike * np.diag(known), unit)
    posterior = inner @ (meat + alike**2 * noise * np.diag(known)) @ inner
    return Covariance(_symmetric(robust), noise * inverse, _symmetric(posterior), noise, count, alike)


def scaled_inverse(matrix: np.ndarray, unit: np.ndarray) -> np.ndarray:
    """(F, F) pseudo-inverse of a matrix of numbers in units as different as `unit` (F, F), products of two."""
    return np.linalg.pinv(matrix / unit, hermitian=True) / unit


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return 0.5 * (matrix + matrix.T)


def _unknown(free: int) -> Covariance:
    """Of a prediction that overflows: nothing was fitted."""
    none = np.zeros((free, free))
    return Covariance(none, none, none, np.inf, 1, 1.0)


def _scatter_in_time_and_state(slopes: np.ndarray, block: np.ndarray, state: np.ndarray) -> np.ndarray:
    """(F, F) scatter of slopes (F, N) over blocks and over states, less what both count; block, state: (N,) numbers from 0."""
    cells, cell = np.unique(
        block * STATES + state, return_inverse=True
    )  # not all: there may be more of them than samples
    sums = _summed(slopes, cell, len(cells))
    in_time = _summed(sums, cells // STATES, int(block.max(initial=-1)) + 1)
    in_state = _summed(sums, cells % STATES, STATES)
    return _scatter(in_time) + _scatter(in_state[:, np.bincount(state, minlength=STATES) > 0]) - _scatter(sums)


def _summed(rows: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """(F, count) sums of each row of `rows` (F, N) over groups (N,)."""
    return np.array([np.bincount(group, row, count) for row in rows]).reshape(-1, count)


def _scatter(sums: np.ndarray) -> np.ndarray:
    """(F, F) of sums (F, G) over groups, each of which has samples; corrected for the freedom that the fit took from them."""
    groups = sums.shape[1]
    return sums @ sums.T * groups / max(groups - len(sums), 1)
