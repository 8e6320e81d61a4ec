"""Which coefficients the logs can determine at all."""

from __future__ import annotations

import numpy as np

from hqpipe.identify.paper_model.problem import COEFFICIENTS, Evaluation
from hqpipe.identify.windows import JointData, Windows

_SUBSTANCE = 0.1  # share of its RMS that torque and error must have to count as an impact
_IMPACT_SHARE = 0.005  # of the samples
_IMPACT_WINDOWS = 10
MAX_INFLATION = 1e6  # variance inflation beyond which two coefficients cannot be told apart
MOST_OF_ONE = 0.9  # assumption: with more in one window, intervals, which divide by the rest, come to be rounding
_MOVES = 1e-9  # rad or m; less is no motion

_SINGULAR = 1e-16  # smallest eigenvalue of a correlation matrix that rounding leaves meaningful

_K3, _K4 = COEFFICIENTS.index("k3"), COEFFICIENTS.index("k4")


def unexcited(joints: list[JointData], windows: Windows) -> dict[str, str]:
    """Coefficients that the signals leave undetermined, each with the reason.

    Args:
        joints: those that share the coefficients. windows: of the fit.
    """
    if all(_still(data) for data in joints):
        return dict.fromkeys(COEFFICIENTS, "neither the command nor the joint moves in the fit trials")
    if all(np.ptp(data.effort) == 0 for data in joints):
        return dict.fromkeys(COEFFICIENTS, "the measured torque is constant in the fit trials")
    reasons = {}
    if all(np.ptp(data.velocity) <= _MOVES for data in joints):
        reasons["k3"] = "the joint does not move in the fit trials"
    if text := _rare_impacts(joints, windows):
        reasons["k4"] = text
    return reasons


def _still(data: JointData) -> bool:
    return np.ptp(data.command) <= _MOVES and np.ptp(data.error) <= _MOVES


def _rare_impacts(joints: list[JointData], windows: Windows) -> str | None:
    """The k4 term acts only while torque and position error are opposed: is there enough of that?"""
    hits, samples, hit_windows = 0, 0, 0
    for data in joints:
        effort, error = data.effort, data.error
        opposed = effort * error < 0
        for signal in (effort, error):
            opposed &= np.abs(signal) > _SUBSTANCE * np.sqrt(np.mean(signal**2))
        count = np.concatenate(([0], np.cumsum(opposed)))
        hit_windows += int((count[windows.bounds[:, 1]] > count[windows.bounds[:, 0]]).sum())
        hits += int(opposed.sum())
        samples += len(effort)
    if hits >= _IMPACT_SHARE * samples and hit_windows >= _IMPACT_WINDOWS:
        return None
    return (
        f"torque opposes the position error in {hits} of {samples} samples ({hit_windows} windows), expected "
        f"{_IMPACT_SHARE:.1%} and {_IMPACT_WINDOWS} windows; k4 needs trials with impacts"
    )


def inseparable(at: Evaluation, free: np.ndarray) -> dict[str, str]:
    """Coefficients whose effect on the torque the others can imitate, each with the reason.

    k4 is given up first, then k3; without k1 and k2 there is no model, so those stand or fall together.
    """
    reasons: dict[str, str] = {}
    free = free.copy()
    for index in (_K4, _K3):
        if free[index] and inflation(at.hessian, free)[index] > MAX_INFLATION:
            reasons[COEFFICIENTS[index]] = "its effect cannot be told from that of the other coefficients"
            free[index] = False
    if (inflation(at.hessian, free) > MAX_INFLATION).any():
        text = "the motion is too poor to tell the coefficients apart (steady load only?)"
        return dict.fromkeys(COEFFICIENTS, text)
    return reasons


def single_window(hessians: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(P,) share of what is known of a parameter that rests on a single window, where it exceeds `MOST_OF_ONE`; 0 elsewhere.

    What is known is the inverse of the variance. With a window gone all free parameters are unknown, so that one which
    alone tells two parameters apart counts as well. Those found are taken for known in what is claimed of the others, which
    are looked at again: nothing may be claimed that follows only from holding what a single window decides.

    Args:
        hessians: (W, P, P) Gauss-Newton matrices of the windows. free: (P,) bool.
    """
    found = np.zeros(len(free))
    if not free.any():
        return found
    total = hessians.sum(axis=0)[np.ix_(free, free)]
    unit = np.sqrt(np.maximum(np.diag(total), 1e-300))
    total = total / np.outer(unit, unit)
    without = _variances(total - hessians[:, free][:, :, free] / np.outer(unit, unit)).max(axis=0)
    lone = np.zeros(len(unit))
    while (claimed := lone == 0.0).any():
        share = np.zeros(len(unit))
        share[claimed] = 1.0 - _variances(total[np.ix_(claimed, claimed)]) / without[claimed]
        if (share <= MOST_OF_ONE).all():
            break
        lone = np.where(share > MOST_OF_ONE, share, lone)
    found[free] = lone
    return found


def _variances(information: np.ndarray) -> np.ndarray:
    """(…, P) diagonal of the inverse of matrices (…, P, P) that rounding may have left indefinite."""
    values, vectors = np.linalg.eigh(information)
    return (vectors**2 / np.maximum(values, _SINGULAR)[..., None, :]).sum(axis=-1)


def inflation(hessian: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(P,) variance inflation of the coefficients: infinite without any effect, 0 if not free."""
    found = np.zeros(len(free))
    part = hessian[np.ix_(free, free)]
    diagonal = np.diag(part)
    if not np.isfinite(part).all() or (diagonal <= 0).any():
        found[free] = np.inf
        return found
    unit = np.sqrt(diagonal)
    found[free] = _variances(part / np.outer(unit, unit))
    return found
