"""The 1 kHz joint firmware: position PID, torque PID, or a valve command passed through."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

POSITION: Final = 0
TORQUE: Final = 1
VALVE: Final = 2
MODES = {"position": POSITION, "torque": TORQUE, "valve": VALVE}

MEMORY = np.dtype([("integral", np.float64), ("last_effort", np.float64)], align=True)
"""Per joint: the integrator in units of valve command, and the torque of the previous tick, N·m."""


@njit(cache=True, nogil=True)
def firmware_tick(joint, memory, reading, targets, tick_index: int, tick: float, mode: int, valve) -> None:
    """One tick: delayed target → valve command.

    Args:
        joint: parameter records (J,).
        memory: (J,) `MEMORY`, changed in place.
        reading: (J,) sensor readings of this tick.
        targets: (H, J) ring of targets as sent; row k % H holds tick k. rad, N·m or valve command by `mode`.
        tick_index, tick: number and period (s) of this tick.
        mode: POSITION, TORQUE or VALVE.
        valve: (J,) valve commands in −1…1, written.
    """
    rows = targets.shape[0]
    for j in range(joint.shape[0]):
        p, f, r = joint[j], memory[j], reading[j]
        age = p.firmware_command_delay / tick
        whole = int(np.floor(age))
        newer, older = targets[(tick_index - whole) % rows, j], targets[(tick_index - whole - 1) % rows, j]
        target = newer + (age - whole) * (older - newer)
        if mode == POSITION:
            error = min(max(target, p.position_lower), p.position_upper) - r.position
            prompt = p.firmware_position_pid_kp * error - p.firmware_position_pid_kd * r.velocity
            rate = p.firmware_position_pid_ki * error
        elif mode == TORQUE:
            error = target - r.effort
            prompt = p.firmware_torque_pid_kp * error
            prompt -= p.firmware_torque_pid_kd * (r.effort - f.last_effort) / tick
            rate = p.firmware_torque_pid_ki * error
        else:
            prompt, rate = target, 0.0
        f.last_effort = r.effort
        if abs(prompt + f.integral) < 1.0 or rate * f.integral < 0.0:  # no wind-up against a full valve
            f.integral += rate * tick
            f.integral = min(max(f.integral, -p.firmware_integral_limit), p.firmware_integral_limit)
        valve[j] = min(max(prompt + f.integral, -1.0), 1.0)
