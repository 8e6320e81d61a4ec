"""Compiled rigid-body dynamics of legs on a clamped trunk: mass matrix, bias torques, foot contact with a sprung plate.

Recursive Newton–Euler for the bias and sums over links for the mass matrix (Featherstone,
Rigid Body Dynamics Algorithms, 2008).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)

GRAVITY: Final = 9.81  # m/s²
PLATE_DAMPING: Final = 600.0  # N·s/m of a rubber-covered plate and a rubber foot; assumption
GRIP: Final = 1.5e5  # N/m, tangential stiffness of a rubber foot that sticks; assumption
FRICTION: Final = 0.7  # of rubber on a dry steel plate; assumption


class Body(NamedTuple):
    """Legs of equal make on a clamped trunk, z up; L legs of n joints.

    Attributes:
        origin: (L, n, 3) m, of each joint in the frame of the link before it. axis: (L, n, 3) of the joint, likewise.
        mass: (L, n) kg of each link. com: (L, n, 3) m, in the link's frame. inertia: (L, n, 3) kg·m² about it, along the
            frame's axes. foot: (L, 3) m, in the frame of the last link.
    """

    origin: np.ndarray
    axis: np.ndarray
    mass: np.ndarray
    com: np.ndarray
    inertia: np.ndarray
    foot: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def _cross(a, b, out) -> None:
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    out[0], out[1], out[2] = x, y, z


@njit(cache=True, nogil=True, error_model="numpy")
def _turn(frame, axis, angle: float, out) -> None:
    """`out` = `frame` turned by `angle` about `axis` of that frame (Rodrigues)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    d = 1.0 - c
    for i in range(3):
        f0, f1, f2 = frame[i, 0], frame[i, 1], frame[i, 2]
        out[i, 0] = f0 * (c + x * x * d) + f1 * (y * x * d + z * s) + f2 * (z * x * d - y * s)
        out[i, 1] = f0 * (x * y * d - z * s) + f1 * (c + y * y * d) + f2 * (z * y * d + x * s)
        out[i, 2] = f0 * (x * z * d + y * s) + f1 * (y * z * d - x * s) + f2 * (c + z * z * d)


@njit(cache=True, nogil=True, error_model="numpy")
def leg_terms(body, leg: int, q, dq, work, mass, bias, foot, jacobian) -> None:
    """Mass matrix, bias torques and foot of one leg.

    Args:
        body: `Body`. q, dq: (n,) rad, rad/s. work: (n, 15, 3) scratch. mass: (n, n) kg·m², written. bias: (n,) N·m of
            gravity and motion, written. foot: (3,) m, written. jacobian: (3, n) of the foot, written.
    """
    n = len(q)
    zero = work[0, 14]
    for j in range(n):
        row = work[j]
        frame, origin, axis, com, spin, turned, moved, pull = (
            row[0:3],
            row[3],
            row[4],
            row[5],
            row[6],
            row[7],
            row[8],
            row[9],
        )
        if j == 0:
            zero[:] = 0.0
            origin[:] = body.origin[leg, 0]
            axis[:] = body.axis[leg, 0]
            base = row[11:14]
            base[:] = 0.0
            for i in range(3):
                base[i, i] = 1.0
            _turn(base, body.axis[leg, 0], q[0], frame)
            spin[:] = axis * dq[0]
            turned[:] = 0.0
            moved[:] = 0.0
            moved[2] = GRAVITY
        else:
            last = work[j - 1]
            for i in range(3):
                origin[i] = last[3, i]
                axis[i] = 0.0
                for k in range(3):
                    origin[i] += last[i, k] * body.origin[leg, j, k]
                    axis[i] += last[i, k] * body.axis[leg, j, k]
            _turn(last[0:3], body.axis[leg, j], q[j], frame)
            spin[:] = last[6] + axis * dq[j]
            _cross(last[6], axis, turned)
            turned[:] = last[7] + turned * dq[j]
            arm = row[10]
            arm[:] = origin - last[3]
            _cross(last[6], arm, pull)
            _cross(last[6], pull, pull)
            _cross(last[7], arm, moved)
            moved[:] = last[8] + moved + pull
        for i in range(3):
            com[i] = origin[i]
            for k in range(3):
                com[i] += frame[i, k] * body.com[leg, j, k]
    _torques(body, leg, n, work, bias)
    _masses(body, leg, n, work, mass)
    last = work[n - 1]
    for i in range(3):
        foot[i] = last[3, i]
        for k in range(3):
            foot[i] += last[i, k] * body.foot[leg, k]
    for j in range(n):
        arm, column = work[j, 10], work[j, 11]
        arm[:] = foot - work[j, 3]
        _cross(work[j, 4], arm, column)
        for i in range(3):
            jacobian[i, j] = column[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _inertia_times(frame, principal, vector, out) -> None:
    """World-frame inertia times a vector."""
    a, b, c = 0.0, 0.0, 0.0
    for i in range(3):
        a += frame[i, 0] * vector[i]
        b += frame[i, 1] * vector[i]
        c += frame[i, 2] * vector[i]
    a, b, c = a * principal[0], b * principal[1], c * principal[2]
    for i in range(3):
        out[i] = frame[i, 0] * a + frame[i, 1] * b + frame[i, 2] * c


@njit(cache=True, nogil=True, error_model="numpy")
def _torques(body, leg: int, n: int, work, bias) -> None:
    """Backward pass: torques that hold the accelerations of the forward pass."""
    for j in range(n):
        bias[j] = 0.0
    for k in range(n):
        row = work[k]
        arm, force, couple, part = row[10], row[11], row[12], row[13]
        arm[:] = row[5] - row[3]
        _cross(row[6], arm, part)
        _cross(row[6], part, part)
        _cross(row[7], arm, force)
        force[:] = body.mass[leg, k] * (row[8] + force + part)
        _inertia_times(row[0:3], body.inertia[leg, k], row[6], part)
        _cross(row[6], part, couple)
        _inertia_times(row[0:3], body.inertia[leg, k], row[7], part)
        couple[:] = couple + part
        for j in range(k + 1):
            arm[:] = row[5] - work[j, 3]
            _cross(arm, force, part)
            for i in range(3):
                bias[j] += work[j, 4, i] * (part[i] + couple[i])


@njit(cache=True, nogil=True, error_model="numpy")
def _masses(body, leg: int, n: int, work, mass) -> None:
    for i in range(n):
        for j in range(n):
            mass[i, j] = 0.0
    for k in range(n):
        row = work[k]
        for j in range(k + 1):
            arm, lever = row[10], work[j, 11]
            arm[:] = row[5] - work[j, 3]
            _cross(work[j, 4], arm, lever)  # velocity of the centre of mass per speed of joint j
        for j in range(k + 1):
            part = row[13]
            _inertia_times(row[0:3], body.inertia[leg, k], work[j, 4], part)
            for i in range(j + 1):
                total = 0.0
                for a in range(3):
                    total += body.mass[leg, k] * work[i, 11, a] * work[j, 11, a] + work[i, 4, a] * part[a]
                mass[i, j] += total
                if i != j:
                    mass[j, i] += total


@njit(cache=True, nogil=True, error_model="numpy")
def invert(mass, out) -> None:
    """Inverse of a small symmetric positive definite matrix (Gauss–Jordan, no pivoting needed); `mass` is destroyed."""
    n = len(mass)
    for i in range(n):
        for j in range(n):
            out[i, j] = 1.0 if i == j else 0.0
    for i in range(n):
        pivot = 1.0 / mass[i, i]
        for j in range(n):
            mass[i, j] *= pivot
            out[i, j] *= pivot
        for k in range(n):
            if k != i:
                factor = mass[k, i]
                for j in range(n):
                    mass[k, j] -= factor * mass[i, j]
                    out[k, j] -= factor * out[i, j]


@njit(cache=True, nogil=True, error_model="numpy")
def plate_force(foot, speed, height: float, stiffness: float, anchor, force) -> None:
    """Force of a sprung plate on a foot, N; the plate only pushes, and friction holds the foot up to `FRICTION` times that.

    Args:
        foot, speed: (3,) m, m/s. height: of the plate, m. stiffness: N/m; 0 for no plate. anchor: (3,) where the foot
            sticks, and in [2] whether it touches; changed. force: (3,), written.
    """
    force[0] = force[1] = force[2] = 0.0
    depth = height - foot[2]
    if stiffness <= 0.0 or depth <= 0.0:
        anchor[2] = 0.0
        return
    if anchor[2] == 0.0:
        anchor[0], anchor[1], anchor[2] = foot[0], foot[1], 1.0
    push = max(stiffness * depth - PLATE_DAMPING * speed[2], 0.0)
    x, y = GRIP * (anchor[0] - foot[0]), GRIP * (anchor[1] - foot[1])
    held, most = np.sqrt(x * x + y * y), FRICTION * push
    if held > most:  # the foot slips, and its anchor with it
        share = most / held
        x, y = x * share, y * share
        anchor[0], anchor[1] = foot[0] + x / GRIP, foot[1] + y / GRIP
    force[0] = x - 0.3 * PLATE_DAMPING * speed[0] if held <= most else x
    force[1] = y - 0.3 * PLATE_DAMPING * speed[1] if held <= most else y
    force[2] = push
