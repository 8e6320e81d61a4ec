"""Instrumental variables: regressors of a motion that the command alone makes, so that they know nothing of the noise.

In a closed loop the noise of the position passes through the controller into the torque, and through the derivatives into the
regressors: least squares are biased by what the two share (Janot, Vandanjon & Gautier 2014). The loop's response to the command
is identified as a linear one on Laguerre functions (Wahlberg 1991) and simulated from the command; the regressors of the
simulated motion are the instruments, and the fit takes the regressors as projected on them (two-stage least squares).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hqpipe.layers.joint_motion.bandwidth import derivative, low_passed, passed_noise
from hqpipe.layers.joint_motion.columns import View
from hqpipe.layers.joint_motion.first_fit import blocks, least_squares, standard_errors
from hqpipe.layers.joint_motion.motion import motion_of
from hqpipe.layers.joint_motion.prepared import BASE, BLOCK_S, FRICTION, Prepared
from hqpipe.layers.joint_motion.records import Part

if TYPE_CHECKING:
    from hqpipe.layers.joint_motion.joint_motion import MovingMachine

POLES = (0.5, 0.05)  # of the cut-off: loops from half to a twentieth of what the filter passes; assumption
TERMS = 8  # Laguerre functions of each pole
SIGNIFICANCE = 0.01  # of the Durbin–Wu–Hausman test
MATERIAL = 0.02  # change of the predicted torque, as a share of it, below which least squares stay
DOUBTFUL = (
    1e-3  # share of noise in a regressor below which it biases nothing: stiff loops raise its effect ten-fold or so
)
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


def instrumental_parts(machine: MovingMachine, data: Prepared, notes: list[str]) -> tuple[Part, Part] | None:
    """The parts, with the regressors of the fit projected on instruments where least squares are biased; else None.

    What is held out chooses nothing and keeps the regressors that were measured.
    """
    logs, dt, fit = machine.log_set, machine.dt, data.parts[0]
    if logs.control_mode != "position":
        return None
    commands = [t.trajectory.position_command[:, data.j] for t in logs.trials]
    if max(np.ptp(command) for command in commands) == 0.0:
        return None
    if noise_share(data, dt) < DOUBTFUL:
        return None
    measured = [t.trajectory.position[:, data.j] for t in logs.trials]
    used = [t.split == "fit" for t in logs.trials]
    paths = simulated(commands, measured, used, dt, data.band.cutoff)
    slow = 1e-6 * max(float(np.max(np.abs(r.view.own.velocity))) for r in data.records)
    records = []
    for record, path in zip(data.records, paths, strict=True):
        own = motion_of(path, dt, data.band.cutoff, slow)
        records.append(replace(record, view=View(own.position - data.mean, own, record.view.others)))
    instruments = data.filtered(records, dt)
    picked = data.group(*BASE, *FRICTION, "coupling")
    linear = np.setdiff1d(np.arange(fit.columns.shape[1]), data.group("stribeck"))
    z = instruments[0].columns[fit.keep]
    x, y = fit.columns[fit.keep], fit.output[fit.keep]
    doubtful = np.searchsorted(picked, data.group("inertia", "coulomb", "viscous"))
    block = blocks(fit.segment[fit.keep], fit.time[fit.keep], BLOCK_S)
    test = endogeneity(x[:, picked], z[:, linear], y, doubtful, block)
    if not test.biased:
        return None
    change = (test.instrumental / test.plain - 1.0)[doubtful]
    said = ", ".join(
        f"{name} {100.0 * c:+.0f} %" for name, c in zip(("inertia", "coulomb", "viscous"), change, strict=True)
    )
    if test.weak:
        notes.append(
            f"noise of the position may bias the estimates ({100.0 * noise_share(data, dt):.1g} % of the variance of the "
            "acceleration), and the command explains too little of the motion to check it with instruments"
        )
        return None
    notes.append(
        "the noise of the position in the closed loop biases least squares (Durbin–Wu–Hausman test, p "
        f"{test.p:.1g}): the regressors are projected on a motion simulated from the command ({said})"
    )
    columns = fit.columns.copy()
    own = np.arange(data.columns.own)
    columns[np.ix_(fit.keep, own)] = z[:, linear] @ projected(x[:, own], z[:, linear])
    return replace(fit, columns=columns), data.parts[1]


def noise_share(data: Prepared, dt: float) -> float:
    """Share of the variance of acceleration or velocity, the larger of the two, that the noise of the position makes."""
    fit = data.parts[0]
    shares = []
    for order, name in ((2, "inertia"), (1, "viscous")):
        size = float(np.mean(fit.columns[fit.keep, data.columns.one(name)] ** 2))
        shares.append(passed_noise(data.band, dt, data.low_pass.weights, order) ** 2 / max(size, np.finfo(float).tiny))
    return max(shares)
