"""What an error of a joint counts against, so that joints in N·m, N, rad/s and m/s can be pooled.

A joint's scale is the standard deviation of what is predicted about its mean, over the fit trials. About the mean, because an
offset of a sensor or a load that hangs on a joint makes no error smaller; over the fit trials, because what is judged must not
set the measure that it is judged by. A joint that hardly moves would count its noise against its noise: its scale is no less
than the swing from which a joint is judged at all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqpipe.logs.survey.signal import difference_noise

MIN_EXCITATION = 3.0  # standard deviation of an output over that of its noise; assumption: below it nothing can be told
_NOTHING = (
    1e-9  # of the output's RMS: rounding of a constant, also of one that was stored with single precision at its mean
)


def joint_scale(outputs: Sequence[np.ndarray]) -> float:
    """Scale of one joint in the unit of its output.

    Args:
        outputs: what is predicted in each fit trial, (T,).

    Returns:
        The standard deviation over the trials, at least `MIN_EXCITATION` times the noise of its sensor; of a constant without
        noise its size, and infinity for one that is zero: nothing is told by errors of such a joint.
    """
    values = np.concatenate(outputs)
    noise = difference_noise(outputs)
    size = float(np.sqrt(np.mean(values**2)))
    scale = max(float(values.std()), MIN_EXCITATION * noise)
    if scale > _NOTHING * size:
        return scale
    return size if size > 0.0 else float("inf")


def pooled(mean_square: np.ndarray, scale: np.ndarray) -> float:
    """Root of the mean over the joints of their mean squared errors, each over the square of its scale.

    Args:
        mean_square: (J,) in the squared unit of each joint. scale: (J,).
    """
    return float(np.sqrt(np.mean(mean_square / scale**2)))
