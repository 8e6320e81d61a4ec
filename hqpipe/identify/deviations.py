"""What may differ between two records of a joint: how each candidate moves the numbers, and how its cause is told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hqpipe.identify.found import JointCause
from hqpipe.identify.model import Effect, Parameter, Ratio
from hqpipe.identify.uncertainty import NORMAL

_MOST_RATIO = 20.0  # and one over it: what changed by more is another machine's; assumption
_USUAL_RATIO = 0.3  # off one; assumption: wear and ageing change a coefficient by some ten per cent


class InBoth:
    """An effect that both records have: no change."""

    in_both = True

    def __init__(self, effect: Effect, places: Sequence[int]) -> None:
        self.places = np.array(places, dtype=np.int64)
        self._neutral = np.array([p.neutral for p in effect.parameters])
        self.source = effect.name
        self.effect = replace(
            effect, name=f"{effect.name} in both records", named=False, in_both=True, excludes=frozenset()
        )

    def move(self, values: np.ndarray, own: np.ndarray) -> None:
        values[self.places] += own - self._neutral


class Deviation:
    """Some numbers of the later record that differ from the earlier one's."""

    in_both = False

    def __init__(
        self, effect: Effect, places: Sequence[int], then: np.ndarray, parameters: Sequence[Parameter]
    ) -> None:
        """
        Args:
            effect: whose numbers they are; without parameters where they are of the base. places: (K,) of the numbers.
            then: (P,) values of the earlier record. parameters: P of them.
        """
        self.places = np.array(places, dtype=np.int64)
        self._low = np.array([parameters[i].low for i in places])
        self._high = np.array([parameters[i].high for i in places])
        own = effect.parameters
        self.effect = replace(
            effect, parameters=tuple(self._of(parameters[i], float(then[i]), not own) for i in places)
        )

    @staticmethod
    def _of(p: Parameter, value: float, of_base: bool) -> Parameter:
        """The deviation of a number; one that has no size of its own gets a third of its value.

        An end at which an effect is absent is no bound: it may have gone, whatever the earlier number becomes in the fit.
        """
        spread = p.spread if np.isfinite(p.spread) else max(abs(value) / 3.0, 1e-9)
        several = tuple(np.clip([-spread, 0.0, spread], p.low - value, p.high - value)) if of_base else ()
        reach = p.high - p.low
        low = -reach if not of_base and p.neutral == p.low else p.low - value
        high = reach if not of_base and p.neutral == p.high else p.high - value
        return replace(p, neutral=0.0, spread=spread, low=low, high=high, starts=several)

    def move(self, now: np.ndarray, own: np.ndarray) -> None:
        now[self.places] = np.clip(now[self.places] + own, self._low, self._high)

    def referred(self, cause: JointCause, then: np.ndarray, sd: np.ndarray) -> JointCause:
        """The cause with the numbers of both records in the place of their difference."""
        numbers = []
        ends = self._low, self._high
        for number, before, unsure, low, high in zip(
            cause.numbers, then[self.places], sd[self.places], *ends, strict=True
        ):
            reach = np.array([number.value, *_widened(number.value, number.ci95, unsure)])
            value, *ci95 = np.clip(before + reach, low, high).tolist()
            numbers.append(replace(number, value=value, ci95=tuple(ci95), reference=float(before)))
        return replace(cause, numbers=tuple(numbers))


class Multiplied:
    """Numbers of the base that a change multiplies by one ratio."""

    in_both = False

    def __init__(self, name: str, ratio: Ratio, names: Sequence[str]) -> None:
        """
        Args:
            name: of the change. names: of the base parameters.
        """
        ends = 1.0 / _MOST_RATIO, _MOST_RATIO
        number = Parameter("ratio", "1", 1.0, _USUAL_RATIO, *ends, (1.0 - _USUAL_RATIO, 1.0 + _USUAL_RATIO))
        self.effect, self._multiply, self._alike_below = Effect(name, (number,)), ratio.multiply, ratio.alike_below
        self.places = np.array([names.index(each) for each in ratio.names], dtype=np.int64)

    def move(self, now: np.ndarray, own: np.ndarray) -> None:
        self._multiply(now, float(own[0]))

    def referred(self, cause: JointCause, then: np.ndarray, sd: np.ndarray) -> JointCause:
        """The cause with what is unsure about the earlier record in its interval; a ratio says itself what it refers to."""
        (number,) = cause.numbers
        known = then[self.places] != 0.0
        unsure = np.abs(sd[self.places][known] / then[self.places][known])
        most = float(unsure.max()) * number.value if len(unsure) else 0.0
        low, high = _widened(number.value, number.ci95, most)
        alike = self._alike_below if number.value < 1.0 else ()
        return replace(
            cause,
            numbers=(replace(number, ci95=(max(low, 0.0), high)),),
            confused_with=tuple(dict.fromkeys((*cause.confused_with, *alike))),
        )


def _widened(value: float, ci95: tuple[float, float], sd: float) -> tuple[float, float]:
    """An interval of a difference with what is unsure about the earlier record in it."""
    low, high = ci95
    return (
        value - float(np.hypot(value - low, NORMAL * sd)),
        value + float(np.hypot(high - value, NORMAL * sd)),
    )
