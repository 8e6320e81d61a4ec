"""Tables of Unitree robots as their users write them: a column per motor and quantity, named after the fields of LowState.

Seen in public loggers: `q_0`, `dq_0`, `tau_0`, `q_des_0`, `temp_0` (wty-yy/unitree_cpp_deploy), `q_act_0`, `tau_est_0`,
`q_cmd_0`, `dof_pos_0`, `FR_hip_q`, `FR_hip_tau_est`, and the paths that PlotJuggler exports, `/lowstate/motor_state[0]/q`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from hqpipe.logs.imports.recording import ImportLogError, Recording

_QUANTITIES = {
    "position": ("q", "q_act", "q_meas", "dof_pos", "joint_pos", "position"),
    "velocity": ("dq", "dq_act", "qd", "dof_vel", "joint_vel", "velocity"),
    "effort": ("tau", "tau_est", "tau_act", "tau_meas", "dof_tau", "joint_tau", "torque"),
    "position_command": (
        "q_des",
        "q_cmd",
        "q_target",
        "q_ref",
        "target_q",
        "des_q",
        "dof_pos_target",
        "target_dof_pos",
    ),
    "effort_command": ("tau_des", "tau_cmd", "tau_ff"),
    "temperature": ("temp", "temperature", "temperatures", "motor_temp"),
    "kp": ("kp",),
    "kd": ("kd",),
}
_UNITS = {
    "position": "rad",
    "velocity": "rad/s",
    "effort": "N·m",
    "position_command": "rad",
    "effort_command": "N·m",
    "temperature": "°C",
}
_COMMAND = {"position": "position_command", "effort": "effort_command", "kp": "kp", "kd": "kd"}
_QUANTITY_OF = {name: quantity for quantity, names in _QUANTITIES.items() for name in names}
_WORDS = "|".join(sorted(map(re.escape, _QUANTITY_OF), key=len, reverse=True))
_INDEXED = re.compile(rf"(?P<word>{_WORDS})[_.\[ ]?(?P<motor>\d{{1,2}})\]?")
_NAMED = re.compile(rf"(?P<motor>[A-Za-z]\w*?)[_./](?P<word>{_WORDS})")
_PATH = re.compile(
    rf"(?:.*[/.])?motor_?(?P<kind>state|cmd)[\[./_]?(?P<motor>\d{{1,2}})\]?[./_](?P<word>{_WORDS})", re.I
)

# Order of the motors in LowState and LowCmd of the Go1, Go2, A1 and B2 (unitree_sdk2, example/go2)
_LEGS, _PARTS = ("FR", "FL", "RR", "RL"), ("hip", "thigh", "calf")
_QUADRUPED = [f"{leg}_{part}" for leg in _LEGS for part in _PARTS]
_OF_SDK = (
    "q",
    "dq",
    "tau",
    "tau_est",
    "q_des",
    "q_cmd",
)  # names of the SDK; others are a policy's, which reorders joints

# Motor of each joint in the order of a policy, which loggers of deployed policies write their targets in: joint_ids_map of
# unitree_rl_lab (deploy.yaml of Go2), for Isaac Lab on PhysX and on Newton
_POLICY_ORDERS = ((3, 0, 9, 6, 4, 1, 10, 7, 5, 2, 11, 8), (3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8))
_CLEARLY = 0.5  # of the distance from targets to positions; assumption: the right order at least halves it

_CLOCKS = (
    "time",
    "time_s",
    "t",
    "ts",
    "timestamp",
    "timestamp_s",
    "time_ms",
    "time_us",
    "time_ns",
    "tick",
    "unix_time",
)
_TICK = "ms"  # LowState.tick counts milliseconds
_STEPS = (2e-4, 0.5)  # s, of a sensible clock; assumption: Unitree's motors are read at 500 Hz, loggers at 2 Hz or more


def mapping(recordings: Sequence[Recording]) -> dict[str, Any]:
    """CSV tables of Unitree robots: q, dq, tau, their targets and temperatures, by motor number or joint name."""
    if not recordings:
        raise ImportLogError("no table among the files", fix="name the CSV files")
    first = recordings[0].streams[0]
    motors = _motors(first.fields)
    if not motors:
        some = ", ".join(list(first.fields)[:8])
        what = f"{recordings[0].path}: no columns of motors such as q_0 or FR_hip_q (found: {some})"
        raise ImportLogError(what, file=recordings[0].path, fix="draft a mapping with --guess")
    everywhere = [channel for channel in _UNITS if all(channel in quantities for quantities in motors.values())]
    names = _joint_names(motors)
    _reorder_targets(recordings, motors)
    joints = {
        names[motor]: {channel: {"field": quantities[channel], "unit": _UNITS[channel]} for channel in everywhere}
        for motor, quantities in motors.items()
    }
    drive = {names[m]: known for m, quantities in motors.items() if (known := _gains(recordings, quantities))}
    return {
        "format": "hqpipe-log-map/1",
        **({"control_mode": "position"} if "position_command" in everywhere else {}),
        **({"effort_source": "current"} if "effort" in everywhere else {}),
        "clock": _clock(recordings[0]),
        "joints": joints,
        **({"drive": drive} if drive else {}),
    }


def _motors(fields: dict[str, np.ndarray]) -> dict[str, dict[str, str]]:
    """Motor, by number or name → quantity → field, for those with a position; by number as far as there are numbers."""
    found: dict[str, dict[str, str]] = {}
    for field in fields:
        for pattern in (_INDEXED, _PATH, _NAMED):
            if match := pattern.fullmatch(field):
                quantity = _QUANTITY_OF[match["word"].lower()]
                if pattern is _PATH and match["kind"].lower() == "cmd":
                    quantity = _COMMAND.get(quantity, "")
                if quantity:
                    found.setdefault(match["motor"], {}).setdefault(quantity, field)
                break
    found = {motor: quantities for motor, quantities in found.items() if "position" in quantities}
    numbered = {motor: quantities for motor, quantities in found.items() if motor.isdigit()}
    if numbered:
        return dict(sorted(numbered.items(), key=lambda item: int(item[0])))
    return found


def _joint_names(motors: dict[str, dict[str, str]]) -> dict[str, str]:
    """Motor → name of its joint: that of the quadrupeds where twelve motors are numbered as the SDK numbers them."""
    if not all(motor.isdigit() for motor in motors):
        return {motor: motor.removesuffix("_joint") for motor in motors}
    words = {_word(quantities["position"]) for quantities in motors.values()}
    if [int(motor) for motor in motors] == list(range(12)) and words <= set(_OF_SDK):
        return dict(zip(motors, _QUADRUPED, strict=True))
    return {motor: f"motor_{int(motor):02d}" for motor in motors}


def _reorder_targets(recordings: Sequence[Recording], motors: dict[str, dict[str, str]]) -> None:
    """Give each of twelve motors its own target, in place, where the targets follow the order of a policy."""
    if list(motors) != [str(n) for n in range(12)] or not all("position_command" in q for q in motors.values()):
        return
    targets = [motors[str(n)]["position_command"] for n in range(12)]
    if _word(targets[0]) == "q":  # of motor_cmd, which is in the order of the motors
        return
    positions = [motors[str(n)]["position"] for n in range(12)]
    distance = {
        order: _distance(recordings, targets, positions, order) for order in (*_POLICY_ORDERS, tuple(range(12)))
    }
    best = min(distance, key=distance.__getitem__)
    if distance[best] < _CLEARLY * distance[tuple(range(12))]:
        for place, motor in enumerate(best):
            motors[str(motor)]["position_command"] = targets[place]


def _distance(
    recordings: Sequence[Recording], targets: list[str], positions: list[str], order: tuple[int, ...]
) -> float:
    """Mean square, rad², between targets and the positions of the motors that an order gives them to."""
    total = 0.0
    for recording in recordings:
        fields = recording.streams[0].fields
        if all(name in fields for name in (*targets, *positions)):
            pairs = [(fields[targets[place]], fields[positions[motor]]) for place, motor in enumerate(order)]
            total += sum(float(np.nanmean((target - position) ** 2)) for target, position in pairs)
    return total


def _word(field: str) -> str:
    match = next(m for p in (_INDEXED, _PATH, _NAMED) if (m := p.fullmatch(field)))
    return match["word"].lower()


def _gains(recordings: Sequence[Recording], quantities: dict[str, str]) -> dict[str, float]:
    """kp in N·m/rad and kd in N·m·s/rad where they are recorded and never change."""
    known = {}
    for gain in ("kp", "kd"):
        if gain not in quantities:
            continue
        values = {
            float(v) for r in recordings for v in np.unique(r.streams[0].fields.get(quantities[gain], np.array([])))
        }
        if len(values) == 1:
            known[gain] = values.pop()
    return known


def _clock(recording: Recording) -> dict[str, str]:
    """The clock and its unit, by its name, or by what makes sense of its steps."""
    fields = recording.streams[0].fields
    known = {name.lower(): name for name in fields}
    name = next((known[each] for each in _CLOCKS if each in known), None)
    if name is None:
        what = f"{recording.path}: no clock, expected a column such as {', '.join(_CLOCKS[:5])}"
        raise ImportLogError(what, file=recording.path, fix="draft a mapping with --guess and name the clock")
    if name.lower() == "tick":
        return {"field": name, "unit": _TICK}
    for unit in ("ms", "us", "ns"):
        if name.lower().endswith(f"_{unit}"):
            return {"field": name, "unit": unit}
    steps = np.diff(fields[name][np.isfinite(fields[name])])
    step = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    for unit, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if _STEPS[0] <= step * factor <= _STEPS[1]:
            return {"field": name, "unit": unit}
    what = f"{recording.path}: '{name}' has steps of {step:g}, which is no sensible clock in s, ms, us or ns"
    raise ImportLogError(what, file=recording.path, field=name, fix="draft a mapping with --guess and state its unit")
