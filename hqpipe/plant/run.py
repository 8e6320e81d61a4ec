"""Run a controller on the plant and record a trial."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from hqpipe.errors import UsageError, near_match
from hqpipe.plant import firmware
from hqpipe.plant.disturbance import Disturbance, Grip, Outside, acting
from hqpipe.plant.trial import COMMANDS, TRUE_JOINT_SIGNALS, PlantTrial, Recorder, log_columns, truth_columns

if TYPE_CHECKING:
    from hqpipe.plant.plant import Plant, SensorFrame

RATE_HZ = 1000.0  # one row per firmware tick
CONTACT_FORCE = 5.0  # N that the foot switch needs; assumption


def run_trial(
    plant: Plant,
    controller: Callable[[SensorFrame, dict[str, float]], np.ndarray],
    duration: float,
    command: dict[str, float] | Callable[[float], dict[str, float]] | None,
    control_period_s: float,
    mode: str,
    targets: str | None,
    disturbances: Sequence[Disturbance] = (),
    stop_at_fall: bool = True,
) -> PlantTrial:
    """Record `duration` s from the plant's present state.

    Args:
        plant: reset, or wherever it stands.
        controller: (frame, command) → (J,) targets, called every `control_period_s` and held.
        duration: s.
        command: vx, vy (m/s) and wz (rad/s), fixed or as a function of time; missing ones are 0.
        control_period_s: a multiple of 1 ms.
        mode: "position"; "torque", where joint targets become torque targets at 1 kHz through the robot's
            `torque_pd`; or "valve".
        targets: what the controller returns: "position" (default in position and torque mode), "effort" or
            "valve".
        disturbances: what acts from outside, timed from the start of the trial.
        stop_at_fall: whether a fall ends the trial, or is recorded with what comes after it.

    Raises:
        UsageError: unknown mode or targets, a control period that is no multiple of 1 ms, or a grip on joints that have
            no commanded angle.
    """
    targets = targets or ("valve" if mode == "valve" else "position")
    hold = _check(mode, targets, control_period_s)
    if targets != "position" and any(isinstance(each, Grip) for each in disturbances):
        raise UsageError(f"disturbances: a grip needs joint angles as targets, got '{targets}'")
    robot, floating, length = plant.robot, plant.base == "floating", round(duration * RATE_HZ)
    with_position = targets == "position"
    recorder = Recorder(
        log_columns(robot.joints, robot.feet, mode, with_position, floating),
        truth_columns(robot.joints),
        length,
    )
    start, fall_time, wanted = plant.time, None, np.zeros(len(robot.joints))
    for row in range(length):
        frame = plant.sense()
        now = _command_at(command, frame.time)
        if row % hold == 0:
            wanted = np.array(controller(frame, now), dtype=float)
        target = wanted
        if mode == "torque" and with_position:
            target = robot.torque_pd.kp * (wanted - frame.q) - robot.torque_pd.kd * frame.qd
        force, illegal = plant.body.contacts()
        seen, truth = _seen(plant, frame, force, now, floating), _truth(plant)
        plant.step(target, mode, _outside(plant, disturbances, frame.time - start, wanted))
        sent = [plant.valve_command] + [wanted] * with_position + [target] * (mode == "torque")
        recorder.add([np.array([frame.time - start]), *sent, *seen], truth)
        if floating and fall_time is None and plant.has_fallen(illegal):
            fall_time = frame.time - start
            if stop_at_fall:
                break
    return PlantTrial(
        *recorder.columns(), mode, plant.effort_source, plant.base, RATE_HZ, fall_time is not None, fall_time
    )


def _check(mode: str, targets: str, control_period_s: float) -> int:
    allowed = {"position": ("position",), "torque": ("position", "effort"), "valve": ("valve",)}
    if mode not in allowed:
        raise UsageError(f"mode: expected one of {', '.join(allowed)}, got '{mode}'{near_match(mode, firmware.MODES)}")
    if targets not in allowed[mode]:
        raise UsageError(f"targets: in mode '{mode}' expected one of {', '.join(allowed[mode])}, got '{targets}'")
    hold = round(control_period_s * RATE_HZ)
    if hold < 1 or abs(hold / RATE_HZ - control_period_s) > 1e-9:
        raise UsageError(f"control_period_s: expected a multiple of {1 / RATE_HZ} s, got {control_period_s}")
    return hold


def _command_at(
    command: dict[str, float] | Callable[[float], dict[str, float]] | None, time: float
) -> dict[str, float]:
    given = command(time) if callable(command) else command or {}
    for name in given:
        if name not in COMMANDS:
            raise UsageError(f"command: expected {', '.join(COMMANDS)}, got '{name}'{near_match(name, COMMANDS)}")
    return {name: float(given.get(name, 0.0)) for name in COMMANDS}


def _outside(plant: Plant, disturbances: Sequence[Disturbance], time: float, wanted: np.ndarray) -> Outside | None:
    """What acts at `time` s of the trial on joints that are wanted at `wanted` (J,) rad."""
    if not disturbances:
        return None
    return acting(disturbances, time, wanted - plant.body.joint_position, plant.heading)


def _truth(plant: Plant) -> list[np.ndarray]:
    state, supply = plant.state, plant.supply[0]
    signals = {"position": plant.body.joint_position, "velocity": plant.body.joint_velocity}
    joints = [signals[name] if name in signals else state[name] for name in TRUE_JOINT_SIGNALS]
    pressure = supply["pressure"] + plant.ripple
    return [
        *joints,
        plant.body.base_orientation,
        np.array([pressure, supply["drawn"], supply["pump"], supply["relief"]]),
    ]


def _seen(
    plant: Plant, frame: SensorFrame, force: np.ndarray, command: dict[str, float], floating: bool
) -> list[np.ndarray]:
    """What is measured; base pose and speed as motion capture has them, attitude and rates from the IMU."""
    seen = [frame.q, frame.qd, frame.effort, frame.pressure_a, frame.pressure_b]
    seen.append(np.array([frame.supply_pressure, plant.oil_temperature]))
    if floating:
        seen += [
            plant.body.base_position,
            frame.orientation,
            plant.body.base_linear_velocity,
            frame.gyro,
            frame.accel,
        ]
        seen += [(np.linalg.norm(force, axis=1) > CONTACT_FORCE).astype(float), force.ravel()]
        seen.append(np.array([command[name] for name in COMMANDS]))
    return seen
