"""A physical quantity read off fitted parameters, with the interval that follows from their covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.identify.uncertainty import student


@dataclass(frozen=True)
class Quantity:
    """A physical quantity that cannot be negative; `half_width` of its 95 % interval, None where the logs do not tell."""

    name: str
    unit: str
    value: float
    half_width: float | None
    meaning: str

    @property
    def interval(self) -> tuple[float, float] | None:
        """Ends of the 95 % interval, cut at 0."""
        if self.half_width is None:
            return None
        return max(self.value - self.half_width, 0.0), self.value + self.half_width


def half_width(slope: np.ndarray, covariance: np.ndarray, freedom: np.ndarray) -> float:
    """Half of the 95 % interval by the delta method.

    Args:
        slope: (P,) exact derivatives of the quantity. covariance: (P, P) of the parameters.
        freedom: (P,) degrees of freedom of its diagonal; the fewest among those that the quantity depends on count.
    """
    return float(student(freedom[slope != 0.0].min()) * np.sqrt(max(slope @ covariance @ slope, 0.0)))
