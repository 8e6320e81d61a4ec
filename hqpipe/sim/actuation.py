"""The actuator model of a batch of robots during one physics step, with a record of the effort."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.actuators.loops.actuator_step import table_row, take_back
from hqpipe.actuators.loops.net_step import MLP, ROBOTS, net_step


@njit(cache=True, nogil=True, inline="always")
def robots_at_once(kind: int) -> int:
    """How many robots an engine takes through a physics step together: several where they share the weights of a net."""
    return ROBOTS if kind >= MLP else 1


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
def actuate(
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
    """Torques of N robots from their present state; all arrays but the first two and `memory` are (N, J).

    Args:
        kind: see hqpipe.actuators.loops.actuator_step.
        parameters: (N, J, P), with an infinite effort limit. weights: (W,) of a net, else empty.
        limit: N·m, applied here.
        tau: torque, read and overwritten, N·m.
        memory: (N, J, M) of the actuator model, read and overwritten.
        mean_square: grows by `share` times the square of the torque.
        clipped: grows to the largest excess of the demand over the limit.
    """
    if kind >= MLP:
        net_step(kind, weights, tau, memory, q_des, q, qd)
        for n in range(tau.shape[0]):
            _hold(kind, limit[n], tau[n], memory[n], mean_square[n], clipped[n], share)
    else:  # a path of its own: beside a net's, the compiler no longer inlines the short laws
        for n in range(tau.shape[0]):
            table_row(kind, parameters[n], tau[n], memory[n], q_des[n], q[n], qd[n])
            _hold(kind, limit[n], tau[n], memory[n], mean_square[n], clipped[n], share)
