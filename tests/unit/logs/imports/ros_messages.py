"""Messages of ROS as the tests write them, serialised by rosbags."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from rosbags.typesys import Stores, get_typestore

START = 1_700_000_000_000_000_000  # ns since 1970
ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)


def header(store, nanoseconds: int):
    """A header with a stamp; ROS 1 has a counter in it too."""
    stamp = store.types["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
    before = (0,) if store is ROS1 else ()
    return store.types["std_msgs/msg/Header"](*before, stamp, "base")


def joint_state(store, nanoseconds: int, names, position, velocity=(), effort=()):
    arrays = [np.asarray(each, np.float64) for each in (position, velocity, effort)]
    return store.types["sensor_msgs/msg/JointState"](header(store, nanoseconds), list(names), *arrays)


def image(store, nanoseconds: int, size: int):
    make = store.types["sensor_msgs/msg/Image"]
    return make(header(store, nanoseconds), 1, size, "mono8", 0, size, np.zeros(size, np.uint8))


def multi_array(store, values):
    layout = store.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    return store.types["std_msgs/msg/Float64MultiArray"](layout, np.asarray(values, np.float64))


def motion(count: int = 50) -> SimpleNamespace:
    """Times in ns with a transport delay of about 2 ms, and three signals of two joints."""
    rng = np.random.default_rng(3)
    stamps = START + (np.arange(count) * 4_000_000).astype(np.int64)
    return SimpleNamespace(
        stamps=stamps,
        logged=stamps + 2_000_000 + rng.integers(0, 500_000, count),
        position=rng.normal(size=(count, 2)),
        velocity=rng.normal(size=(count, 2)),
        command=rng.normal(size=(count, 2)),
    )
