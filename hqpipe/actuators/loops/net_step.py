"""One sample of a neural actuator model for a robot: one net for all joints, or a net of its own for each.

Inputs of a net are, channel after channel, torque, target, position and velocity of its J joints; in the paper's size
(48, 64, 12) we read the 48 as 4 signals of 12 joints. An MLP may also read them as they were some samples ago (taps). They are
standardised, go through one hidden layer, and come out as the torque one sample later or, with `delta`, as its change:

    MLP    h = softsign(W x + b)        (softsign: Hwangbo et al. 2019, for the cost of it)
    LSTM   Hochreiter and Schmidhuber 1997 with forget gate; gates in the order input, forget, cell, output
    GRU    Cho et al. 2014, reset gate after the recurrent product; gates in the order reset, update, new

`weights` is one array for all robots: the number of nets, which share the joints evenly, and then net after net hidden units,
delta, the number of taps, the taps; mean and 1/spread of the inputs, mean and spread of the outputs; then the matrices, input
by output, each followed by its bias.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from hqpipe.actuators.loops.laws import clip

MLP: Final = 4
LSTM: Final = 5
GRU: Final = 6
CHANNELS: Final = 4
NETS, FIRST_NET = 0, 1  # of all weights
HIDDEN, DELTA, TAPS, FIRST_TAP = range(4)  # of the weights of one net
LIMIT: Final = 0  # column of the parameter table
SEEN, RING = 0, 1  # columns of an MLP's memory: samples so far, and the ring of past inputs


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _sigmoid(x: float) -> float:
    """1/(1 + exp(-x)) to 1e-13, without a call, so that the compiler can take several units at once.

    The exponential by scaling and squaring (Moler and Van Loan 2003, method 3): Taylor's series of exp(y/1024), squared ten
    times. Beyond ±40 the result is 0 or 1 in double precision.
    """
    r = min(max(-x, -40.0), 40.0) / 1024.0
    e = 1.0 + r * (1.0 + r / 2.0 * (1.0 + r / 3.0 * (1.0 + r / 4.0 * (1.0 + r / 5.0 * (1.0 + r / 6.0)))))
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return 1.0 / (1.0 + e)


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _tanh(x: float) -> float:
    return 2.0 * _sigmoid(2.0 * x) - 1.0


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _add_product(x: np.ndarray, weights: np.ndarray, at: int, out: np.ndarray) -> int:
    """out += x W, with W (inputs, outputs) from `at` on; returns where W ends.

    Four inputs at a time: an output is then read and written once for four products.
    """
    size, inputs = out.shape[0], x.shape[0]
    matrix = weights[at : at + inputs * size].reshape(inputs, size)
    whole = inputs - inputs % 4
    for i in range(0, whole, 4):
        a, b, c, d = x[i], x[i + 1], x[i + 2], x[i + 3]
        of_a, of_b, of_c, of_d = matrix[i], matrix[i + 1], matrix[i + 2], matrix[i + 3]
        for o in range(size):
            out[o] += a * of_a[o] + b * of_b[o] + c * of_c[o] + d * of_d[o]
    for i in range(whole, inputs):
        value, row = x[i], matrix[i]
        for o in range(size):
            out[o] += value * row[o]
    return at + inputs * size


@njit(cache=True, nogil=True)
def _affine(x: np.ndarray, weights: np.ndarray, at: int, out: np.ndarray) -> int:
    """out = x W + b; returns where b ends."""
    bias = at + x.shape[0] * out.shape[0]
    out[:] = weights[bias : bias + out.shape[0]]
    return _add_product(x, weights, at, out) + out.shape[0]


@njit(cache=True, nogil=True)
def _read(
    weights: np.ndarray, tau: np.ndarray, memory: np.ndarray, q_des: np.ndarray, q: np.ndarray, qd: np.ndarray
) -> np.ndarray:
    """(taps · 4 J,) standardised inputs; the ring in `memory` takes up those of this sample.

    Before the first sample there was none: a tap that reaches further back reads the first one.
    """
    joints, taps = tau.shape[0], int(weights[TAPS])
    width = CHANNELS * joints
    mean, scale = FIRST_TAP + taps, FIRST_TAP + taps + width
    length = int(weights[FIRST_TAP + taps - 1]) + 1
    inputs = np.empty(taps * width)
    for j in range(joints):
        inputs[j], inputs[joints + j], inputs[2 * joints + j], inputs[3 * joints + j] = tau[j], q_des[j], q[j], qd[j]
    if length > 1:
        for j in range(joints):
            now = int(memory[j, SEEN])
            for c in range(CHANNELS):
                memory[j, RING + CHANNELS * (now % length) + c] = inputs[c * joints + j]
                for t in range(taps):
                    past = (now - min(int(weights[FIRST_TAP + t]), now)) % length
                    inputs[t * width + c * joints + j] = memory[j, RING + CHANNELS * past + c]
            memory[j, SEEN] = now + 1.0
    for t in range(taps):
        for i in range(width):
            inputs[t * width + i] = (inputs[t * width + i] - weights[mean + i]) * weights[scale + i]
    return inputs


@njit(cache=True, nogil=True)
def _write(parameters: np.ndarray, weights: np.ndarray, hidden: np.ndarray, at: int, tau: np.ndarray) -> None:
    """The output layer, whose matrix starts at `at`, and the effort limit."""
    joints, taps = tau.shape[0], int(weights[TAPS])
    mean = FIRST_TAP + taps + 2 * CHANNELS * joints
    out = np.empty(joints)
    _affine(hidden, weights, at, out)
    for j in range(joints):
        value = weights[mean + j] + weights[mean + joints + j] * out[j]
        tau[j] = clip(tau[j] + value if weights[DELTA] != 0.0 else value, parameters[j, LIMIT])


@njit(cache=True, nogil=True, error_model="numpy")
def _lstm(weights: np.ndarray, inputs: np.ndarray, at: int, state: np.ndarray) -> int:
    """Advance `state`, h and c one after the other; returns where the weights of the cell end."""
    units = state.shape[0] // 2
    gates, past = np.empty(4 * units), np.empty(4 * units)
    at = _affine(inputs, weights, at, gates)
    at = _affine(state[:units], weights, at, past)
    for u in range(4 * units):
        gates[u] += past[u]
    for u in range(units):
        cell = _tanh(gates[2 * units + u]) * _sigmoid(gates[u])
        cell += state[units + u] * _sigmoid(gates[units + u])
        state[units + u] = cell
        state[u] = _tanh(cell) * _sigmoid(gates[3 * units + u])
    return at


@njit(cache=True, nogil=True, error_model="numpy")
def _gru(weights: np.ndarray, inputs: np.ndarray, at: int, state: np.ndarray) -> int:
    """Advance the state h; returns where the weights of the cell end."""
    units = state.shape[0]
    gates, past = np.empty(3 * units), np.empty(3 * units)
    at = _affine(inputs, weights, at, gates)
    at = _affine(state, weights, at, past)
    for u in range(units):
        reset, update = _sigmoid(gates[u] + past[u]), _sigmoid(gates[units + u] + past[units + u])
        new = _tanh(gates[2 * units + u] + reset * past[2 * units + u])
        state[u] = new + update * (state[u] - new)
    return at


@njit(cache=True, nogil=True)
def net_row(
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
        kind: MLP, LSTM or GRU.
        parameters: (J, 1) effort limit, N·m.
        weights: (W,) see above.
        tau: (J,) joint torque, overwritten, N·m.
        memory: (J, M) past inputs or recurrent states; all zero before the first sample.
        q_des, q, qd: (J,) rad, rad, rad/s.
    """
    nets = int(weights[NETS])
    joints, size = tau.shape[0] // nets, (weights.shape[0] - FIRST_NET) // nets
    for n in range(nets):
        own, row = slice(n * joints, (n + 1) * joints), weights[FIRST_NET + n * size : FIRST_NET + (n + 1) * size]
        taps, units = int(row[TAPS]), int(row[HIDDEN])
        at = FIRST_TAP + taps + 2 * (CHANNELS + 1) * joints
        inputs = _read(row, tau[own], memory[own], q_des[own], q[own], qd[own])
        if kind == MLP:
            hidden = np.empty(units)
            at = _affine(inputs, row, at, hidden)
            for u in range(units):
                hidden[u] /= 1.0 + abs(hidden[u])
        else:
            state = memory[own].reshape(-1)[: 2 * units if kind == LSTM else units]
            at = _lstm(row, inputs, at, state) if kind == LSTM else _gru(row, inputs, at, state)
            hidden = state[:units]
        _write(parameters[own], row, hidden, at, tau[own])
