"""One sample of a neural actuator model for some robots: one net for all joints, or a net of its own for each.

Inputs of a net are, channel after channel, torque, target, position and velocity of its J joints; in the paper's size
(48, 64, 12) we read the 48 as 4 signals of 12 joints. An MLP may also read them as they were some samples ago (taps). They are
standardised, go through one hidden layer, and come out as the torque one sample later or, with `delta`, as its change:

    MLP    h = softsign(W x + b)        (softsign: Hwangbo et al. 2019, for the cost of it)
    LSTM   Hochreiter and Schmidhuber 1997 with forget gate; gates in the order input, forget, cell, output
    GRU    Cho et al. 2014, reset gate after the recurrent product; gates in the order reset, update, new

A net is computed in single precision, as torch trained it: a vector instruction then takes twice as many units. Torques and
what is remembered stay in double precision.

`weights` is one array for all robots: the number of nets, which share the joints evenly, and then net after net hidden units,
delta, the number of taps, the taps; mean and 1/spread of the inputs, mean and spread of the outputs; then the matrices, input
by output, each followed by its bias.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit

MLP: Final = 4
LSTM: Final = 5
GRU: Final = 6
CHANNELS: Final = 4
NETS, FIRST_NET = 0, 1  # of all weights
HIDDEN, DELTA, TAPS, FIRST_TAP = range(4)  # of the weights of one net
LIMIT: Final = 0  # column of the parameter table
SINGLE: Final = np.float32
ROBOTS: Final = 16  # at once: what they work with and four rows of weights stay in the cache; 8 to 32 measure alike
SEEN, RING = 0, 1  # columns of an MLP's memory: samples so far, and the ring of past inputs
ONE: Final = SINGLE(1.0)
TWO: Final = SINGLE(2.0)
LARGEST: Final = SINGLE(20.0)
"""Of the argument of an exponential: beyond ±17 a sigmoid is 0 or 1 in single precision."""
HALVINGS: Final = SINGLE(1.0 / 32.0)
TAYLOR: Final = tuple(SINGLE(1.0 / math.factorial(n)) for n in range(8))


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _sigmoid(x: float) -> float:
    """1/(1 + exp(-x)) to 1e-6, without a call or a table, so that the compiler can take several units at once.

    The exponential by scaling and squaring (Moler and Van Loan 2003, method 3): Taylor's series of exp(y/32), squared five
    times.
    """
    r = min(max(-x, -LARGEST), LARGEST) * HALVINGS
    e = TAYLOR[4] + r * (TAYLOR[5] + r * (TAYLOR[6] + r * TAYLOR[7]))
    e = ONE + r * (ONE + r * (TAYLOR[2] + r * (TAYLOR[3] + r * e)))
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return ONE / (ONE + e)


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _tanh(x: float) -> float:
    return TWO * _sigmoid(TWO * x) - ONE


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _affine(x: np.ndarray, weights: np.ndarray, at: int, out: np.ndarray) -> int:
    """out = x W + b, with x (N, I), W (I, O) from `at` on and b behind it; returns where b ends.

    Four inputs of two robots at a time: an output is then read and written once for four products, and a weight read once for
    two.
    """
    robots, inputs = x.shape
    size = out.shape[1]
    end = at + inputs * size
    matrix, bias = weights[at:end].reshape(inputs, size), weights[end : end + size]
    for n in range(robots):
        for o in range(size):
            out[n, o] = bias[o]
    whole, pairs = inputs - inputs % 4, robots - robots % 2
    for i in range(0, whole, 4):
        of_a, of_b, of_c, of_d = matrix[i], matrix[i + 1], matrix[i + 2], matrix[i + 3]
        for n in range(0, pairs, 2):
            a, b, c, d = x[n, i], x[n, i + 1], x[n, i + 2], x[n, i + 3]
            e, f, g, h = x[n + 1, i], x[n + 1, i + 1], x[n + 1, i + 2], x[n + 1, i + 3]
            sums, others = out[n], out[n + 1]
            for o in range(size):
                sums[o] += a * of_a[o] + b * of_b[o] + c * of_c[o] + d * of_d[o]
                others[o] += e * of_a[o] + f * of_b[o] + g * of_c[o] + h * of_d[o]
        for n in range(pairs, robots):
            a, b, c, d = x[n, i], x[n, i + 1], x[n, i + 2], x[n, i + 3]
            sums = out[n]
            for o in range(size):
                sums[o] += a * of_a[o] + b * of_b[o] + c * of_c[o] + d * of_d[o]
    for i in range(whole, inputs):
        row = matrix[i]
        for n in range(robots):
            value, sums = x[n, i], out[n]
            for o in range(size):
                sums[o] += value * row[o]
    return end + size


@njit(cache=True, nogil=True)
def _read(
    weights: np.ndarray, tau: np.ndarray, memory: np.ndarray, q_des: np.ndarray, q: np.ndarray, qd: np.ndarray
) -> np.ndarray:
    """(N, taps · 4 J) standardised inputs; the ring in `memory` takes up those of this sample.

    Before the first sample there was none: a tap that reaches further back reads the first one.
    """
    (robots, joints), taps = tau.shape, int(weights[TAPS])
    width = CHANNELS * joints
    mean, scale = FIRST_TAP + taps, FIRST_TAP + taps + width
    length = int(weights[FIRST_TAP + taps - 1]) + 1
    inputs = np.empty((robots, taps * width), SINGLE)
    for j in range(joints):
        a, b, c, d = j, joints + j, 2 * joints + j, 3 * joints + j
        for n in range(robots):
            inputs[n, a] = (tau[n, j] - weights[mean + a]) * weights[scale + a]
            inputs[n, b] = (q_des[n, j] - weights[mean + b]) * weights[scale + b]
            inputs[n, c] = (q[n, j] - weights[mean + c]) * weights[scale + c]
            inputs[n, d] = (qd[n, j] - weights[mean + d]) * weights[scale + d]
    if length == 1:
        return inputs
    for n in range(robots):
        now = int(memory[n, 0, SEEN])
        place = now % length
        for j in range(joints):
            seen, at = memory[n, j], RING + CHANNELS * place
            seen[SEEN] = now + 1.0
            seen[at], seen[at + 1], seen[at + 2], seen[at + 3] = tau[n, j], q_des[n, j], q[n, j], qd[n, j]
        for t in range(1, taps):
            past = place - min(int(weights[FIRST_TAP + t]), now)
            at = RING + CHANNELS * (past if past >= 0 else past + length)
            for j in range(joints):
                for channel in range(CHANNELS):
                    i = channel * joints + j
                    inputs[n, t * width + i] = (memory[n, j, at + channel] - weights[mean + i]) * weights[scale + i]
    return inputs


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _single_output(x: np.ndarray, weights: np.ndarray, at: int, out: np.ndarray) -> None:
    """`_affine` with one output, whose sums may be taken in any order: there is no second output to take beside it."""
    row = weights[at : at + x.shape[1]]
    for n in range(x.shape[0]):
        total = weights[at + x.shape[1]]
        for i in range(x.shape[1]):
            total += x[n, i] * row[i]
        out[n, 0] = total


@njit(cache=True, nogil=True)
def _write(weights: np.ndarray, hidden: np.ndarray, at: int, tau: np.ndarray) -> None:
    """The output layer, whose matrix starts at `at`; hidden: (N, H). tau: (N, J)."""
    (robots, joints), taps = tau.shape, int(weights[TAPS])
    mean = FIRST_TAP + taps + 2 * CHANNELS * joints
    out = np.empty((robots, joints), SINGLE)
    if joints == 1:
        _single_output(hidden, weights, at, out)
    else:
        _affine(hidden, weights, at, out)
    for n in range(robots):
        for j in range(joints):
            value = weights[mean + j] + weights[mean + joints + j] * out[n, j]
            tau[n, j] = tau[n, j] + value if weights[DELTA] != 0.0 else value


@njit(cache=True, nogil=True, error_model="numpy")
def _mlp(weights: np.ndarray, inputs: np.ndarray, at: int, hidden: np.ndarray) -> int:
    """Fill `hidden`, (N, H); returns where the weights of the layer end."""
    at = _affine(inputs, weights, at, hidden)
    flat = hidden.reshape(-1)
    for u in range(flat.shape[0]):
        flat[u] /= ONE + abs(flat[u])
    return at


@njit(cache=True, nogil=True, error_model="numpy")
def _lstm(weights: np.ndarray, inputs: np.ndarray, at: int, hidden: np.ndarray, cell: np.ndarray) -> int:
    """Advance the states h and c, (N, H); returns where the weights of the cell end."""
    robots, units = hidden.shape
    gates, past = np.empty((robots, 4 * units), SINGLE), np.empty((robots, 4 * units), SINGLE)
    at = _affine(inputs, weights, at, gates)
    at = _affine(hidden, weights, at, past)
    for n in range(robots):
        now, before, h, c = gates[n], past[n], hidden[n], cell[n]
        for g in range(4 * units):
            now[g] += before[g]
        for u in range(units):
            new = _tanh(now[2 * units + u]) * _sigmoid(now[u]) + c[u] * _sigmoid(now[units + u])
            c[u] = new
            h[u] = _tanh(new) * _sigmoid(now[3 * units + u])
    return at


@njit(cache=True, nogil=True, error_model="numpy")
def _gru(weights: np.ndarray, inputs: np.ndarray, at: int, hidden: np.ndarray) -> int:
    """Advance the state h, (N, H); returns where the weights of the cell end."""
    robots, units = hidden.shape
    gates, past = np.empty((robots, 3 * units), SINGLE), np.empty((robots, 3 * units), SINGLE)
    at = _affine(inputs, weights, at, gates)
    at = _affine(hidden, weights, at, past)
    for n in range(robots):
        now, before, h = gates[n], past[n], hidden[n]
        for u in range(units):
            reset, update = _sigmoid(now[u] + before[u]), _sigmoid(now[units + u] + before[units + u])
            new = _tanh(now[2 * units + u] + reset * before[2 * units + u])
            h[u] = new + update * (h[u] - new)
    return at


@njit(cache=True, nogil=True)
def _recall(memory: np.ndarray, first: int, state: np.ndarray) -> None:
    """Read recurrent states (N, H) out of the memory (N, J M) of a robot's joints, end to end, from number `first` on."""
    for n in range(state.shape[0]):
        for u in range(state.shape[1]):
            state[n, u] = memory[n, first + u]


@njit(cache=True, nogil=True)
def _keep(memory: np.ndarray, first: int, state: np.ndarray) -> None:
    """The inverse of `_recall`."""
    for n in range(state.shape[0]):
        for u in range(state.shape[1]):
            memory[n, first + u] = state[n, u]


@njit(cache=True, nogil=True)
def net_step(
    kind: int,
    weights: np.ndarray,
    tau: np.ndarray,
    memory: np.ndarray,
    q_des: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
) -> None:
    """Advance N robots by one sample, in place; best some `ROBOTS` of them. The effort limit is left to the caller.

    Args:
        kind: MLP, LSTM or GRU.
        weights: (W,) float32, see above.
        tau: (N, J) joint torque, overwritten, N·m.
        memory: (N, J, M) past inputs or recurrent states; all zero before the first sample.
        q_des, q, qd: (N, J) rad, rad, rad/s.
    """
    nets, robots = int(weights[NETS]), tau.shape[0]
    joints, size = tau.shape[1] // nets, (weights.shape[0] - FIRST_NET) // nets
    states = memory.reshape(robots, memory.shape[1] * memory.shape[2])
    for n in range(nets):
        own, row = slice(n * joints, (n + 1) * joints), weights[FIRST_NET + n * size : FIRST_NET + (n + 1) * size]
        taps, units = int(row[TAPS]), int(row[HIDDEN])
        at = FIRST_TAP + taps + 2 * (CHANNELS + 1) * joints
        inputs = _read(row, tau[:, own], memory[:, own], q_des[:, own], q[:, own], qd[:, own])
        hidden, kept = np.empty((robots, units), SINGLE), n * joints * memory.shape[2]
        if kind == MLP:
            at = _mlp(row, inputs, at, hidden)
        else:
            _recall(states, kept, hidden)
            if kind == LSTM:
                cell = np.empty((robots, units), SINGLE)
                _recall(states, kept + units, cell)
                at = _lstm(row, inputs, at, hidden, cell)
                _keep(states, kept + units, cell)
            else:
                at = _gru(row, inputs, at, hidden)
            _keep(states, kept, hidden)
        _write(row, hidden, at, tau[:, own])
