"""Every measure of one walk, from its columns in the log format."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hqpipe.rl import walk_measures as measures
from hqpipe.rl.controller import EstimateLog
from hqpipe.rl.leg import LegGeometry, read_leg_geometry, total_mass
from hqpipe.rl.observation import rotate_inverse
from hqpipe.robots import RobotSpec

GRAVITY = 9.81  # m/s²
_XYZ, _XYZW = ("x", "y", "z"), ("x", "y", "z", "w")

Columns = Mapping[str, np.ndarray]


def walk_course(columns: Columns, order: tuple[float, float, float]) -> dict[str, float]:
    """`measures.course` of a walk, or where it is to stay on the spot its wander after settling as drift; with seconds (s)."""
    time, track = columns["time"], _stack(columns, "base/position", ("x", "y"))
    straight = any(order[:2]) and not order[2]
    if straight:
        where = measures.course(time, track, order[:2])
    else:
        where = {"drift": measures.wander(track[measures.settled(time) :])}
    return {**where, "seconds": float(time[-1])}


def walk_measures(columns: Columns, robot: RobotSpec, order: tuple[float, float, float]) -> dict[str, float | None]:
    """What a walk was like; all but the distance and the drift of a course after the settling time.

    Args:
        columns: name → (T,) of the log format, base, feet and supply included.
        robot: whose walk it is. order: vx, vy (m/s), wz (rad/s).

    Returns:
        Name → value, None where it cannot be told. Those of `walk_course`, and in `hqpipe.rl.walk_measures` of `order_error`,
        `clearance` (foot_clearance), `impact` and `lean`; tracking_rmse (rad) of the joint targets, torque_rmse (N·m) of the
        torque targets where there are any; torque_saturation and valve_saturation, shares of the joint samples at the
        effort limit and with the valve fully open; lowest_supply (Pa).
    """
    time = columns["time"]
    after = {name: column[measures.settled(time) :] for name, column in columns.items()}
    orientation = _stack(after, "base/orientation", _XYZW)
    velocity = rotate_inverse(orientation, _stack(after, "base/linear_velocity", _XYZ))
    contact = np.stack([after[f"foot/{foot}/contact"] for foot in robot.feet], axis=1) > 0.5
    force = np.stack([_stack(after, f"foot/{foot}/force", _XYZ) for foot in robot.feet], axis=1)
    soles = sole_heights(after, orientation, robot, read_leg_geometry(robot))
    rate_hz = (len(time) - 1) / (time[-1] - time[0]) if len(time) > 1 else np.nan
    position, effort = (_joints(after, robot, signal) for signal in ("position", "effort"))
    found = {
        **walk_course(columns, order),
        **measures.order_error(after["time"], velocity[:, :2], measures.heading(orientation), order),
        "lean": measures.lean(gravity_direction(orientation)),
        "foot_clearance": measures.clearance(soles, contact, rate_hz) if len(time) > 1 else np.nan,
        **measures.impact(force, GRAVITY * total_mass(robot)),
        "tracking_rmse": measures.rms(_joints(after, robot, "position_command") - position),
        "torque_rmse": None,
        "torque_saturation": measures.share_at_limit(effort, robot.effort_limit),
        "valve_saturation": measures.share_at_limit(_joints(after, robot, "valve_command"), 1.0),
        "lowest_supply": float(after["supply/pressure"].min()),
    }
    if f"joint/{robot.joints[0]}/effort_command" in after:
        found["torque_rmse"] = measures.rms(_joints(after, robot, "effort_command") - effort)
    return {name: value if value is not None and np.isfinite(value) else None for name, value in found.items()}


def estimate_measures(
    columns: Columns, truth: Columns, robot: RobotSpec, record: EstimateLog
) -> dict[str, float | None]:
    """`measures.estimator_error` of a walk after the settling time.

    Height and foot height are meant above the level z = 0, the mean of a bumpy ground, as in training.

    Args:
        columns: as in `walk_measures`. truth: joint/<name>/position and base/orientation/* without sensor errors.
        record: x̃_t of every call; None throughout if the policy does not tell it.
    """
    if len(record.rows) < 2:
        return measures.estimator_error((), np.empty((0, 0)), {})
    time = columns["time"]
    hold = round(record.period_s * (len(time) - 1) / (time[-1] - time[0]))
    calls = slice(-(-measures.settled(time) // hold), None)
    true = {**columns, **truth}
    seen = {name: true[name][::hold][calls] for name in true}
    orientation = _stack(seen, "base/orientation", _XYZW)
    velocity = rotate_inverse(orientation, _stack(seen, "base/linear_velocity", _XYZ))
    gravity = gravity_direction(orientation)
    soles = sole_heights(seen, orientation, robot, read_leg_geometry(robot))
    known = {"base_height/z": seen["base/position/z"]}
    for i, axis in enumerate(_XYZ):
        known[f"base_linear_velocity/{axis}"], known[f"gravity/{axis}"] = velocity[:, i], gravity[:, i]
    for i, foot in enumerate(robot.feet):
        known[f"foot_contact/{foot}"], known[f"foot_height/{foot}"] = seen[f"foot/{foot}/contact"], soles[:, i]
    return measures.estimator_error(record.names, np.stack(record.rows[calls]), known)


def sole_heights(columns: Columns, orientation: np.ndarray, robot: RobotSpec, geometry: LegGeometry) -> np.ndarray:
    """(T, F) m of the soles above world z = 0, from base pose, (T, 4) xyzw, and joint angles."""
    angles = _joints(columns, robot, "position").reshape(-1, len(robot.feet), 3)
    feet = geometry.forward(angles)
    up = -gravity_direction(orientation)
    return columns["base/position/z"][:, None] + np.einsum("tfi,ti->tf", feet, up) - geometry.foot_radius


def gravity_direction(orientation: np.ndarray) -> np.ndarray:
    """(T, 3) direction of gravity in the base frame of (T, 4) unit quaternions xyzw."""
    return rotate_inverse(orientation, np.broadcast_to(np.array([0.0, 0.0, -1.0]), (len(orientation), 3)))


def _joints(columns: Columns, robot: RobotSpec, signal: str) -> np.ndarray:
    return np.stack([columns[f"joint/{joint}/{signal}"] for joint in robot.joints], axis=1)


def _stack(columns: Columns, prefix: str, leaves: tuple[str, ...]) -> np.ndarray:
    return np.stack([columns[f"{prefix}/{leaf}"] for leaf in leaves], axis=1)
