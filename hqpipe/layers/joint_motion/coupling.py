"""What the motion of the other joints of a chain does to a joint: terms of the Lagrangian of a chain of unknown geometry.

For joint i of a chain, Lagrange's equation gives

    τ_i = Σ_k d/dt(M_ik v_k) − ½ Σ_kl (∂M_kl/∂q_i) v_k v_l + ∂V/∂q_i

where M_kl depends on the joints beyond the inner one of k and l only, and M and V are sums of products of the sines and cosines
of turning joints (Siciliano et al., Robotics, 2009, ch. 7). Without a URDF the coefficients are unknown: each product is a
column. Products of one sine or cosine come first, those of two where the log is long enough for so many numbers; in a short
log fewer joints take part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from hqpipe.layers.joint_motion.motion import Motion

NEAR = 2  # joints away whose products of two are offered; assumption: what lies further away changes slowly with them
SAMPLES_PER_TERM = 5  # independent ones; assumption: fewer would fit noise in spite of the prior
MOST_TERMS = 150  # assumption: an error then costs as much as the rest of the model; an arm of seven joints has 120
_ROUNDING = float(np.finfo(np.float64).eps)  # of the square of a term: what joints at rest leave of it is no motion

Angle = tuple[np.ndarray, Motion, bool]
"""Position less its mean, motion, and whether the joint turns."""


@dataclass(frozen=True)
class Coupling:
    """Which terms are offered.

    Attributes:
        turns: of each joint in the order of the chain. own: which of them is judged. second: with products of two.
    """

    turns: tuple[bool, ...]
    own: int
    second: bool = False

    def rows(self, chain: tuple[Angle, ...]) -> np.ndarray:
        """(K, T) terms.

        Args:
            chain: as `turns`, the joint itself among them.
        """
        waves = [_waves(*joint) for joint in chain]
        found = [*self._inertia(chain, waves), *self._centrifugal(chain, waves), *self._gravity(waves)]
        return np.array(found).reshape(len(found), len(chain[self.own][0]))

    def count(self) -> int:
        """Number of the terms."""
        one = Motion(*(np.zeros(1) for _ in range(5)))
        return len(self.rows(tuple((np.zeros(1), one, turn) for turn in self.turns)))

    def _inertia(self, chain, waves) -> list[np.ndarray]:
        """d/dt(f v_k), where f depends on joints beyond the inner one of i and k.

        What of it goes with the slope of f along q_i is taken back by −½ ∂M_ik/∂q_i v_i v_k, twice.
        """
        found = []
        for k, (_, motion, _) in enumerate(chain):
            if k != self.own:
                found.append(motion.acceleration)
            beyond = [m for m in range(min(k, self.own) + 1, len(chain))]
            sets = [(m,) for m in beyond]
            if self.second:
                sets += [pair for pair in combinations(beyond, 2) if max(abs(m - self.own) for m in pair) <= NEAR]
            for joints in sets:
                for factors in product(*(waves[m] for m in joints)):
                    value = np.prod([f for f, _, _ in factors], axis=0)
                    slope = np.zeros_like(value)
                    for n, m in enumerate(joints):
                        if m != self.own:
                            rest = [f for other, (f, _, _) in enumerate(factors) if other != n]
                            slope = slope + np.prod([factors[n][1], *rest], axis=0)
                    found.append(value * motion.acceleration + slope * motion.velocity)
        return found

    def _centrifugal(self, chain, waves) -> list[np.ndarray]:
        """g(q_i) v_k v_l of joints of which one lies before this one."""
        if not self.own:
            return []
        slopes = [slope for _, _, slope in waves[self.own]]
        others = [k for k in range(len(chain)) if k != self.own]
        return [
            slope * chain[k][1].velocity * chain[m][1].velocity
            for k in others
            for m in others
            if k <= m and k < self.own
            for slope in slopes
        ]

    def _gravity(self, waves) -> list[np.ndarray]:
        """Weight of links whose direction other joints change."""
        others = [m for m in range(len(waves)) if m != self.own]
        sets = [(m,) for m in others] + (list(combinations(others, 2)) if self.second else [])
        return [
            np.prod([slope, *(f for f, _, _ in factors)], axis=0)
            for _, _, slope in waves[self.own]
            for joints in sets
            for factors in product(*(waves[m] for m in joints))
        ]


def _waves(x: np.ndarray, motion: Motion, turns: bool) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """(value, rate, slope) of the functions of one joint: sine and cosine less one, or the way of a slide."""
    if not turns:
        return [(x, motion.velocity, np.ones_like(x))]
    sine, cosine = np.sin(x), np.cos(x)
    return [(sine, cosine * motion.velocity, cosine), (cosine - 1.0, -sine * motion.velocity, -sine)]


def coupling_for(chain: Sequence[bool], own: int, independent: float) -> tuple[Coupling | None, int]:
    """The most terms that a log can bear, and the number of the first joint in them; None if it can bear none.

    Args:
        chain: whether each joint that moves turns. own: the one that is judged. independent: samples, by time and bandwidth.
    """
    most = min(independent / SAMPLES_PER_TERM, MOST_TERMS)
    for reach in range(len(chain) - 1, 0, -1):
        first = max(own - reach, 0)
        near = tuple(chain[first : own + reach + 1])
        for second in (True, False):
            coupling = Coupling(near, own - first, second)
            if coupling.count() <= most:
                return coupling, first
    return None, 0


@dataclass(frozen=True, eq=False)
class Nuisance:
    """Directions in the samples that may be the work of other joints, and how much of each is taken out.

    Terms with a normal prior on their coefficients are a covariance of the errors: generalised least squares. What is left has
    the square min over the coefficients of |r − Z γ|² + λ|γ|², as if they had been fitted with every set of effects.

    Attributes:
        span: (M, K) orthonormal. share: (K,) 0 … 1, that is taken out.
    """

    span: np.ndarray
    share: np.ndarray

    @classmethod
    def of(cls, terms: np.ndarray, ridge: float) -> Nuisance:
        """Of (M, K) terms of about unit size and λ."""
        if not terms.size:
            return cls(np.zeros((len(terms), 0)), np.zeros(0))
        values, vectors = np.linalg.eigh(terms.T @ terms)
        held = values > max(1e-3 * ridge, 1e-10 * max(values[-1], 0.0))  # the rest takes out less than a thousandth
        span = terms @ (vectors[:, held] / np.sqrt(values[held]))
        return cls(span, 1.0 - np.sqrt(ridge / (ridge + values[held])))

    def left(self, values: np.ndarray) -> np.ndarray:
        """(M,) or (M, C) without what other joints may do."""
        if not len(self.share):
            return values
        share = self.share if values.ndim == 1 else self.share[:, None]
        return values - self.span @ (share * (self.span.T @ values))


@dataclass(frozen=True, eq=False)
class Predicted:
    """The same for samples that were not fitted: the coefficients are those of the fit, as far as it knows them.

    What remains uncertain of a coefficient after the fit is a covariance of the errors.

    Attributes:
        terms: (M, K). gains: (K, N) from errors of the fit to coefficients. nuisance: what remains uncertain.
    """

    terms: np.ndarray
    gains: np.ndarray
    nuisance: Nuisance

    @classmethod
    def of(cls, fitted: np.ndarray, terms: np.ndarray, ridge: float) -> Predicted:
        """Of (N, K) terms of the fit and (M, K) of other samples."""
        values, vectors = np.linalg.eigh(fitted.T @ fitted)
        spread = vectors / np.sqrt(np.maximum(values, 0.0) + ridge)
        return cls(terms, spread @ (spread.T @ fitted.T), Nuisance.of(terms @ spread, 1.0))

    def left(self, errors: np.ndarray, fitted: np.ndarray) -> np.ndarray:
        """(M,) errors without what other joints do; `fitted`: (N,) those of the fit."""
        if not self.gains.size or not len(errors):
            return errors
        return self.nuisance.left(errors - self.terms @ (self.gains @ fitted))


def term_sizes(*parts: np.ndarray) -> np.ndarray:
    """(K,) root mean square of (M, K) terms over all samples, those that no fit sees among them; 1 where all are 0.

    A coefficient is expected to be as large as the motions ask for that the machine makes. Of terms that hardly differ from 0
    in the fit, since the other joints rest there, any other measure would make anything of the held-out motions.
    """
    terms = np.concatenate(parts)
    found = np.sqrt(np.mean(terms**2, axis=0)) if len(terms) else np.zeros(terms.shape[1])
    return np.where(found > 0.0, found, 1.0)


def ridge_of(terms: np.ndarray, own: np.ndarray, output: np.ndarray) -> float:
    """λ of the greatest restricted likelihood (Patterson & Thompson 1971): variance of the error over that of a coefficient.

    Args:
        terms: (M, K) of about unit size wherever the machine moves. own: (M, C) columns whose coefficients are free.
            output: (M,).
    """
    span, _ = np.linalg.qr(own)
    output = output - span @ (span.T @ output)
    terms = terms - span @ (span.T @ terms)
    values, vectors = np.linalg.eigh(terms.T @ terms)
    values = np.maximum(values, 0.0)
    held = values > 1e-10 * values[-1]
    along = (vectors[:, held].T @ (terms.T @ output)) ** 2 / values[held]
    rest = max(float(output @ output - along.sum()), 0.0)
    count = len(output) - own.shape[1]
    options = np.maximum(values[-1] * np.geomspace(1e-8, 1e4, 61), _ROUNDING * len(terms))

    def deviance(ridge: float) -> float:
        growth = 1.0 + values[held] / ridge
        return count * np.log(np.sum(along / growth) + rest) + np.sum(np.log(growth))

    return float(min(options, key=deviance))
