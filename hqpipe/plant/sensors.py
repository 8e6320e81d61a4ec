"""What the machine's own sensors report: quantised, noisy, filtered, biased and late."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

PRESSURE_A: Final = 0
PRESSURE_B: Final = 1
TENSION_A: Final = 2
TENSION_B: Final = 3
CHANNELS: Final = 4
"""Rows of the history of true signals, and columns of the noise."""

READING = np.dtype(
    [
        (name, np.float64)
        for name in ("position velocity pressure_a pressure_b effort effort_logged last_position primed").split()
    ],
    align=True,
)
"""Per joint: rad, rad/s, Pa, Pa, N·m for the firmware, N·m for the log; then the filter's memory."""


@njit(cache=True, nogil=True, inline="always")
def quantise(value: float, resolution: float) -> float:
    """Round to counts of `resolution`; zero means no rounding."""
    return np.round(value / resolution) * resolution if resolution > 0.0 else value


@njit(cache=True, nogil=True, inline="always")
def past(history, head: int, age: float, channel: int, j: int) -> float:
    """Signal `age` samples ago by linear interpolation; `head` is the row of the newest sample."""
    rows, whole = history.shape[0], int(np.floor(age))
    part = age - whole
    newer = history[(head - whole) % rows, channel, j]
    older = history[(head - whole - 1) % rows, channel, j]
    return newer + part * (older - newer)


@njit(cache=True, nogil=True, inline="always")
def torque_reading(p, history, head: int, age: float, load_cell: bool, noise, j: int) -> float:
    """Joint torque from two pressures or from two load cells, N·m, with the sensor's scale and bias."""
    if load_cell:
        pull = quantise(
            past(history, head, age, TENSION_A, j) + p.sensors_load_cell_noise * noise[j, TENSION_A],
            p.sensors_load_cell_resolution,
        ) - quantise(
            past(history, head, age, TENSION_B, j) + p.sensors_load_cell_noise * noise[j, TENSION_B],
            p.sensors_load_cell_resolution,
        )
    else:
        pull = p.firmware_area * (
            quantise(
                past(history, head, age, PRESSURE_A, j) + p.sensors_pressure_noise * noise[j, PRESSURE_A],
                p.sensors_pressure_resolution,
            )
            - quantise(
                past(history, head, age, PRESSURE_B, j) + p.sensors_pressure_noise * noise[j, PRESSURE_B],
                p.sensors_pressure_resolution,
            )
        )
    return p.sensors_effort_scale * p.radius * pull + p.sensors_effort_bias


@njit(cache=True, nogil=True)
def read_joints(
    joint, reading, angles, history, head: int, spacing: float, tick: float, load_cell: bool, noise
) -> None:
    """Fill `reading` for one firmware tick.

    Args:
        joint: parameter records (J,).
        reading: (J,) `READING`, changed in place.
        angles: (J,) true joint angles, rad.
        history: (H, 4, J) ring of true pressures and tensions, `spacing` s apart, newest at row `head`.
        tick: firmware period, s.
        load_cell: how torque is measured.
        noise: (J, 4) standard normal numbers.
    """
    for j in range(joint.shape[0]):
        p, r = joint[j], reading[j]
        r.position = quantise(angles[j] + p.sensors_position_bias, p.sensors_encoder_resolution)
        if r.primed == 0.0:
            r.last_position, r.primed = r.position, 1.0
        pole = np.exp(-2.0 * np.pi * p.sensors_velocity_filter_hz * tick)
        r.velocity = pole * r.velocity + (1.0 - pole) * (r.position - r.last_position) / tick
        r.last_position = r.position
        r.pressure_a = quantise(
            history[head, PRESSURE_A, j] + p.sensors_pressure_noise * noise[j, PRESSURE_A],
            p.sensors_pressure_resolution,
        )
        r.pressure_b = quantise(
            history[head, PRESSURE_B, j] + p.sensors_pressure_noise * noise[j, PRESSURE_B],
            p.sensors_pressure_resolution,
        )
        r.effort = torque_reading(p, history, head, 0.0, load_cell, noise, j)
        r.effort_logged = r.effort
        if p.sensors_effort_delay > 0.0:
            r.effort_logged = torque_reading(p, history, head, p.sensors_effort_delay / spacing, load_cell, noise, j)
        if p.sensors_effort_unsigned >= 0.5:
            r.effort_logged = abs(r.effort_logged)
