"""Compiled loop of a legged machine: firmware at 1 kHz, hydraulics at 10 kHz, the legs' matrices at 2 kHz."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from hqpipe.benchmark.cases.legged.body import invert, leg_terms, plate_force
from hqpipe.benchmark.cases.legged.hydraulics import (
    PA,
    PB,
    PISTON,
    SPOOL,
    STEP,
    advance,
    drive_spool,
    lever,
    link_force,
    supplied,
)

TICK: Final = 1.0e-3  # s, of the firmware
PER_TICK: Final = 10
PER_BODY: Final = 10
COLUMNS = "position velocity cell_torque pressure_torque pressure_a pressure_b supply opening true_speed".split()
POSITION, VELOCITY, CELL, OIL, ROW_A, ROW_B, ROW_SUPPLY, OPENING, TRUE_SPEED = range(9)
MEMORY: Final = 1024  # steps of valve commands that are kept: 0.1 s, more than any dead time


@njit(cache=True, nogil=True, error_model="numpy")
def delayed(commands, tick: float, late: float, j: int) -> float:
    """Command that the firmware interpolates at a tick, `late` ticks old."""
    at = max(tick - late, 0.0)
    low = min(int(at), len(commands) - 1)
    high = min(low + 1, len(commands) - 1)
    return commands[low, j] + (at - low) * (commands[high, j] - commands[low, j])


@njit(cache=True, nogil=True, error_model="numpy")
def settle(joint, state, angle: float, torque: float, supply: float) -> None:
    """Put a joint to rest at an angle where its cylinder carries a torque."""
    state[:] = 0.0
    place, arm = lever(joint, angle)
    force = torque / arm
    state[PISTON] = place + force / joint.link_stiffness + 0.5 * joint.play * np.sign(force)
    state[PB] = 0.5 * supply * joint.area_a / (0.5 * (joint.area_a + joint.area_b)) + max(-force, 0.0) / joint.area_b
    state[PB] = min(state[PB], supply)
    state[PA] = min(max((state[PB] * joint.area_b + force) / joint.area_a, 1e5), supply)
    if state[PA] == supply or state[PA] == 1e5:
        state[PB] = min(max((state[PA] * joint.area_a - force) / joint.area_b, 1e5), supply)


@njit(cache=True, nogil=True, error_model="numpy")
def run_legs(body, sound, faulty, supplies, span, commands, lost, before, resolution, filter_hz, plate, kept, feet):
    """Run all joints along their commands.

    Args:
        body: `Body`. sound, faulty: (J,) of `JOINT`, leg by leg; the faulty ones act from span[0] to span[1].
        supplies: (2,) of `SUPPLY`, sound and faulty. span: (2,) s. commands: (T, J) rad a tick; the record begins `before`
            ticks later. lost: (T, J) a command that does not arrive. resolution: rad of the encoders. filter_hz: of the
            firmware's speed. plate: (2,) height in m and stiffness in N/m, 0 for none.
        kept: (T − before, J, 9), see `COLUMNS`, written. feet: (T − before, L, 3) N of the plates on the feet, written.
    """
    legs, n = body.mass.shape
    count, ticks = legs * n, len(commands)
    q, dq, ddq = commands[0].copy(), np.zeros(count), np.zeros(count)
    states, integral = np.zeros((count, 8)), np.zeros(count)
    work = np.zeros((n, 15, 3))
    mass, bias, inverse = np.zeros((n, n)), np.zeros((legs, n)), np.zeros((legs, n, n))
    foot, jacobian = np.zeros((legs, 3)), np.zeros((legs, 3, n))
    anchor, force, speed = np.zeros((legs, 3)), np.zeros((legs, 3)), np.zeros(3)
    torque, cell, opening = np.zeros(n), np.zeros(count), np.zeros(count)
    seen_before, velocity, arrived = q.copy(), np.zeros(count), q.copy()
    sent = np.zeros((count, MEMORY))
    share = 1.0 - np.exp(-2.0 * np.pi * filter_hz * TICK)
    pressure = supplies[0].pressure
    for leg in range(legs):
        leg_terms(body, leg, q[leg * n : leg * n + n], dq[:n] * 0.0, work, mass, bias[leg], foot[leg], jacobian[leg])
        for i in range(n):
            j = leg * n + i
            settle(sound[j], states[j], q[j], bias[leg, i], pressure)
            integral[j] = faulty[j].history
    for tick in range(ticks):
        time = (tick - before) * TICK
        active = span[0] <= time < span[1]
        joints = faulty if active else sound
        supply = supplies[1] if active else supplies[0]
        for j in range(count):
            joint = joints[j]
            wobble = joint.ripple_angle * np.sin(
                q[j] * 7.0
            )  # eccentric by 7 periods a turn: a pancake encoder; assumption
            seen = np.round((q[j] + wobble) / resolution) * resolution
            velocity[j] += share * ((seen - seen_before[j]) / TICK - velocity[j])
            seen_before[j] = seen
            if not (active and lost[tick, j]):
                arrived[j] = delayed(commands, float(tick), joint.command_delay_s / TICK, j)
            error = arrived[j] - seen
            integral[j] += joint.integral * joint.gain * TICK * error
            integral[j] = min(max(integral[j], -joint.integral_limit), joint.integral_limit)
            opening[j] = joint.gain * error + integral[j]
            if tick >= before:
                row, state = kept[tick - before, j], states[j]
                place, arm = lever(joint, q[j])
                row[0], row[1], row[2] = seen, velocity[j], cell[j]
                row[3] = (state[PA] * joint.area_a - state[PB] * joint.area_b) * arm
                row[4], row[5], row[6], row[7], row[8] = state[PA], state[PB], pressure, state[SPOOL], dq[j]
        if tick >= before:
            feet[tick - before] = force
        for j in range(count):
            other = opening[(j + 1) % n + (j // n) * n]
            total = opening[j] + joints[j].crosstalk * other
            for i in range(PER_TICK):
                sent[j, (tick * PER_TICK + i) % MEMORY] = min(max(total, -1.0), 1.0)
        for i in range(PER_TICK):
            step, drawn = tick * PER_TICK + i, 0.0
            now = time + i * STEP
            for leg in range(legs):
                first = leg * n
                if i % PER_BODY == 0:
                    leg_terms(
                        body,
                        leg,
                        q[first : first + n],
                        dq[first : first + n],
                        work,
                        mass,
                        bias[leg],
                        foot[leg],
                        jacobian[leg],
                    )
                    invert(mass, inverse[leg])
                speed[:] = 0.0
                for a in range(3):
                    for k in range(n):
                        speed[a] += jacobian[leg, a, k] * dq[first + k]
                plate_force(foot[leg], speed, plate[0], plate[1], anchor[leg], force[leg])
                for a in range(3):
                    foot[leg, a] += STEP * speed[a]
                for k in range(n):
                    j = first + k
                    joint, state = joints[j], states[j]
                    late = int(np.round(joint.valve_delay_s / STEP))
                    drive_spool(joint, state, sent[j, (step - late) % MEMORY] if step >= late else 0.0, now)
                    place, arm = lever(joint, q[j])
                    pull = link_force(joint, state, place, arm * dq[j])
                    drawn += advance(joint, state, pressure, supply.tank, pull, now)
                    cell[j] = pull * arm
                    torque[k] = cell[j] - bias[leg, k]
                    for a in range(3):
                        torque[k] += jacobian[leg, a, k] * force[leg, a]
                for k in range(n):
                    total = 0.0
                    for m in range(n):
                        total += inverse[leg, k, m] * torque[m]
                    ddq[first + k] = total
            for j in range(count):
                dq[j] += STEP * ddq[j]
                q[j] += STEP * dq[j]
            pressure = supplied(supply, pressure, drawn, now)
