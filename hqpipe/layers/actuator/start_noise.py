"""Errors of free runs without the noise of the torque that each window starts from.

A window starts from a logged torque. Its noise ε decays in the run as the torque leaks, a_i = (1 − k2)^i after i samples. So
the errors of a window have the covariance σ² (1 + ρ a aᵀ), where σ² is the variance of the errors and ρ that of ε over it.
Their likelihood is that of independent errors

    r = exp(Σ ln(1 + ρ |a|²) / 2N) (e − c a aᵀ e),   c = (1 − 1/√(1 + ρ |a|²)) / |a|²

(generalised least squares, Aitken 1935; the factor is the determinant of the covariance, summed over the windows of N samples,
with σ at its most likely value). Without it a law that leaks more than the machine would err less, as it forgets ε sooner.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)

_LEAST = 1e-12  # |a|² below which nothing of the start is left


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _removed(error: np.ndarray, left: np.ndarray, squares: np.ndarray, ends: np.ndarray, share: float) -> np.ndarray:
    """(N,) r of errors e (N,), with a (N,) and |a|² (W,); share: ρ."""
    found, total, grown, part, last = np.empty_like(error), 0.0, 0.0, 0.0, -1.0
    for w in range(len(squares)):
        if squares[w] != last:  # complete windows are alike
            last = squares[w]
            grown = np.log1p(share * last)
            part = -np.expm1(-0.5 * grown) / max(last, _LEAST)
        total += grown
        along = 0.0
        for i in range(ends[w], ends[w + 1]):
            along += left[i] * error[i]
        along *= part
        for i in range(ends[w], ends[w + 1]):
            found[i] = error[i] - along * left[i]
    found *= np.exp(0.5 * total / len(error))
    return found


class _Left(NamedTuple):
    """What a law that leaks `leak` leaves of the start: `sample` (N,) is a at each judged sample, `squares` (W,) |a|² of each
    window, and `square` that of a complete one."""

    leak: float
    sample: np.ndarray
    squares: np.ndarray
    square: float


@dataclass(frozen=True, eq=False)
class StartNoise:
    """The windows of one record.

    Attributes:
        variance: of the noise of the torque's sensor. step: (S,) samples behind the start that are judged. judged: (W, S)
            whether each was recorded.
    """

    variance: float
    step: np.ndarray
    judged: np.ndarray
    _last: _Left | None = field(init=False, default=None)

    def share(self, error: np.ndarray, leak: float) -> float:
        """ρ of errors e (N,) of a law that leaks `leak` of the torque in a sample: the variance of the sensor's noise over that
        of the errors beside ε, which is no smaller where nothing else errs."""
        with np.errstate(over="ignore", invalid="ignore"):  # of a prediction that grows without bounds
            square = float(error @ error) / max(len(error), 1)
        if not 0.0 < square < np.inf:
            return 0.0
        of_start = self.variance * self._left(leak).square / max(len(self.step), 1)
        return self.variance / max(square - of_start, self.variance)

    def removed_from(self, error: np.ndarray, leak: float, share: float) -> np.ndarray:
        """(N,) r of errors e (N,), window by window, of a law that leaks `leak` of the torque in a sample.

        Args:
            share: ρ.
        """
        if share <= 0.0:
            return error
        left = self._left(leak)
        return _removed(np.ascontiguousarray(error), left.sample, left.squares, self._ends, share)

    def floor(self, leak: float) -> tuple[float, float]:
        """Root mean square that the noise leaves in e, and in r, of a law that is right."""
        square, count, sd = self._left(leak).square, max(len(self.step), 1), self.variance**0.5
        return sd * (1.0 + square / count) ** 0.5, sd * (1.0 + square) ** (0.5 / count)

    @cached_property
    def _samples(self) -> tuple[np.ndarray, np.ndarray]:
        """(N,) window of each judged sample, and (N,) its index in it."""
        return np.nonzero(self.judged)

    @cached_property
    def _ends(self) -> np.ndarray:
        """(W + 1,) first judged sample of each window, and the end."""
        return np.concatenate([[0], np.cumsum(self.judged.sum(axis=1))])

    def _left(self, leak: float) -> _Left:
        """Of the start; the last one is kept, as most of what is tried leaks as much."""
        if self._last is None or self._last.leak != leak:
            left, (window, step) = min(max(1.0 - leak, 0.0), 1.0) ** self.step.astype(np.float64), self._samples
            sample = left[step]
            squares = np.bincount(window, sample**2, len(self.judged))
            object.__setattr__(self, "_last", _Left(leak, sample, squares, float(left @ left)))
        return self._last
