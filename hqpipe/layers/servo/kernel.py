"""Free run of one servo joint in windows: the drive, friction that holds, and everything between them.

One step is drift, kick, drift (Verlet, second order). Drag that is linear in the speed is solved exactly within a step, dry
friction by projection: it takes as much speed as its impulse can and stops the joint where that is all of it, so that a joint
at rest stays at rest (Moreau's time stepping; Acary and Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, 2008).
"""

from __future__ import annotations

import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)

NAMES = (
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
    "back_emf_share",
    "sag",
    "bias",
    "asymmetry",
    "drift",
    "position_1",
    "position_2",
    "velocity_square",
    "command_lead",
    "damps_error",
    "slow_share",
    "coupling",
)
"""What the columns of `numbers` are, in their order."""
(
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
    BACK_EMF_SHARE,
    SAG,
    BIAS,
    ASYMMETRY,
    DRIFT,
    SHAPE_1,
    SHAPE_2,
    SQUARE,
    COMMAND_LEAD,
    DAMPS_ERROR,
    SLOW,
    COUPLING,
) = range(len(NAMES))
CONSTANTS = ("loop", "stall", "middle", "reach", "speed", "lower_shape", "slow_s")
"""Columns of `constants`: 1 where the drive closes a position loop and 0 where its duty is logged; torque at full duty;
middle and half width of the travel; largest speed; degree of the lower of the two position shapes; time constant of the slow
share, s."""
_LOOP, _STALL, _MIDDLE, _REACH, _SPEED, _LOWER, _SLOW_S = range(len(CONSTANTS))
_FASTEST = 1.2  # times the largest speed of the fit trials; assumption, as for the travel below
_FARTHEST = 1.2
INERTIA, GAIN, DRAG, LOAD_GRAVITY, MOUNTING, GRAVITY_SIN, GRAVITY_COS, STEP = range(8)
"""Columns of `trials`: inertia; torque per unit of the input; torque per speed that the drive takes; m g l of the known load
and the angle by which it hangs beside 0, rad; sine and cosine term of an unknown load; s, time of a sample."""


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
        a, b = min(max(k, first), len(values) - 1), min(max(k + 1, first), len(values) - 1)
        return values[a] + share * (values[b] - values[a])
    k = int(np.floor(at + 1e-9))
    beyond = at + width - (k + 1)
    a = values[min(max(k, first), len(values) - 1)]
    if beyond <= 1e-9:
        return a
    return a + beyond / width * (values[min(max(k + 1, first), len(values) - 1)] - a)


@njit(cache=True, nogil=True, inline="always")
def _lateness(n: np.ndarray) -> float:
    """s by which an input counts after its row; less than 0 where it counts before it."""
    return n[DELAY] - n[COMMAND_LEAD]


@njit(cache=True, nogil=True, inline="always")
def _resistance(
    q: float, v: float, drive: np.ndarray, gravity: float, phase: float, n: np.ndarray, constants: np.ndarray
) -> float:
    """Torque against the drive that depends on where the joint is, and on the square of its speed."""
    torque = n[OFFSET]
    if drive[LOAD_GRAVITY] != 0.0:
        torque += drive[LOAD_GRAVITY] * np.sin(q + drive[MOUNTING])
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
    drive: np.ndarray,
    n: np.ndarray,
    constants: np.ndarray,
) -> float:
    """Torque of the drive at rest: before what it loses with speed."""
    gain, drag = drive[GAIN], drive[DRAG]
    torque = gain * (u + n[BIAS] - q) if constants[_LOOP] == 1.0 else gain * u
    if n[DAMPS_ERROR] != 0.0:
        torque += n[DAMPS_ERROR] * drag * rate
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
def _remembered(
    n: np.ndarray,
    constants: np.ndarray,
    drive: np.ndarray,
    start: int,
    first: int,
    clock: float,
    position: np.ndarray,
    velocity: np.ndarray,
    inputs: np.ndarray,
    rates: np.ndarray,
    samples: int,
) -> tuple[float, float, float]:
    """Slack, torque in the spring and slow torque where a window starts, after up to `samples` samples of the log before it."""
    gain, drag, dt, loop = drive[GAIN], drive[DRAG], drive[STEP], constants[_LOOP]
    slack, spring, slow, late = 0.0, 0.0, 0.0, _lateness(n) / dt
    stiff = n[COMPLIANCE] * drag + dt * (1.0 + gain * loop * n[COMPLIANCE])
    began = max(start - samples, first)
    for k in range(began, max(start, began + 1)):
        u = _held_input(inputs, first, k - late, 1.0, loop == 0.0)
        rate = _held_input(rates, first, k - late, 1.0, True) if n[DAMPS_ERROR] != 0.0 else 0.0
        torque = _commanded(position[k], velocity[k], u, rate, clock + (k - start) * dt, drive, n, constants)
        if n[GAP] > 0.0:
            slack = _across_gap(slack, torque - drag * velocity[k], gain, drag, dt, n, loop)
        torque -= gain * loop * slack + drag * velocity[k]
        if k == began:
            spring, slow = torque, torque
        spring = (n[COMPLIANCE] * drag * spring + dt * torque) / stiff
        slow += dt / constants[_SLOW_S] * (torque - slow)
    return slack, spring, slow


@njit(cache=True, nogil=True, inline="always")
def _decay(drag: float, inertia: float, h: float) -> tuple[float, float]:
    """What a step leaves of a speed, and what speed a torque gives in it."""
    decay = np.exp(-drag * h / inertia)
    return decay, (1.0 - decay) / drag if drag > 1e-9 * inertia / h else h / inertia


@njit(cache=True, nogil=True, inline="always")
def _after_friction(v: float, gained: float, torque: float, n: np.ndarray) -> float:
    """Speed after dry friction, which stops the joint where it can.

    Args:
        v: after the step without it. gained: speed that a torque gives in the step. torque: transmitted.
    """
    friction = n[COULOMB] + n[LOAD_FRICTION] * abs(torque)
    if n[STATIC] > 0.0:
        friction += n[STATIC] * np.exp(-((v / n[STRIBECK]) ** 2))
    taken = gained * friction
    if v > taken:
        return v - taken
    if v < -taken:
        return v + taken
    return 0.0


@njit(cache=True, nogil=True, inline="always")
def _transmitted(
    s: float,
    v: float,
    before: float,
    slack: float,
    spring: float,
    h: float,
    drive: np.ndarray,
    n: np.ndarray,
    loop: float,
) -> tuple[float, float, float, float, float]:
    """What gap, spring and limit leave of the torque `s` of the drive.

    Args:
        v, before: speed in this step and in the last. slack, spring: state of the gap, and torque in the spring.

    Returns:
        Torque at rest, torque with drag, slack, torque in the spring, and the drag that remains as a factor of the speed.
    """
    gain, drag = drive[GAIN], drive[DRAG]
    middle = 1.5 * v - 0.5 * before  # speed in the middle of the step, as it has been changing
    if n[GAP] > 0.0:
        slack = _across_gap(slack, s - drag * v, gain, drag, h, n, loop)
        if abs(slack) < 0.5 * n[GAP]:
            return 0.0, 0.0, slack, 0.0, 0.0
        s -= gain * loop * slack
    if n[COMPLIANCE] > 0.0:  # the drive's own motion takes part of its torque and of its drag
        stiff = n[COMPLIANCE] * drag + h * (1.0 + gain * loop * n[COMPLIANCE])
        s = (h * s + n[COMPLIANCE] * drag * spring) / stiff
        drag *= h / stiff
    torque = s - drag * middle
    spring = torque
    if n[INVERSE_LIMIT] > 0.0 and loop == 1.0:
        beyond = n[BACK_EMF_SHARE] * drag
        held = s - (drag - beyond) * middle
        if abs(held) * n[INVERSE_LIMIT] > 1.0:
            s = np.sign(held) / n[INVERSE_LIMIT]
            return s, s - beyond * middle, slack, spring, beyond
    return s, torque, slack, spring, drag


@njit(cache=True, nogil=True)
def _run(
    result: np.ndarray,
    n: np.ndarray,
    constants: np.ndarray,
    drive: np.ndarray,
    start: int,
    first: int,
    clock: float,
    state: tuple[float, float],
    memory: tuple[float, float, float],
    inputs: np.ndarray,
    rates: np.ndarray,
    coupling: np.ndarray,
    substeps: int,
) -> None:
    """Simulate one window into `result` (W,), see `simulate`."""
    q, v = state
    slack, spring, slow = memory
    dt, loop, before, left = drive[STEP], constants[_LOOP], v, -1.0
    h, width, late = dt / substeps, 1.0 / substeps, _lateness(n) / dt
    gravity, phase = (
        np.hypot(drive[GRAVITY_SIN], drive[GRAVITY_COS]),
        np.arctan2(drive[GRAVITY_COS], drive[GRAVITY_SIN]),
    )
    decay, kick = 0.0, 0.0
    for i in range(len(result)):
        for j in range(substeps):
            at = start + i + j * width
            u = _held_input(inputs, first, at - late, width, loop == 0.0)
            rate = _held_input(rates, first, at - late, width, True) if n[DAMPS_ERROR] != 0.0 else 0.0
            q += 0.5 * h * v
            s = _commanded(q, v, u, rate, clock + (i + (j + 0.5) * width) * dt, drive, n, constants)
            s, torque, slack, spring, drag = _transmitted(s, v, before, slack, spring, h, drive, n, loop)
            before = v
            if n[SLOW] != 0.0:
                slow += h / constants[_SLOW_S] * (torque - slow)
                s += n[SLOW] * (slow - torque)
                torque += n[SLOW] * (slow - torque)
            s -= _resistance(q, v, drive, gravity, phase, n, constants)
            if n[COUPLING] != 0.0:
                s -= n[COUPLING] * _held_input(coupling, first, at, width, True)
            if drag != left:
                left = drag
                decay, kick = _decay(drag + n[VISCOUS], drive[INERTIA], h)
            v = _after_friction(decay * v + kick * s, kick, torque, n)
            q += 0.5 * h * v
        result[i] = q


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
    coupling: np.ndarray,
    samples: int,
    substeps: int,
) -> np.ndarray:
    """Simulate every window from its initial state.

    Torques are in one unit throughout, whichever the scale of the joint is.

    Args:
        numbers: (len(NAMES),) shared by all trials. constants: (len(CONSTANTS),). trials: (R, 8) see `INERTIA` … `STEP`.
        trial: (M,) of each window. start: (M,) index of its first sample. first: (M,) index of the first sample of the
            stretch without gaps that it lies in. clock: (M,) s, time of its first sample since the trial began.
        q0, v0: (M,) initial state. position, velocity: (N,) as logged, which drive the memory of gaps, springs and slow shares
            up to the start of a window. inputs: (N,) position command, or duty × voltage. rates: (N,) smoothed rate of the
            command. coupling: (N,) torque against the drive from other joints, of which `numbers` has the share.
        samples: W of a window after the first. substeps: S of a sample.

    Returns:
        (M, W) position at samples 1 … W of each window.
    """
    windows = len(start)
    result = np.empty((windows, samples))
    remembers = numbers[GAP] > 0.0 or numbers[COMPLIANCE] > 0.0 or numbers[SLOW] != 0.0
    for m in range(windows):
        drive, memory = trials[trial[m]], (0.0, 0.0, 0.0)
        if remembers:
            memory = _remembered(
                numbers, constants, drive, start[m], first[m], clock[m], position, velocity, inputs, rates, samples
            )
        state = (q0[m], v0[m])
        _run(
            result[m],
            numbers,
            constants,
            drive,
            start[m],
            first[m],
            clock[m],
            state,
            memory,
            inputs,
            rates,
            coupling,
            substeps,
        )
    return result
