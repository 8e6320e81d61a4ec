"""The compiled hydraulics: 24 chambers, 12 spools, pistons with friction, chains and one supply.

State of a chamber is its oil content W, the volume that the oil would fill at zero pressure, so that mass is
conserved exactly and a cavity opens by itself where W falls below the geometric volume. The fluid law is
W/V = 1 + p/β. Integration is semi-implicit Euler: flows and forces from the present state, speeds before
positions, friction by an implicit step that really sticks. Equations and sources: docs/theory/plant.md.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

LAMINAR: Final = 5.0e4  # Pa, below it orifice flow turns laminar (Merritt 1967, ch. 3); value assumed
KINETIC_STICTION: Final = 0.4  # share of a spool's static friction left while it slides; assumption
LINE_MODULUS: Final = 1.0e9  # Pa, oil in steel supply pipes, stiffer than with hoses; assumption
MINIMUM_MODULUS: Final = 0.1  # of β at the reference temperature, however hot the oil

STATE = np.dtype(
    [
        (name, np.float64)
        for name in (
            "oil_a oil_b x_a v_a x_b v_b chain v_chain spool v_spool play "
            "pressure_a pressure_b tension_a tension_b torque"
        ).split()
    ],
    align=True,
)
"""Per joint: oil contents m³; positions m and speeds m/s of pistons and chain along the chain; spool opening
and its speed 1/s; hysteresis memory; then outputs: pressures Pa, strand tensions N, joint torque N·m."""

LEDGER = np.dtype(
    [(name, np.float64) for name in "supply tank valve leak friction chain joint_work body_work".split()], align=True
)
"""Per joint, J since the start: taken from the supply, given to the tank, lost in lands, leakage, seals and
stops, chain damping; work that the hydraulics did on the joint, and that the body took up."""

SUPPLY = np.dtype([(name, np.float64) for name in "pressure pump relief drawn returned".split()], align=True)
"""Supply pressure Pa; J from the pump and lost in the relief valve; m³ drawn and returned by the valves."""


@njit(cache=True, nogil=True, inline="always")
def flow_head(drop: float) -> float:
    """sgn(Δp) √|Δp|, linear below the laminar transition, √Pa."""
    return drop / np.sqrt(np.sqrt(drop * drop + LAMINAR * LAMINAR))


@njit(cache=True, nogil=True, inline="always")
def land_opening(travel: float, rounding: float) -> float:
    """Opening of one land: the positive part of the travel with a rounded corner."""
    return 0.5 * (travel + np.sqrt(travel * travel + rounding * rounding))


@njit(cache=True, nogil=True, inline="always")
def chamber_pressure(oil: float, volume: float, modulus: float, swelling: float) -> float:
    """Pressure of `oil` m³ in `volume` m³ and a hose that swells by `swelling` m³/Pa; 0 in a cavity.

    Solves oil = (volume + swelling p)(1 + p/modulus).
    """
    excess = oil - volume
    if excess <= 0.0:
        return 0.0
    linear = volume / modulus + swelling
    return 2.0 * excess / (linear + np.sqrt(linear * linear + 4.0 * swelling / modulus * excess))


@njit(cache=True, nogil=True)
def chamber_oil(pressure: float, volume: float, modulus: float, swelling: float) -> float:
    """Inverse of `chamber_pressure`."""
    return (volume + swelling * pressure) * (1.0 + pressure / modulus)


@njit(cache=True, nogil=True, inline="always")
def flow_energy(pressure: float, modulus: float) -> float:
    """∫ dp/(1 + p/β): J that one m³ of oil (as at zero pressure) carries, Pa; series of β ln(1 + p/β)."""
    ratio = pressure / modulus
    return pressure * (1.0 - ratio * (0.5 - ratio * (1.0 / 3.0 - 0.25 * ratio)))


@njit(cache=True, nogil=True, inline="always")
def shrink(speed: float, dry: float, viscous: float) -> float:
    """Speed after dry friction took off at most `dry` (it stops, never reverses), then viscous decay."""
    if speed > dry:
        return (speed - dry) / (1.0 + viscous)
    if speed < -dry:
        return (speed + dry) / (1.0 + viscous)
    return 0.0


@njit(cache=True, nogil=True)
def oil_modulus(p, m, time: float) -> float:
    """β at the oil temperature of `time`, Pa."""
    warming = m.fluid_heating_rate * max(time, 0.0)
    return p.fluid_bulk_modulus * max(1.0 - m.fluid_bulk_modulus_per_kelvin * warming, MINIMUM_MODULUS)


@njit(cache=True, nogil=True)
def supply_capacity(m, pressure: float) -> float:
    """dV/dp of lines and gas accumulator, m³/Pa; the bladder closes the accumulator below its precharge."""
    capacity = m.supply_line_volume / LINE_MODULUS
    if pressure > m.supply_accumulator_precharge:
        gas = m.supply_accumulator_volume * (m.supply_accumulator_precharge / pressure) ** (1.0 / m.supply_gas_exponent)
        capacity += gas / (m.supply_gas_exponent * pressure)
    return capacity


@njit(cache=True, nogil=True)
def relief_flow(m, pressure: float) -> float:
    """m³/s over the relief valve, which passes the whole pump flow at the nominal supply pressure."""
    cracking = m.supply_pressure - m.supply_relief_override
    return max(pressure - cracking, 0.0) / m.supply_relief_override * m.supply_pump_flow


@njit(cache=True, nogil=True, inline="always")
def move_spool(p, s, command: float, h: float) -> None:
    """Hysteresis, second-order spool with stiction, slew and stroke limits; `command` in units of opening."""
    s.play = min(max(s.play, command - p.valve_hysteresis), command + p.valve_hysteresis)
    target = min(max(s.play, -p.valve_opening_limit), p.valve_opening_limit)
    omega = 2.0 * np.pi * p.valve_bandwidth_hz
    stiction = p.valve_stiction if s.v_spool == 0.0 else KINETIC_STICTION * p.valve_stiction
    speed = s.v_spool + h * omega * (omega * (target - s.spool) - 2.0 * p.valve_damping_ratio * s.v_spool)
    speed = shrink(speed, h * omega * omega * stiction, 0.0)
    s.v_spool = min(max(speed, -p.valve_slew_rate), p.valve_slew_rate)
    s.spool += h * s.v_spool
    if abs(s.spool) > p.valve_opening_limit:
        s.spool = min(max(s.spool, -p.valve_opening_limit), p.valve_opening_limit)
        s.v_spool = 0.0


@njit(cache=True, nogil=True, inline="always")
def exchange_oil(p, m, s, e, supply: float, modulus: float, thinning: float, drift: float, h: float) -> tuple:
    """Flow through the four lands and the leak for one substep.

    Returns:
        m³/s drawn from the supply and given to the tank.
    """
    tank = m.supply_return_pressure
    gain = p.valve_rated_flow / np.sqrt(0.5 * p.valve_rated_drop) * drift
    forward = gain * (1.0 + p.valve_asymmetry) * land_opening(s.spool - p.valve_overlap, p.valve_null_opening)
    backward = gain * (1.0 - p.valve_asymmetry) * land_opening(-s.spool - p.valve_overlap, p.valve_null_opening)
    a, b = s.pressure_a, s.pressure_b
    supply_a, b_tank = forward * flow_head(supply - a), forward * flow_head(b - tank)
    supply_b, a_tank = backward * flow_head(supply - b), backward * flow_head(a - tank)
    leak = p.cylinder_leakage / thinning * (a - b)
    s.oil_a += h * (supply_a - a_tank - leak)
    s.oil_b += h * (supply_b - b_tank + leak)
    head_s, head_t = flow_energy(supply, modulus), flow_energy(tank, modulus)
    head_a, head_b = flow_energy(a, modulus), flow_energy(b, modulus)
    e.supply += h * head_s * (supply_a + supply_b)
    e.tank += h * head_t * (a_tank + b_tank)
    e.valve += h * (
        supply_a * (head_s - head_a)
        + supply_b * (head_s - head_b)
        + a_tank * (head_a - head_t)
        + b_tank * (head_b - head_t)
    )
    e.leak += h * leak * (head_a - head_b)
    return supply_a + supply_b, a_tank + b_tank


@njit(cache=True, nogil=True, inline="always")
def strand_tension(p, stretch: float, rate: float) -> float:
    """A chain pulls and never pushes, N."""
    if stretch <= 0.0:
        return 0.0
    return max(p.chain_stiffness * stretch + p.chain_damping * rate, 0.0)


@njit(cache=True, nogil=True, inline="always")
def beyond_gap(offset: float, gap: float) -> float:
    """How far an offset reaches past a clearance of ±gap."""
    return offset - min(max(offset, -gap), gap)


@njit(cache=True, nogil=True, inline="always")
def tooth_force(p, offset: float, rate: float) -> float:
    """Chain on sprocket through its clearance, N, positive when the chain leads."""
    gap = 0.5 * p.chain_slack
    reach = beyond_gap(offset, gap)
    force = p.chain_tooth_stiffness * reach + p.chain_tooth_damping * rate
    if gap == 0.0:
        return force
    if reach > 0.0:
        return max(force, 0.0)
    return min(force, 0.0) if reach < 0.0 else 0.0


@njit(cache=True, nogil=True, inline="always")
def move_piston(p, e, x: float, v: float, drive: float, load: float, thinning: float, h: float) -> tuple:
    """One piston under `drive` N (pressure, chain), seal friction and end stops; `load` N presses the seals.

    Returns:
        position m and speed m/s after the substep.
    """
    stop = 0.0
    if x < 0.0:
        stop = -p.cylinder_stop_stiffness * x
    elif x > p.cylinder_stroke:
        stop = p.cylinder_stop_stiffness * (p.cylinder_stroke - x)
    ratio = v / p.cylinder_stribeck_velocity
    dry = (
        p.cylinder_coulomb_friction
        + p.cylinder_stribeck_friction / (1.0 + ratio * ratio)
        + p.cylinder_load_friction * load
    )
    free = v + h / p.cylinder_piston_mass * (drive + stop)
    dry += p.cylinder_coulomb_asymmetry if free > 0.0 else -p.cylinder_coulomb_asymmetry
    step = h / p.cylinder_piston_mass
    new = shrink(free, step * max(dry, 0.0), step * p.cylinder_viscous_friction * thinning)
    e.friction += (free - new) / step * new * h - stop * new * h
    return x + h * new, new


@njit(cache=True, nogil=True, inline="always")
def move_mechanics(p, s, e, sprocket: float, sprocket_rate: float, thinning: float, h: float) -> None:
    """Pistons and chain for one substep; the sprocket's pitch line stands at `sprocket` m."""
    offset, offset_rate = s.chain - sprocket, s.v_chain - sprocket_rate
    stretch_a, rate_a = s.x_a - s.chain, s.v_a - s.v_chain
    stretch_b, rate_b = s.chain - s.x_b, s.v_chain - s.v_b
    s.tension_a, s.tension_b = strand_tension(p, stretch_a, rate_a), strand_tension(p, stretch_b, rate_b)
    tooth = tooth_force(p, offset, offset_rate)
    load_a, load_b = s.pressure_a * p.cylinder_area_a, s.pressure_b * p.cylinder_area_b
    s.x_a, s.v_a = move_piston(p, e, s.x_a, s.v_a, load_a - s.tension_a, load_a, thinning, h)
    s.x_b, s.v_b = move_piston(p, e, s.x_b, s.v_b, s.tension_b - load_b, load_b, thinning, h)
    s.v_chain += h / p.chain_mass * (s.tension_a - s.tension_b - tooth)
    s.chain += h * s.v_chain
    e.joint_work += tooth * sprocket_rate * h
    # What a damped spring dissipates is its force beyond the elastic one, also while it is kept from pushing.
    e.chain += h * (s.tension_a - p.chain_stiffness * max(stretch_a, 0.0)) * rate_a
    e.chain += h * (s.tension_b - p.chain_stiffness * max(stretch_b, 0.0)) * rate_b
    e.chain += h * (tooth - p.chain_tooth_stiffness * beyond_gap(offset, 0.5 * p.chain_slack)) * offset_rate


@njit(cache=True, nogil=True, inline="always")
def update_pressures(p, s, modulus: float) -> None:
    volume_a = p.cylinder_dead_volume_a + p.cylinder_area_a * s.x_a
    volume_b = p.cylinder_dead_volume_b + p.cylinder_area_b * (p.cylinder_stroke - s.x_b)
    s.pressure_a = chamber_pressure(s.oil_a, volume_a, modulus, p.cylinder_hose_compliance)
    s.pressure_b = chamber_pressure(s.oil_b, volume_b, modulus, p.cylinder_hose_compliance)


@njit(cache=True, nogil=True)
def settle(joint, machine, state, angles, pressure_a, pressure_b, time: float) -> None:
    """Put pistons and chains to rest at joint angles (J,) rad with the given chamber pressures (J,) Pa.

    The strands carry the pressure forces and the spools are centred.
    """
    for j in range(joint.shape[0]):
        p, s = joint[j], state[j]
        pull_a, pull_b = pressure_a[j] * p.cylinder_area_a, pressure_b[j] * p.cylinder_area_b
        pitch = 0.5 * p.cylinder_stroke + p.radius * (angles[j] - p.position_middle)
        slip = (pull_a - pull_b) / p.chain_tooth_stiffness
        s.chain = pitch + slip + 0.5 * p.chain_slack * np.sign(slip)
        s.x_a, s.x_b = s.chain + pull_a / p.chain_stiffness, s.chain - pull_b / p.chain_stiffness
        s.v_a = s.v_b = s.v_chain = s.spool = s.v_spool = s.play = 0.0
        s.tension_a, s.tension_b, s.torque = pull_a, pull_b, p.radius * (pull_a - pull_b)
        s.pressure_a, s.pressure_b = pressure_a[j], pressure_b[j]
    refill(joint, machine, state, time)


@njit(cache=True, nogil=True)
def refill(joint, machine, state, time: float) -> None:
    """Set the oil contents to what the present pressures and positions need, after a parameter changed."""
    for j in range(joint.shape[0]):
        p, s = joint[j], state[j]
        modulus, swelling = oil_modulus(p, machine[0], time), p.cylinder_hose_compliance
        volume_a = p.cylinder_dead_volume_a + p.cylinder_area_a * s.x_a
        volume_b = p.cylinder_dead_volume_b + p.cylinder_area_b * (p.cylinder_stroke - s.x_b)
        s.oil_a = chamber_oil(s.pressure_a, volume_a, modulus, swelling)
        s.oil_b = chamber_oil(s.pressure_b, volume_b, modulus, swelling)


@njit(cache=True, nogil=True)
def advance(joint, machine, state, ledger, supply, commands, neighbour, first, last, rate, clock) -> None:
    """Integrate over one body step while the joints move from `first` to `last` at a steady speed.

    Args:
        joint, machine: parameter records (J,), (1,).
        state, ledger, supply: records (J,), (J,), (1,), changed in place.
        commands: (H, J) ring of valve commands; row k % H holds tick k.
        neighbour: (J,) index of the joint whose command talks over.
        first, last: (J,) joint angles at both ends, rad.
        rate: (J,) rad/s at the end, for the torque handed to the body.
        clock: (4,) time s at the start, substep s, tick s, number of substeps.
    """
    start, h, tick, m, line = clock[0], clock[1], clock[2], machine[0], supply[0]
    substeps, joints, rows = int(clock[3]), joint.shape[0], commands.shape[0]
    for j in range(joints):
        ledger[j].body_work += state[j].torque * (last[j] - first[j])
    thinning = np.exp(-m.fluid_viscosity_per_kelvin * m.fluid_heating_rate * max(start, 0.0))
    for n in range(substeps):
        time = start + n * h
        ripple = m.supply_ripple_pressure * np.sin(2.0 * np.pi * m.supply_ripple_hz * time)
        drawn = 0.0
        for j in range(joints):
            p, s, e = joint[j], state[j], ledger[j]
            modulus = oil_modulus(p, m, start)
            row = int(np.floor((time - p.valve_delay) / tick + 1.0e-6)) % rows
            command = commands[row, j] + p.valve_crosstalk * commands[row, neighbour[j]] + p.valve_neutral_offset
            move_spool(p, s, command, h)
            drift = max(1.0 + p.valve_gain_drift * max(start, 0.0), 0.0)
            inflow, outflow = exchange_oil(p, m, s, e, line.pressure + ripple, modulus, thinning, drift, h)
            speed = p.radius * (last[j] - first[j]) / (h * substeps)
            pitch = 0.5 * p.cylinder_stroke + p.radius * (first[j] - p.position_middle) + speed * h * n
            move_mechanics(p, s, e, pitch, speed, thinning, h)
            update_pressures(p, s, modulus)
            drawn += inflow
            line.returned += h * outflow
        relief = relief_flow(m, line.pressure)
        head = flow_energy(line.pressure, LINE_MODULUS)
        line.pump += h * head * m.supply_pump_flow
        line.relief += h * head * relief
        line.drawn += h * drawn
        line.pressure += h * (m.supply_pump_flow - relief - drawn) / supply_capacity(m, line.pressure)
        line.pressure = max(line.pressure, 0.0)
    for j in range(joints):
        p, s = joint[j], state[j]
        pitch = 0.5 * p.cylinder_stroke + p.radius * (last[j] - p.position_middle)
        s.tension_a = strand_tension(p, s.x_a - s.chain, s.v_a - s.v_chain)
        s.tension_b = strand_tension(p, s.chain - s.x_b, s.v_chain - s.v_b)
        s.torque = p.radius * tooth_force(p, s.chain - pitch, s.v_chain - p.radius * rate[j])
