"""Free run of one servo joint in windows: the drive, friction that holds, and everything between them.

One step is drift, kick, drift (Verlet, second order). Drag that is linear in the speed is solved exactly within a step, dry
friction by projection: it takes as much speed as its impulse can and stops the joint where that is all of it, so that a joint
at rest stays at rest (Moreau's time stepping; Acary and Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, 2008).
"""

from __future__ import annotations

import numpy as np
from numba import njit

NAMES = (
    "gravity_sin",
    "gravity_cos",
    "offset",
    "delay_s",
    "friction_nm",
    "static_nm",
    "velocity_rad_s",
    "nm_s_per_rad",
    "coefficient",
    "gap",
    "compliance",
    "inverse_limit",
    "sag",
    "bias",
    "asymmetry",
    "drift",
    "position_1",
    "position_2",
    "velocity_square",
    "command_rate",
    "slow_share",
)
"""What the columns of `numbers` are, in their order."""
(
    GRAVITY_SIN,
    GRAVITY_COS,
    OFFSET,
    DELAY,
    COULOMB,
    STATIC,
    STRIBECK,
    VISCOUS,
    LOAD_FRICTION,
    GAP,
    COMPLIANCE,
    INVERSE_LIMIT,
    SAG,
    BIAS,
    ASYMMETRY,
    DRIFT,
    SHAPE_1,
    SHAPE_2,
    SQUARE,
    COMMAND_RATE,
    SLOW,
) = range(len(NAMES))
CONSTANTS = ("loop", "stall", "middle", "reach", "speed", "lower_shape", "slow_s")
"""Columns of `constants`: 1 where the drive closes a position loop and 0 where its duty is logged; torque at full duty;
middle and half width of the travel; largest speed; degree of the lower of the two position shapes; time constant of the slow
share, s."""
_LOOP, _STALL, _MIDDLE, _REACH, _SPEED, _LOWER, _SLOW_S = range(len(CONSTANTS))
_FASTEST = 1.2  # times the largest speed of the fit trials; assumption, as for the travel below
_FARTHEST = 1.2
INERTIA, GAIN, DRAG, LOAD_GRAVITY, STEP = range(5)
"""Columns of `trials`: inertia; torque per unit of the input; torque per speed that the drive takes; m g l of the known load;
s, time of a sample."""


@njit(cache=True, nogil=True, inline="always")
def _held_input(values: np.ndarray, first: int, at: float, width: float, smooth: bool) -> float:
    """Mean of an input over samples at … at + width.

    Args:
        values: (N,). first: index before which nothing is known; the value there counts for what came before.
        smooth: the input runs straight from sample to sample; otherwise each value is held until the next.
    """
    if smooth:
        middle = at + 0.5 * width
        k = int(np.floor(middle))
        share = middle - k
        a, b = max(k, first), min(max(k + 1, first), len(values) - 1)
        return values[a] + share * (values[b] - values[a])
    k = int(np.floor(at + 1e-9))
    beyond = at + width - (k + 1)
    a = values[max(k, first)]
    if beyond <= 1e-9:
        return a
    return a + beyond / width * (values[max(k + 1, first)] - a)


@njit(cache=True, nogil=True, inline="always")
def _resistance(
    q: float, v: float, load_gravity: float, gravity: float, phase: float, n: np.ndarray, constants: np.ndarray
) -> float:
    """Torque against the drive that depends on where the joint is, and on the square of its speed."""
    torque = n[OFFSET]
    if load_gravity != 0.0:
        torque += load_gravity * np.sin(q + n[BIAS])
    if gravity != 0.0:
        torque += gravity * np.sin(q + phase)
    if n[SHAPE_1] != 0.0 or n[SHAPE_2] != 0.0:
        z = (q - constants[_MIDDLE]) / constants[_REACH]
        z = min(max(z, -_FARTHEST), _FARTHEST)
        if constants[_LOWER] == 1.0:
            torque += n[SHAPE_1] * z + n[SHAPE_2] * (1.5 * z * z - 0.5)
        else:
            torque += n[SHAPE_1] * (1.5 * z * z - 0.5) + n[SHAPE_2] * (2.5 * z * z * z - 1.5 * z)
    if n[SQUARE] != 0.0:
        fast = min(
            max(v / constants[_SPEED], -_FASTEST), _FASTEST
        )  # a shape must not run away where nothing was fitted
        torque += n[SQUARE] * fast * abs(fast)
    return torque


@njit(cache=True, nogil=True, inline="always")
def _commanded(
    q: float,
    v: float,
    u: float,
    rate: float,
    time: float,
    gain: float,
    drag: float,
    n: np.ndarray,
    constants: np.ndarray,
) -> float:
    """Torque of the drive at rest: before what it loses with speed."""
    torque = gain * (u - q) if constants[_LOOP] == 1.0 else gain * u
    if n[COMMAND_RATE] != 0.0:
        torque += gain * n[COMMAND_RATE] * rate
    if n[DRIFT] != 0.0:
        torque *= max(1.0 + n[DRIFT] * time, 0.0)
    if n[ASYMMETRY] != 0.0:
        torque += n[ASYMMETRY] * abs(torque)
    if n[SAG] != 0.0:
        duty = torque / constants[_STALL]
        drawn = duty * (torque - drag * v) / constants[_STALL]
        torque /= 1.0 + n[SAG] * max(drawn, 0.0)
    if n[INVERSE_LIMIT] > 0.0 and constants[_LOOP] == 0.0:
        torque = min(max(torque, -1.0 / n[INVERSE_LIMIT]), 1.0 / n[INVERSE_LIMIT])
    return torque


@njit(cache=True, nogil=True, inline="always")
def _across_gap(slack: float, pull: float, gain: float, drag: float, h: float, n: np.ndarray, loop: float) -> float:
    """Where a drive that carries nothing but itself is in the gap after `h`.

    Args:
        slack: of the drive before the joint, −gap/2 … gap/2. pull: torque of the drive at slack 0.
        gain, drag: of the drive. loop: 1 where it holds its own position, and not that of the joint.
    """
    free = (drag * slack + h * pull) / (drag + h * gain * loop + 1e-12)
    return min(max(free, -0.5 * n[GAP]), 0.5 * n[GAP])


@njit(cache=True, nogil=True)
def simulate(
    numbers: np.ndarray,
    constants: np.ndarray,
    trials: np.ndarray,
    trial: np.ndarray,
    start: np.ndarray,
    first: np.ndarray,
    clock: np.ndarray,
    q0: np.ndarray,
    v0: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    inputs: np.ndarray,
    rates: np.ndarray,
    samples: int,
    substeps: int,
) -> np.ndarray:
    """Simulate every window from its initial state.

    Torques are in one unit throughout, whichever the scale of the joint is.

    Args:
        numbers: (len(NAMES),) shared by all trials. constants: (len(CONSTANTS),). trials: (R, 5) see `INERTIA` … `STEP`.
        trial: (M,) of each window. start: (M,) index of its first sample. first: (M,) index of the first sample of the
            stretch without gaps that it lies in. clock: (M,) s, time of its first sample since the trial began.
        q0, v0: (M,) initial state. position, velocity: (N,) as logged, which drive the memory of gaps, springs and slow shares
            up to the start of a window. inputs: (N,) position command, or duty × voltage. rates: (N,) smoothed rate of the
            command. samples: W of a window after the first. substeps: S of a sample.

    Returns:
        (M, W) position at samples 1 … W of each window.
    """
    windows = len(start)
    result = np.empty((windows, samples))
    n = numbers
    loop = constants[_LOOP]
    smooth = loop == 0.0
    half = 0.5 * n[GAP]
    gravity, phase = np.hypot(n[GRAVITY_SIN], n[GRAVITY_COS]), np.arctan2(n[GRAVITY_COS], n[GRAVITY_SIN])
    limited = n[INVERSE_LIMIT] > 0.0 and loop == 1.0
    limit = 1.0 / n[INVERSE_LIMIT] if limited else np.inf
    remembers = n[GAP] > 0.0 or n[COMPLIANCE] > 0.0 or n[SLOW] != 0.0
    for m in range(windows):
        inertia, gain, drag = trials[trial[m], INERTIA], trials[trial[m], GAIN], trials[trial[m], DRAG]
        load_gravity, dt = trials[trial[m], LOAD_GRAVITY], trials[trial[m], STEP]
        h, width, late = dt / substeps, 1.0 / substeps, n[DELAY] / dt
        slack, spring, slow = 0.0, 0.0, 0.0
        if remembers:
            began = max(start[m] - samples, first[m])
            for k in range(began, start[m]):
                u = _held_input(inputs, first[m], k - late, 1.0, smooth)
                s = _commanded(
                    position[k], velocity[k], u, rates[k], clock[m] + (k - start[m]) * dt, gain, drag, n, constants
                )
                if n[GAP] > 0.0:
                    slack = _across_gap(slack, s - drag * velocity[k], gain, drag, dt, n, loop)
                torque = s - gain * loop * slack - drag * velocity[k]
                if k == began:
                    spring, slow = torque, torque
                stiff = n[COMPLIANCE] * drag + dt * (1.0 + gain * loop * n[COMPLIANCE])
                spring = (n[COMPLIANCE] * drag * spring + dt * torque) / stiff
                slow += dt / constants[_SLOW_S] * (torque - slow)
            if began == start[m]:
                u = _held_input(inputs, first[m], start[m] - late, width, smooth)
                s = _commanded(q0[m], v0[m], u, rates[start[m]], clock[m], gain, drag, n, constants)
                spring = s - drag * v0[m]
                slow = spring
        # With a spring the drive's own motion takes part of its torque and of its drag.
        stiff = n[COMPLIANCE] * drag + h * (1.0 + gain * loop * n[COMPLIANCE])
        passed, kept = h / stiff, n[COMPLIANCE] * drag / stiff
        coupled = drag * passed
        decay, free_decay = (
            np.exp(-(coupled + n[VISCOUS]) * h / inertia),
            np.exp(-n[VISCOUS] * h / inertia),
        )
        kick = (1.0 - decay) / (coupled + n[VISCOUS]) if coupled + n[VISCOUS] > 1e-9 * inertia / h else h / inertia
        free_kick = (1.0 - free_decay) / n[VISCOUS] if n[VISCOUS] > 1e-9 * inertia / h else h / inertia
        q, v, before = q0[m], v0[m], v0[m]
        for i in range(samples):
            k = start[m] + i
            for j in range(substeps):
                at = k + j * width
                u = _held_input(inputs, first[m], at - late, width, smooth)
                time = clock[m] + (i + (j + 0.5) * width) * dt
                q += 0.5 * h * v
                s = _commanded(q, v, u, rates[k], time, gain, drag, n, constants)
                transmits = True
                if n[GAP] > 0.0:
                    slack = _across_gap(slack, s - drag * v, gain, drag, h, n, loop)
                    transmits = abs(slack) >= half
                    s -= gain * loop * slack
                s = passed * s + kept * spring
                halfway = 1.5 * v - 0.5 * before  # speed in the middle of the step, as it has been changing
                before = v
                torque = s - coupled * halfway
                spring = torque
                fast = True
                if not transmits:
                    s, torque, spring, fast = 0.0, 0.0, 0.0, False
                elif limited and abs(torque) > limit:
                    torque = min(max(torque, -limit), limit)
                    s, fast = torque, False
                if n[SLOW] != 0.0:
                    slow += h / constants[_SLOW_S] * (torque - slow)
                    s += n[SLOW] * (slow - torque)
                    torque += n[SLOW] * (slow - torque)
                s -= _resistance(q, v, load_gravity, gravity, phase, n, constants)
                friction = n[COULOMB] + n[LOAD_FRICTION] * abs(torque)
                if n[STATIC] > 0.0:
                    friction += n[STATIC] * np.exp(-((v / n[STRIBECK]) ** 2))
                gained = kick if fast else free_kick
                v = (decay if fast else free_decay) * v + gained * s
                taken = gained * friction
                if v > taken:
                    v -= taken
                elif v < -taken:
                    v += taken
                else:
                    v = 0.0
                q += 0.5 * h * v
            result[m, i] = q
    return result
