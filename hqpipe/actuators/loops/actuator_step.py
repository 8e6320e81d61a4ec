"""One sample of an actuator model, for one joint, one robot or a batch of robots.

Every model is a kind, a row of float64 parameters per joint and, for a net, weights of the whole robot. The state is the
joint torque and, for some kinds, a row of memory per joint (delay lines, integrators, lags), so that the same compiled
functions serve the simulator, the replay of a log and the fit.

kind       parameters of a joint                  memory  torque after the sample
PD         kp, kd, limit                          none    kp (q_des − q) − kd q̇
HYDRAULIC  k1, k2, k3, k4, R, limit               none    eq. (7) of the paper
AUGMENTED  see hqpipe.machine.layout              M       eq. (7) with effects, hqpipe.machine.chain
CHAMBERS   see hqpipe.actuators.loops.chamber_step        M       two chambers of oil behind a servo valve
MLP        limit                                  M, or 0 hqpipe.actuators.loops.net_step
LSTM, GRU  limit                                  M       hqpipe.actuators.loops.net_step

All are clipped to ±limit, which may be infinite. A reset sets the torque and zeroes the memory: a kind with
memory takes all zeros for "no sample yet" and starts from the torque and the inputs of the first sample.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from hqpipe.actuators.loops.chamber_step import chamber_row
from hqpipe.actuators.loops.laws import clip, hydraulic_step, pd_step
from hqpipe.actuators.loops.net_step import LIMIT, MLP, ROBOTS, net_step
from hqpipe.machine.chain import loops
from hqpipe.machine.compose.rows import WOUND

PD: Final = 0
HYDRAULIC: Final = 1
AUGMENTED: Final = 2
CHAMBERS: Final = 3
augmented_row = loops().step_row
NO_WEIGHTS: Final = np.empty(0, np.float32)  # of a model that is its parameter table alone


@njit(cache=True, nogil=True)
def step_joint(kind: int, p: np.ndarray, torque: float, q_des: float, q: float, qd: float) -> float:
    """Torque of one joint after one sample.

    Args:
        kind: PD or HYDRAULIC; a kind with memory cannot be stepped without it.
        p: (P,) parameters of the joint.
        torque, q_des, q, qd: N·m, rad, rad, rad/s at this sample.

    Raises:
        ValueError: another kind.
    """
    if kind == HYDRAULIC:
        return hydraulic_step(p, torque, q_des, q, qd)
    if kind == PD:
        return pd_step(p, q_des, q, qd)
    raise ValueError("step_joint: expected the kind PD or HYDRAULIC; step the others with step_row and their memory")


@njit(cache=True, nogil=True)
def table_row(
    kind: int,
    parameters: np.ndarray,
    tau: np.ndarray,
    memory: np.ndarray,
    q_des: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
) -> None:
    """`step_row` for the kinds without weights: PD, HYDRAULIC, AUGMENTED and CHAMBERS."""
    if kind == HYDRAULIC:
        for j in range(tau.shape[0]):
            tau[j] = hydraulic_step(parameters[j], tau[j], q_des[j], q[j], qd[j])
    elif kind == AUGMENTED:
        augmented_row(parameters, tau, memory, q_des, q, qd)
    elif kind == CHAMBERS:
        chamber_row(parameters, tau, memory, q_des, q, qd)
    else:
        for j in range(tau.shape[0]):
            tau[j] = pd_step(parameters[j], q_des[j], q[j], qd[j])


@njit(cache=True, nogil=True)
def step_batch(
    kind: int,
    parameters: np.ndarray,
    weights: np.ndarray,
    tau: np.ndarray,
    memory: np.ndarray,
    q_des: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
) -> None:
    """Advance N robots by one sample, in place.

    Args:
        kind: as in `step_row`.
        parameters, weights: (J, P) float64 and (W,) float32, the same for every robot.
        tau: (N, J) torque, read and overwritten, N·m.
        memory: (N, J, M) float64, likewise.
        q_des, q, qd: (N, J) rad, rad, rad/s.
    """
    if kind >= MLP:
        for first in range(0, tau.shape[0], ROBOTS):
            some = slice(first, first + ROBOTS)
            net_step(kind, weights, tau[some], memory[some], q_des[some], q[some], qd[some])
        for n in range(tau.shape[0]):
            for j in range(tau.shape[1]):
                tau[n, j] = clip(tau[n, j], parameters[j, LIMIT])
    else:  # a loop of its own: beside a net's, the compiler no longer inlines the short laws
        for n in range(tau.shape[0]):
            table_row(kind, parameters, tau[n], memory[n], q_des[n], q[n], qd[n])


@njit(cache=True, nogil=True)
def step_row(
    kind: int,
    parameters: np.ndarray,
    weights: np.ndarray,
    tau: np.ndarray,
    memory: np.ndarray,
    q_des: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
) -> None:
    """Advance the joints of one robot by one sample, in place.

    Args:
        kind: PD, HYDRAULIC, AUGMENTED, CHAMBERS, MLP, LSTM or GRU.
        parameters: (J, P) float64.
        weights: (W,) float32 of a net; `NO_WEIGHTS` for the other kinds.
        tau: (J,) torque, read and overwritten, N·m.
        memory: (J, M) float64, read and overwritten; zeros after a reset, M = 0 for a kind without memory.
        q_des, q, qd: (J,) rad, rad, rad/s.
    """
    if kind >= MLP:
        one = (1, tau.shape[0])
        driven = q_des.reshape(one), q.reshape(one), qd.reshape(one)
        step_batch(kind, parameters, weights, tau.reshape(one), memory.reshape((1, *memory.shape)), *driven)
    else:
        table_row(kind, parameters, tau, memory, q_des, q, qd)


@njit(cache=True, nogil=True, inline="always")
def take_back(kind: int, memory: np.ndarray, excess: float) -> None:
    """Tell a joint that `excess` (N·m) of its torque was not applied; `memory` is its row (M,).

    The other kinds go on from the torque that they are given and need not be told.
    """
    if kind == AUGMENTED:
        memory[WOUND] -= excess
