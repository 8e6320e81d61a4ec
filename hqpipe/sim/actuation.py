"""The actuator model of a batch of robots during one physics step, with a record of the effort."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.actuators.loops.actuator_step import table_row, take_back
from hqpipe.actuators.loops.net_step import MLP, net_row


@njit(cache=True, nogil=True, forceinline=True)
def _hold(
    kind: int,
    limit: np.ndarray,
    tau: np.ndarray,
    memory: np.ndarray,
    mean_square: np.ndarray,
    clipped: np.ndarray,
    share: float,
) -> None:
    """Hold the demanded torque to the limit, and record it."""
    for j in range(tau.shape[0]):
        demand = tau[j]
        clipped[j] = max(clipped[j], abs(demand) - limit[j])
        tau[j] = min(max(demand, -limit[j]), limit[j])
        take_back(kind, memory[j], demand - tau[j])
        mean_square[j] += share * tau[j] * tau[j]


@njit(cache=True, nogil=True)
def actuate_robot(
    kind: int,
    parameters: np.ndarray,
    weights: np.ndarray,
    limit: np.ndarray,
    q_des: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    tau: np.ndarray,
    memory: np.ndarray,
    mean_square: np.ndarray,
    clipped: np.ndarray,
    share: float,
) -> None:
    """Torque of one robot from its present state; all arrays but the first two and `memory` are (J,).

    Args:
        kind: see hqpipe.actuators.loops.actuator_step.
        parameters: (J, P), with an infinite effort limit. weights: (W,) of a net, else empty.
        limit: N·m, applied here.
        tau: torque, read and overwritten, N·m.
        memory: (J, M) of the actuator model, read and overwritten.
        mean_square: grows by `share` times the square of the torque.
        clipped: grows to the largest excess of the demand over the limit.
    """
    if kind >= MLP:
        net_row(kind, parameters, weights, tau, memory, q_des, q, qd)
        _hold(kind, limit, tau, memory, mean_square, clipped, share)
    else:  # a path of its own: beside a net's, the compiler no longer inlines the short laws
        table_row(kind, parameters, tau, memory, q_des, q, qd)
        _hold(kind, limit, tau, memory, mean_square, clipped, share)


@njit(cache=True, nogil=True)
def actuate_batch(
    kind: int,
    parameters: np.ndarray,
    weights: np.ndarray,
    limit: np.ndarray,
    q_des: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    tau: np.ndarray,
    memory: np.ndarray,
    mean_square: np.ndarray,
    clipped: np.ndarray,
    share: float,
) -> None:
    """`actuate_robot` for every row: `parameters` (N, J, P), `weights` (W,), `memory` (N, J, M), the others (N, J)."""
    for n in range(tau.shape[0]):
        actuate_robot(
            kind,
            parameters[n],
            weights,
            limit[n],
            q_des[n],
            q[n],
            qd[n],
            tau[n],
            memory[n],
            mean_square[n],
            clipped[n],
            share,
        )
