"""Vibration in what a law leaves of the output of a joint, while it slides and not while it stands.

Nothing commands a vibration that feeds itself, so that no law which is driven by logged motion predicts its course: it stays in
the errors, and closes none of them. A slow log folds it down to any frequency, so no line is sought in the errors, but change
from sample to sample that does not go on in the next one, as that of unknown motion would. What is folded down to below a sixth
of the log's rate goes on, too, and is not found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import median_abs_deviation

from hqpipe.identify.model import Samples
from hqpipe.identify.thresholds import HALVED
from hqpipe.logs.vibration import CALM, SHARE, SPEEDS

STANDING = 0.03  # of the 95 % speed: below, friction holds or turns round; assumption
SLIDING = 0.1  # of it: above, no joint rests; assumption
FEWEST_SAMPLES = 30  # of a kind that its median needs; assumption


@dataclass(frozen=True)
class VibrationLeft:
    """What a law leaves of a vibration.

    Attributes:
        sliding, standing: root mean square of the errors at the speeds at which they are largest, and while the joint stands,
            in the unit of the output.
    """

    sliding: float
    standing: float

    def text(self, unit: str) -> str:
        """One clause about it; unit: of the output."""
        return (
            f"the torque vibrates by {self.sliding:.3g} {unit} beyond what its law explains while the joint slides, and by "
            f"{self.standing:.2g} {unit} while it stands"
        )


def vibration_left(error: np.ndarray, samples: Samples) -> VibrationLeft | None:
    """The vibration in the errors of a joint that makes a large part of its output at some speed; None if there is none.

    Args:
        error: (N,) prediction less measurement at the samples.
    """
    inner = _inner(samples)
    speed = np.abs(samples.velocity)
    fast = float(np.quantile(speed, 0.95)) if len(speed) else 0.0
    standing, sliding = inner[speed[inner] <= STANDING * fast], inner[speed[inner] > SLIDING * fast]
    if len(standing) < FEWEST_SAMPLES or len(sliding) < SPEEDS * FEWEST_SAMPLES:
        return None
    rests, calm = _size(error, standing), _roughness(error, standing)
    least = max(SHARE * float(np.std(samples.output)), rests / np.sqrt(HALVED))
    ranges = np.array_split(sliding[np.argsort(speed[sliding], kind="stable")], SPEEDS)
    rough = [at for at in ranges if calm < CALM * _roughness(error, at) and _goes_on(error, at) < HALVED]
    largest = max((_size(error, at) for at in rough), default=0.0)
    return VibrationLeft(largest, rests) if largest >= least > 0.0 else None


def _inner(samples: Samples) -> np.ndarray:
    """Samples that lie between two others of their window, which has the same start, as far apart as most."""
    if len(samples.time) < 3:
        return np.zeros(0, dtype=np.int64)
    apart = np.diff(samples.time)
    step = float(np.median(apart))
    same = (np.abs(apart - step) < 0.2 * step) & (np.diff(samples.trial) == 0) & (np.diff(samples.held) == 0.0)
    return np.flatnonzero(same[:-1] & same[1:]) + 1


def _size(error: np.ndarray, at: np.ndarray) -> float:
    """Root mean square of the errors at some samples."""
    return float(np.sqrt(np.mean(error[at] ** 2)))


def _roughness(error: np.ndarray, at: np.ndarray) -> float:
    """Size of the second differences of the errors, as the deviation of white errors that would have them.

    By the median, which leaves shocks aside.
    """
    second = error[at + 1] - 2.0 * error[at] + error[at - 1]
    return float(median_abs_deviation(second, scale="normal") / np.sqrt(6.0))


def _goes_on(error: np.ndarray, at: np.ndarray) -> float:
    """Correlation of the change of the error to a sample with that from it."""
    before, after = error[at] - error[at - 1], error[at + 1] - error[at]
    return float(np.mean(before * after) / np.sqrt(np.mean(before**2) * np.mean(after**2)))
