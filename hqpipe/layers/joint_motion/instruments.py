"""Instrumental variables: regressors of a motion that the command alone makes, so that they know nothing of the noise.

In a closed loop the noise of the position passes through the controller into the torque, and through the derivatives into the
regressors: least squares are biased by what the two share (Janot, Vandanjon & Gautier 2014). The loop's response to the command
is identified as a linear one on Laguerre functions (Wahlberg 1991) and simulated from the command; the regressors of the
simulated motion are the instruments, and the fit takes the regressors as projected on them (two-stage least squares).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.layers.joint_motion.bandwidth import derivative, low_passed
from hqpipe.layers.joint_motion.first_fit import least_squares, standard_errors

POLES = (0.5, 0.05)  # of the cut-off: loops from half to a twentieth of what the filter passes; assumption
TERMS = 8  # Laguerre functions of each pole
SIGNIFICANCE = 0.01  # of the Durbin–Wu–Hausman test
MATERIAL = 0.02  # change of the predicted torque, as a share of it, below which least squares stay
LEAST_R2 = 0.5  # of a regressor on the instruments: below it they are weak, and the projection would hide the motion


def laguerre(command: np.ndarray, dt: float, cutoff: float) -> np.ndarray:
    """(R, T) responses of the Laguerre functions to a command, filtered as the position is."""
    from scipy.signal import lfilter

    filtered = low_passed(command, dt, cutoff)
    start = filtered[0]
    found = []
    for share in POLES:
        pole = np.exp(-2.0 * np.pi * share * cutoff * dt)
        response = lfilter([1.0 - pole], [1.0, -pole], filtered - start)
        for _ in range(TERMS):
            found.append(response + start if not found else response)
            response = lfilter([-pole, 1.0], [1.0, -pole], response)
    return np.array(found)


def simulated(commands: list[np.ndarray], positions: list[np.ndarray], fit: list[bool], dt: float, cutoff: float):
    """(T,) position of each trial as the loop makes it of the command alone.

    Args:
        commands, positions: (T,) of each trial. fit: which of them the response is identified on.
    """
    responses = [laguerre(command, dt, cutoff) for command in commands]
    every = max(1, round(0.25 / (cutoff * dt)))
    rows, speeds = [], []
    for response, position, used in zip(responses, positions, fit, strict=True):
        if used:
            rows.append(np.array([derivative(r, dt)[::every] for r in response]).T)
            speeds.append(derivative(low_passed(position, dt, cutoff), dt)[::every])
    gains = least_squares(np.concatenate(rows), np.concatenate(speeds))
    found = [gains @ response for response in responses]
    return [q - q.mean() + position.mean() for q, position in zip(found, positions, strict=True)]


@dataclass(frozen=True)
class EndogeneityTest:
    """Attributes:
    p: of the Durbin–Wu–Hausman test. r2: least share of a regressor that the instruments explain.
    plain, instrumental: (K,) coefficients. material: whether they differ so much that it matters.
    """

    p: float
    r2: float
    plain: np.ndarray
    instrumental: np.ndarray
    material: bool

    @property
    def biased(self) -> bool:
        return self.p < SIGNIFICANCE and self.material

    @property
    def weak(self) -> bool:
        return self.r2 < LEAST_R2


def projected(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(Z, K) coefficients of each regressor on the instruments."""
    return np.column_stack([least_squares(z, column) for column in x.T])


def endogeneity(
    x: np.ndarray, z: np.ndarray, y: np.ndarray, doubtful: np.ndarray, block: np.ndarray
) -> EndogeneityTest:
    """Whether least squares are biased: the residuals of the regressors on the instruments explain the torque (Janot 2016).

    Args:
        x: (N, K) regressors. z: (N, Z) instruments. y: (N,) torque. doubtful: indices of regressors that carry noise.
        block: (N,) see `standard_errors`.
    """
    from scipy.stats import chi2

    fitted = z @ projected(x, z)
    rest = (x - fitted)[:, doubtful]
    plain, instrumental = least_squares(x, y), least_squares(fitted, y)
    both = np.column_stack([x, rest])
    found = least_squares(both, y)
    covariance = standard_errors(both, y - both @ found, block)[x.shape[1] :, x.shape[1] :]
    gamma = found[x.shape[1] :]
    statistic = float(gamma @ np.linalg.pinv(covariance, hermitian=True) @ gamma)
    moved = float(np.std(x @ (instrumental - plain)))
    spread = np.var(x[:, doubtful], axis=0)
    r2 = 1.0 - np.var(rest, axis=0) / np.where(spread > 0.0, spread, 1.0)
    return EndogeneityTest(
        float(chi2.sf(statistic, len(doubtful))),
        float(r2.min()),
        plain,
        instrumental,
        moved > MATERIAL * float(np.std(y)),
    )
