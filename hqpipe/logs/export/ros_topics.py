"""Which ROS 2 topics a trial becomes: the columns of the log format as messages of standard packages.

Joints are `sensor_msgs/msg/JointState`, which has no place for a valve command or a pressure; these are topics of their own.
The base's linear velocity is in the world's frame and its angular velocity in the body's, so that they are two vectors and
no twist.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hqpipe.logs.trajectory import Trajectory

_UNKNOWN_COVARIANCE = -1.0  # first element, of what an IMU does not measure (sensor_msgs/msg/Imu)
_JOINT_CHANNELS = ("valve_command", "pressure_a", "pressure_b")

Build = Callable[[Mapping[str, Any], Any, Sequence[Any]], Any]
"""(message types, header, values of a row) → message."""


@dataclass(frozen=True, eq=False)
class Topic:
    """One topic.

    Attributes:
        name: of the topic. kind: message type. frame: its `frame_id`.
        columns: the columns that it carries. values: one array (T,) or (T, J) for each argument of `build`, None where
            it is not recorded. build: makes a message of the values of one row.
    """

    name: str
    kind: str
    frame: str
    columns: tuple[str, ...]
    values: tuple[np.ndarray | None, ...]
    build: Build

    def message(self, types: Mapping[str, Any], header: Any, row: int) -> Any:
        """The message of one row; `types` are the message classes by name."""
        return self.build(types, header, [None if part is None else part[row] for part in self.values])


def topics(t: Trajectory) -> list[Topic]:
    """All topics of a trial; every recorded column is in one of them."""
    velocity = t.velocity if t.velocity_source == "measured" else None
    found = [_joint_states("/joint_states", t, ("position", t.position), ("velocity", velocity), ("effort", t.effort))]
    if t.position_command is not None or t.effort_command is not None:
        position, effort = ("position_command", t.position_command), ("effort_command", t.effort_command)
        found.append(_joint_states("/joint_commands", t, position, ("velocity_command", None), effort))
    rest = dict(t.extra)
    for channel in _JOINT_CHANNELS:
        values = getattr(t, channel)
        if values is not None:
            rest |= {f"joint/{joint}/{channel}": values[:, j] for j, joint in enumerate(t.joints)}
    for group in _GROUPS:
        while columns := group.match(rest):
            found.append(group.topic(columns, [rest.pop(name) for name in columns]))
    found += [_scalar(name, values) for name, values in sorted(rest.items())]
    return _with_own_names(found)


def _joint_states(name: str, t: Trajectory, *parts: tuple[str, np.ndarray | None]) -> Topic:
    names = list(t.joints)
    columns = tuple(f"joint/{joint}/{channel}" for channel, values in parts if values is not None for joint in names)
    nothing = np.empty(0)

    def build(types: Mapping[str, Any], header: Any, row: Sequence[Any]) -> Any:
        position, velocity, effort = (nothing if part is None else part for part in row)
        return types["sensor_msgs/msg/JointState"](header, names, position, velocity, effort)

    return Topic(name, "sensor_msgs/msg/JointState", "", columns, tuple(values for _, values in parts), build)


@dataclass(frozen=True)
class _Group:
    """Columns that make one message: `pattern` matches the first one, `others` are the endings of all of them."""

    pattern: str
    endings: tuple[str, ...]
    suffix: str
    kind: str
    frame: str
    build: Build

    def match(self, columns: Mapping[str, Any]) -> tuple[str, ...]:
        """The columns of the first message that is complete; empty where there is none."""
        for name in columns:
            if stem := re.fullmatch(self.pattern, name):
                wanted = tuple(stem.group(1) + ending for ending in self.endings)
                if all(each in columns for each in wanted):
                    return wanted
        return ()

    def topic(self, columns: Sequence[str], values: Sequence[np.ndarray]) -> Topic:
        stem = columns[0].removesuffix(self.endings[0]).rstrip("/")
        return Topic(_topic_name(stem + self.suffix), self.kind, self.frame, tuple(columns), tuple(values), self.build)


def _vector(types: Mapping[str, Any], row: Sequence[Any]) -> Any:
    return types["geometry_msgs/msg/Vector3"](*map(float, row))


def _vector_stamped(types: Mapping[str, Any], header: Any, row: Sequence[Any]) -> Any:
    return types["geometry_msgs/msg/Vector3Stamped"](header, _vector(types, row))


def _pose(types: Mapping[str, Any], header: Any, row: Sequence[Any]) -> Any:
    point = types["geometry_msgs/msg/Point"](*map(float, row[:3]))
    turn = types["geometry_msgs/msg/Quaternion"](*map(float, row[3:]))
    return types["geometry_msgs/msg/PoseStamped"](header, types["geometry_msgs/msg/Pose"](point, turn))


def _imu(types: Mapping[str, Any], header: Any, row: Sequence[Any]) -> Any:
    unknown = np.zeros(9)
    unknown[0] = _UNKNOWN_COVARIANCE
    level = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    rest = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    return types["sensor_msgs/msg/Imu"](header, level, unknown, rest, unknown, _vector(types, row), np.zeros(9))


def _twist(types: Mapping[str, Any], header: Any, row: Sequence[Any]) -> Any:
    forward, sideways, turn = map(float, row)
    vector = types["geometry_msgs/msg/Vector3"]
    both = types["geometry_msgs/msg/Twist"](vector(forward, sideways, 0.0), vector(0.0, 0.0, turn))
    return types["geometry_msgs/msg/TwistStamped"](header, both)


def _pressure(types: Mapping[str, Any], header: Any, row: Sequence[Any]) -> Any:
    return types["sensor_msgs/msg/FluidPressure"](header, float(row[0]), 0.0)  # 0: the variance is unknown


def _temperature(types: Mapping[str, Any], header: Any, row: Sequence[Any]) -> Any:
    return types["sensor_msgs/msg/Temperature"](header, float(row[0]), 0.0)


_AXES = ("x", "y", "z")
_POSE = (*(f"position/{a}" for a in _AXES), *(f"orientation/{a}" for a in (*_AXES, "w")))
_GROUPS = (
    _Group(r"(base/)position/x", _POSE, "/pose", "geometry_msgs/msg/PoseStamped", "world", _pose),
    _Group(
        r"(base/linear_velocity/|foot/[^/]+/force/)x",
        _AXES,
        "",
        "geometry_msgs/msg/Vector3Stamped",
        "world",
        _vector_stamped,
    ),
    _Group(r"(base/angular_velocity/)x", _AXES, "", "geometry_msgs/msg/Vector3Stamped", "base", _vector_stamped),
    _Group(
        r"(imu/)linear_acceleration/x",
        tuple(f"linear_acceleration/{a}" for a in _AXES),
        "",
        "sensor_msgs/msg/Imu",
        "imu",
        _imu,
    ),
    _Group(r"(command/)vx", ("vx", "vy", "wz"), "", "geometry_msgs/msg/TwistStamped", "base", _twist),
    _Group(r"(joint/[^/]+/pressure_[ab]|supply/pressure)", ("",), "", "sensor_msgs/msg/FluidPressure", "", _pressure),
    _Group(r"(supply/oil_temperature)", ("",), "", "sensor_msgs/msg/Temperature", "", _temperature),
)


def _scalar(column: str, values: np.ndarray) -> Topic:
    def build(types: Mapping[str, Any], header: Any, row: Sequence[Any]) -> Any:
        return types["std_msgs/msg/Float64"](float(row[0]))

    return Topic(_topic_name(column), "std_msgs/msg/Float64", "", (column,), (values,), build)


def _topic_name(column: str) -> str:
    """A name that ROS 2 takes: letters, digits and underscores between slashes, no digit first."""
    tokens = (re.sub(r"\W", "_", token, flags=re.ASCII) or "_" for token in column.split("/"))
    return "/" + "/".join(f"_{token}" if token[0].isdigit() else token for token in tokens)


def _with_own_names(found: Sequence[Topic]) -> list[Topic]:
    """The topics with a number behind a name that another one has already."""
    taken: set[str] = set()
    named = []
    for topic in found:
        name, count = topic.name, 1
        while name in taken:
            count += 1
            name = f"{topic.name}_{count}"
        taken.add(name)
        named.append(replace(topic, name=name))
    return named
