"""What an effect that is left out of a set promises, told from secants of the error without a fit.

The secant goes from neutral to each of the effect's starting values; what the free numbers can do is taken out of it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from hqpipe.identify.least_squares import Fitter, Solution
from hqpipe.identify.model import Effect, positions
from hqpipe.identify.sampling import Covariance

_STARTS = 24  # combinations of starting values; assumption: more would be a search of its own
_FARTHEST = 4.0  # starts away from neutral that the slope may suggest
_DOES = 0.25  # of the square that a slope promises of a start, from which it is one: half of the change; assumption
_BISECTIONS = 6  # of the way to a start: within 2 % of it
_SAME = 1e-9  # of the squared error: a change below it is one of rounding

Names = frozenset[str]


@dataclass(frozen=True, eq=False)
class Known:
    """A set that was fitted.

    Attributes:
        solution: the fit. covariance: of its free parameters. counts: what a sample counts for in the direction of its effects,
            0 … 1. freedom: ln of the price of their numbers, see `hqpipe.identify.evidence.occam`.
    """

    names: Names
    solution: Solution
    covariance: Covariance
    counts: float
    freedom: float


@dataclass(frozen=True, eq=False)
class Promise:
    """A start of a fit.

    Attributes:
        gain: what it may take off the squared error. start: (P,) values that the slope suggests. does: square of what these
            would change by the slope that the free parameters cannot. whole: (P,) values from which the slope was taken.
    """

    gain: float
    start: np.ndarray
    does: float
    whole: np.ndarray


class Screening:
    """Of the effects of one joint; a promise is a function of the set and its fit alone, and is kept."""

    def __init__(self, fitter: Fitter, effects: Mapping[str, Effect]) -> None:
        self._fitter, self._effects = fitter, effects
        self._places = {name: positions(fitter.model, [name])[len(fitter.model.base) :] for name in effects}
        self._promised: dict[tuple[Names, float, str], list[Promise]] = {}
        self._replaced: dict[tuple[Names, float, Names], dict[str, float]] = {}
        self._span_of: tuple[Known, np.ndarray] | None = None

    def places(self, name: str) -> np.ndarray:
        """Indices of an effect's parameters."""
        return self._places[name]

    def does(self, known: Known, name: str) -> float:
        """Square of what an effect of a set does to the prediction at its size, all else as it is."""
        values = known.solution.values.copy()
        values[self.places(name)] = self._fitter.neutral[self.places(name)]
        return square_of(self.change(known, values))

    def reach(self, known: Known, name: str) -> tuple[float, float, float] | None:
        """A size of an effect's first number, from neutral, the square of what that does to the prediction, and of the part of
        it that the free parameters cannot do; None where they can do all of it."""
        first = self.places(name)[0]
        for moved, _, square in self._secants(known, name):
            size = abs(float(moved[first] - self._fitter.neutral[first]))
            if size > 0.0 and square > _SAME * known.solution.square:
                return size, square_of(self.change(known, moved)), square
        return None

    def screened(self, known: Known, names: Sequence[str]) -> list[tuple[float, str]]:
        """(squared error that the slope promises, effect), the best first; those that promise nothing are left out."""
        found = [(promises[0].gain, name) for name in names if (promises := self.promises(known, name))]
        return sorted(((gain, name) for gain, name in found if gain > 0.0), reverse=True)

    def in_place(self, larger: Known, left: Collection[str], names: Sequence[str]) -> list[tuple[float, str]]:
        """(share that an effect can do of what others do in a set beyond what its free parameters can, effect), the best first;
        those that can do nothing of it are left out.

        The slopes are those of the set itself: without these others its free parameters may go where slopes say nothing of it.

        Args:
            left: effects of the set that leave. names: of those that may take their place.
        """
        key = larger.names, larger.solution.square, frozenset(left)
        shares = self._replaced.setdefault(key, {})
        if unknown := [name for name in names if name not in shares]:
            shares |= self._shares_in_place(larger, left, unknown)
        return sorted(((shares[name], name) for name in names if shares[name] > 0.0), reverse=True)

    def _shares_in_place(self, larger: Known, left: Collection[str], names: Sequence[str]) -> dict[str, float]:
        """As `in_place`; 0 for those that can do nothing."""
        solution, values = larger.solution, larger.solution.values.copy()
        places = np.concatenate([self.places(name) for name in sorted(left)])
        values[places] = self._fitter.neutral[places]
        error, span = self._fitter.error(values), self._orthonormal(solution, places)
        wanted = beyond(span, solution.error - error)
        whole = square_of(wanted)
        if not 0.0 < whole < np.inf:
            return dict.fromkeys(names, 0.0)

        def change(moved: np.ndarray) -> np.ndarray:
            return beyond(span, self._fitter.error(moved) - error)

        def most(name: str) -> float:
            secants = self._secants_from(values, name, change)
            return max((self._along(name, secant, -wanted)[1] for secant in secants), default=0.0)

        return {name: most(name) / whole for name in names}

    def promises(self, known: Known, name: str) -> list[Promise]:
        """What each start of an effect promises, the best first.

        The slope is a secant from neutral to a combination of starting values, less what the free parameters can do.
        """
        key = known.names, known.solution.square, name
        if key not in self._promised:
            self._promised[key] = self._promises_of(known, name)
        return self._promised[key]

    def _promises_of(self, known: Known, name: str) -> list[Promise]:
        first, found = self.places(name)[0], []
        for secant in self._secants(known, name):
            share, gain = self._along(name, secant, known.solution.error)
            if gain > 0.0:
                whole, _, size = secant
                moved = whole.copy()
                moved[first] = self._fitter.neutral[first] + share * (whole[first] - self._fitter.neutral[first])
                start = self._fitter.clipped(moved, np.append(known.solution.free, self.places(name)))
                found.append(Promise(gain, start, share**2 * size, whole))
        return sorted(found, key=lambda promise: -promise.gain)

    def _along(self, name: str, secant: tuple[np.ndarray, np.ndarray, float], error: np.ndarray) -> tuple[float, float]:
        """How far along a secant of an effect the squared error is least, within the bounds, and what it is less there.

        Args:
            secant: see `_secants`. error: (N,).
        """
        moved, change, size = secant
        slope = float(change @ error)
        low, high = self.shares(name, moved[self.places(name)])
        share = float(np.clip(-slope / size, low, high))
        return share, -2.0 * share * slope - share**2 * size

    def start(self, known: Known, promise: Promise) -> np.ndarray:
        """(P,) values from which a fit begins: those that the slope suggests, or further on where these do not do what it
        promises. A limit that nothing reaches does nothing, and no slope leads a fit away from there."""

        def does(values: np.ndarray) -> float:
            return square_of(self.beyond(known, self.change(known, values)))

        low, high = promise.start, promise.whole
        if does(low) >= _DOES * promise.does or does(high) <= promise.does:
            return low
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            done = does(middle)
            if _DOES * promise.does <= done <= promise.does:
                return middle
            low, high = (middle, high) if done < promise.does else (low, middle)
        return high

    def _secants(self, known: Known, name: str) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
        """Values at each start of an effect, what they change in the error that the free parameters cannot, and its square."""
        return self._secants_from(
            known.solution.values, name, lambda moved: self.beyond(known, self.change(known, moved))
        )

    def _secants_from(
        self, values: np.ndarray, name: str, change: Callable[[np.ndarray], np.ndarray]
    ) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
        """As `_secants`, from given values; change: of the error by others, as far as the free parameters cannot do it."""
        for combination in self.combinations(name):
            moved = values.copy()
            moved[self.places(name)] = combination
            changed = change(moved)
            if not np.isfinite(changed).all():
                continue
            size = square_of(changed)
            if 0.0 < size < np.inf:
                yield moved, changed, size

    def change(self, known: Known, values: np.ndarray) -> np.ndarray:
        """(N,) what other values change in the error of a set; not finite where the prediction overflows."""
        return self._fitter.error(values) - known.solution.error

    def beyond(self, known: Known, change: np.ndarray) -> np.ndarray:
        """(N,) the part of a change that the free parameters of a set cannot do."""
        return beyond(self._span(known), change)

    def shares(self, name: str, combination: np.ndarray) -> tuple[float, float]:
        """How far along the secant the first parameter may go."""
        first = self.places(name)[0]
        length = combination[0] - self._fitter.neutral[first]
        if length == 0.0:
            return 0.0, 1.0
        bounds = (self._fitter.low[first], self._fitter.high[first])
        ends = sorted((bound - self._fitter.neutral[first]) / length for bound in bounds)
        return max(ends[0], -_FARTHEST), min(ends[1], _FARTHEST)

    def combinations(self, name: str) -> list[np.ndarray]:
        """Starting values of an effect: those of its first parameter, or one spread, with those of the others, or neutral."""
        options = []
        for k, parameter in enumerate(self._effects[name].parameters):
            default = parameter.neutral + parameter.spread if k == 0 else parameter.neutral
            options.append(parameter.starts or (float(np.clip(default, parameter.low, parameter.high)),))
        return [np.array(values, dtype=np.float64) for values in list(product(*options))[:_STARTS]]

    def _span(self, known: Known) -> np.ndarray:
        """(N, F) orthonormal, what the free parameters can do: those that a bound stops can do nothing."""
        if self._span_of is None or self._span_of[0] is not known:
            self._span_of = known, self._orthonormal(known.solution)
        return self._span_of[1]

    def _orthonormal(self, solution: Solution, but: Collection[int] = ()) -> np.ndarray:
        columns = solution.jacobian
        if not np.isfinite(solution.square):
            return columns[:, :0]
        stopped = self._fitter.stopped(solution.values, solution.free, columns.T @ solution.error)
        return np.linalg.qr(columns[:, ~(stopped | np.isin(solution.free, list(but)))])[0]


def beyond(span: np.ndarray, change: np.ndarray) -> np.ndarray:
    """(N,) the part of a change outside of a span (N, F) that is orthonormal; the change itself where it is not finite."""
    return change - span @ (span.T @ change) if np.isfinite(change).all() else change


def square_of(change: np.ndarray) -> float:
    """Sum of the squares of a change (N,); infinite where the prediction overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        square = float(change @ change)
    return square if np.isfinite(square) else np.inf
