"""Compiled loop of electric joints: firmware at its own rate, motor, friction, transmission; the bodies move in MuJoCo.

The friction of a joint is a dry-friction constraint of the physics engine, which really sticks, with a limit that is set in
every step. A soft or loose transmission is a rotor of its own on a spring with play, in steps of a quarter of the engine's.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)
from hqpipe.sim.native_call import call_step

JOINT = np.dtype(
    [
        (name, np.float64)
        for name in (
            "kp kd ki "  # N·m/rad, N·m·s/rad, N·m/(rad·s): the position loop
            "damps_error "  # 1: kd acts on the error's rate, 0: on the speed alone
            "gain_ratio hunting hunting_hz "  # factor on kp; share by which kp swings, and how fast
            "limit lag "  # N·m and s: what the drive gives, and the time constant of its current loop
            "by_duty volt_torque back_emf torque_constant "  # 1: PWM; N·m/V, N·m·s/rad, N·m/A
            "coulomb static stribeck viscous load_share "  # N·m, N·m, rad/s, N·m·s/rad, 1
            "spring neutral "  # N·m/rad, rad
            "rotor gap stiffness transmission_damping flexible sensed_at_load "  # kg·m², rad, N·m/rad, N·m·s/rad, flags
            "logged_at_load "
            "ripple_nm ripple_periods "  # N·m and periods a radian
            "hysteresis_nm hysteresis_rad "  # N·m and the travel over which it builds up
            "push_nm push_from push_until "  # N·m and s: an outside force
            "warm_from warm_friction warm_torque"  # s, and factors from then on
        ).split()
    ],
    align=True,
)
"""Everything that one joint and its drive have, SI; see `neutral_joints`."""

ROTOR_STEPS: Final = 4  # steps of the rotor in one of the engine's; assumption: its spring reaches 1500 rad/s
PWM_RESISTANCE: Final = 1e-9  # Ω, keeps the supply's Ohm's law defined where the source has no resistance


def neutral_joints(count: int) -> np.ndarray:
    """(J,) joints without any effect: no friction, rigid transmission, drives that lack no torque."""
    joints = np.zeros(count, dtype=JOINT)
    joints["gain_ratio"] = 1.0
    joints["limit"] = joints["push_from"] = joints["push_until"] = joints["warm_from"] = np.inf
    joints["stribeck"] = joints["hysteresis_rad"] = 1.0
    joints["warm_friction"] = joints["warm_torque"] = 1.0
    return joints


@njit(cache=True, nogil=True)
def friction_limit(joint, speed: float, torque: float, time: float) -> float:
    """Dry friction that opposes the motion, N·m: constant, near standstill (Gaussian), and with what is transmitted."""
    slow = joint.static * np.exp(-((speed / joint.stribeck) ** 2))
    level = joint.coulomb + slow + joint.load_share * abs(torque)
    return level * joint.warm_friction if time >= joint.warm_from else level


@njit(cache=True, nogil=True)
def demand(joint, error: float, error_rate: float, speed: float, integral: float, time: float) -> float:
    """What the position loop asks for, N·m."""
    kp = joint.kp * joint.gain_ratio * (1.0 + joint.hunting * np.sin(2.0 * np.pi * joint.hunting_hz * time))
    damped = error_rate if joint.damps_error > 0.0 else -speed
    return kp * error + joint.kd * damped + integral


@njit(cache=True, nogil=True)
def transmitted(joint, twist: float, twist_rate: float) -> float:
    """Torque through the transmission, N·m, from the rotor's lead over the load, rad."""
    half = 0.5 * joint.gap
    if abs(twist) <= half:
        return 0.0
    stretch = twist - half if twist > 0.0 else twist + half
    torque = joint.stiffness * stretch + joint.transmission_damping * twist_rate
    return max(torque, 0.0) if stretch > 0.0 else min(torque, 0.0)  # flanks push, they do not pull


@njit(cache=True, nogil=True)
def run_joints(
    addresses, position, velocity, applied, friction, damping, joints, received, supply, dt, every, keep, kept
):
    """Run all joints for as long as the commands last.

    Args:
        addresses: of mj_step, mjModel and mjData. position, velocity, applied, friction, damping: (J,) views of the engine.
        joints: (J,) of `JOINT`. received: (T, J) commands as the firmware has them at each step, rad.
        supply: (2,) open voltage, V, and resistance of the source, Ω. dt: s, the engine's step.
        every: steps between two ticks of the firmware. keep: steps between two rows of `kept`.
        kept: (T // keep, J, 6) position and speed as logged, motor torque, duty, supply voltage, current.
    """
    count, steps = joints.shape[0], received.shape[0]
    asked, torque, duty = np.zeros(count), np.zeros(count), np.zeros(count)
    integral, last_error, bristle = np.zeros(count), np.zeros(count), np.zeros(count)
    rotor, rotor_speed = position.copy(), np.zeros(count)
    volts = supply[0]
    for j in range(count):
        last_error[j] = received[0, j] - position[j]
    for i in range(steps):
        time, drawn = i * dt, 0.0
        for j in range(count):
            joint = joints[j]
            soft = joint.flexible > 0.0
            speed = rotor_speed[j] if soft else velocity[j]
            angle = rotor[j] if soft else position[j]
            if i % every == 0:
                sensed = position[j] if joint.sensed_at_load > 0.0 else angle
                sensed_speed = velocity[j] if joint.sensed_at_load > 0.0 else speed
                error = received[i, j] - sensed
                tick = every * dt
                integral[j] += joint.ki * error * tick
                asked[j] = demand(joint, error, (error - last_error[j]) / tick, sensed_speed, integral[j], time)
                asked[j] = min(max(asked[j], -joint.limit), joint.limit)
                last_error[j] = error
                if joint.by_duty > 0.0:
                    duty[j] = min(max(asked[j] / (joint.volt_torque * supply[0]), -1.0), 1.0)
            wanted = asked[j]
            if joint.by_duty > 0.0:
                wanted = joint.volt_torque * duty[j] * volts - joint.back_emf * speed
            torque[j] += (wanted - torque[j]) * (1.0 - np.exp(-dt / joint.lag))
            drawn += abs(duty[j] * torque[j] / joint.torque_constant)
            given = torque[j] * (joint.warm_torque if time >= joint.warm_from else 1.0)
            given += joint.ripple_nm * np.sin(joint.ripple_periods * angle)
            outside = joint.push_nm if joint.push_from <= time < joint.push_until else 0.0
            outside -= joint.spring * (position[j] - joint.neutral)
            travel = velocity[j] * dt / joint.hysteresis_rad
            bristle[j] += travel - abs(travel) * bristle[j]
            outside -= joint.hysteresis_nm * bristle[j]
            if soft:
                given = turn_rotor(joint, rotor, rotor_speed, j, given, position[j], velocity[j], dt)
            applied[j] = given + outside
            friction[j] = friction_limit(joint, velocity[j], given, time)
            warm = joint.warm_friction if time >= joint.warm_from else 1.0
            damping[j] = joint.viscous * warm
        volts = max(supply[0] - (supply[1] + PWM_RESISTANCE) * drawn, 0.3 * supply[0])  # brown-out below
        if i % keep == 0 and i // keep < kept.shape[0]:
            for j in range(count):
                soft = joints[j].flexible > 0.0 and joints[j].logged_at_load == 0.0
                kept[i // keep, j, 0] = rotor[j] if soft else position[j]
                kept[i // keep, j, 1] = rotor_speed[j] if soft else velocity[j]
                kept[i // keep, j, 2] = torque[j]
                kept[i // keep, j, 3] = duty[j]
                kept[i // keep, j, 4] = volts
                kept[i // keep, j, 5] = torque[j] / joints[j].torque_constant
        call_step(addresses[0], addresses[1], addresses[2])


@njit(cache=True, nogil=True)
def turn_rotor(joint, rotor, rotor_speed, j, torque, position, velocity, dt) -> float:
    """Advance the rotor by one step of the engine; return the mean torque that it passes on, N·m."""
    passed, part = 0.0, dt / ROTOR_STEPS
    for k in range(ROTOR_STEPS):
        load = position + velocity * part * (k + 0.5)
        through = transmitted(joint, rotor[j] - load, rotor_speed[j] - velocity)
        rotor_speed[j] += part * (torque - through) / joint.rotor
        rotor[j] += part * rotor_speed[j]
        passed += through / ROTOR_STEPS
    return passed
