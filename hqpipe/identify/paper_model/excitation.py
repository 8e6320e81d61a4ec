"""Which coefficients the logs can determine at all."""

from __future__ import annotations

import numpy as np

from hqpipe.identify.determined import MAX_INFLATION, inflation
from hqpipe.identify.normal_equations import NormalEquations
from hqpipe.identify.paper_model.problem import COEFFICIENTS
from hqpipe.identify.windows import JointData, Windows

_SUBSTANCE = 0.1  # share of its RMS that torque and error must have to count as an impact
_IMPACT_SHARE = 0.005  # of the samples
_IMPACT_WINDOWS = 10
_MOVES = 1e-9  # rad or m; less is no motion
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


def inseparable(at: NormalEquations, free: np.ndarray) -> dict[str, str]:
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
