"""Decoded messages of any library as rows of named numbers.

A message is a mapping (JSON), a dataclass (ROS) or a protobuf message. Its fields are named by their path, `pose/position/x`;
components of an array by their place, `position[0]`, or, where the message names them, by the name, `position/left_hip`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

MOST_COMPONENTS = 128  # of one array; assumption: robots have fewer joints, and longer arrays are scans, maps or images
_NAMES = ("name", "names", "joint_names", "interface_names")  # sensor_msgs and control_msgs, where arrays are per joint
_LABELS = ("name", "joint_name", "child_frame_id")  # of one message in a list: Foxglove joint states, transforms
_SECONDS = ("sec", "secs", "seconds")  # builtin_interfaces, ROS 1 and protobuf spell the parts of a time differently
_NANOSECONDS = ("nanosec", "nsec", "nsecs", "nanos")
_STAMPS = ("header", "stamp", "timestamp")


@dataclass
class Row:
    """One message.

    Attributes:
        numbers: field → value. left_out: field → why it is no signal.
        stamp: ns, when the sender says that it was measured; None if it does not say.
    """

    numbers: dict[str, float] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    stamp: int | None = None


def row_of(message: Any) -> Row:
    """The numbers of a message, and its stamp: `header.stamp`, or a `stamp` or `timestamp` of seconds and nanoseconds."""
    row = Row()
    parts = parts_of(message)
    for name in _STAMPS:
        if name not in parts:
            continue
        inner = parts_of(parts[name])
        row.stamp = nanoseconds(parts[name]) if name != "header" else nanoseconds(inner.get("stamp"))
        if row.stamp is not None:
            del parts[name]
            break
    _take_parts(row, "", parts)
    return row


def parts_of(message: Any) -> dict[str, Any]:
    """Field → value of a message; empty for what is none."""
    if isinstance(message, Mapping):
        return {str(name): value for name, value in message.items()}
    if dataclasses.is_dataclass(message):
        return {name: getattr(message, name) for name in _variables(type(message))}
    if descriptor := getattr(message, "DESCRIPTOR", None):
        return {
            each.name: getattr(message, each.name)
            for each in descriptor.fields
            if not each.has_presence or message.HasField(each.name)
        }
    return {}


@cache
def _variables(kind: type) -> tuple[str, ...]:
    """The fields of a dataclass without its constants, which in the classes that rosbags makes of ROS types are fields too."""
    return tuple(each.name for each in dataclasses.fields(kind) if not str(each.type).startswith("ClassVar"))


def nanoseconds(value: Any) -> int | None:
    """A time of seconds and nanoseconds as one number; None for anything else."""
    parts = parts_of(value)
    if len(parts) != 2:
        return None
    seconds, rest = (next((parts[n] for n in names if n in parts), None) for names in (_SECONDS, _NANOSECONDS))
    if not (isinstance(seconds, int) and isinstance(rest, int)):
        return None
    return seconds * 10**9 + rest


def _take_parts(row: Row, path: str, parts: Mapping[str, Any]) -> None:
    names = next((list(parts[n]) for n in _NAMES if n in parts and _are_names(parts[n])), None)
    for name, value in parts.items():
        if names is None or name not in _NAMES:
            _take(row, f"{path}/{name}" if path else name, value, names)


def _take(row: Row, path: str, value: Any, names: list[str] | None) -> None:
    if isinstance(value, (bool, int, float, np.number, np.bool_)):
        row.numbers[path] = float(value)
    elif isinstance(value, str):
        row.left_out[path] = "text"
    elif isinstance(value, (bytes, bytearray, memoryview)):
        row.left_out[path] = "bytes"
    elif (time := nanoseconds(value)) is not None:
        row.numbers[path] = time / 1e9
    elif parts := parts_of(value):
        _take_message(row, path, parts, names)
    elif isinstance(value, np.ndarray):
        _take_numbers(row, path, value.ravel().tolist(), names)
    elif isinstance(value, Iterable):
        _take_list(row, path, list(value), names)


def _take_message(row: Row, path: str, parts: Mapping[str, Any], names: list[str] | None) -> None:
    """A message in a message; arrays in it may be of the joints that the outer one names, as in control_msgs."""
    if names is not None and not any(n in parts for n in _NAMES):
        for name, value in parts.items():
            _take(row, f"{path}/{name}", value, names)
    else:
        _take_parts(row, path, parts)


def _take_list(row: Row, path: str, values: list[Any], names: list[str] | None) -> None:
    if not values:
        return
    if all(isinstance(value, (bool, int, float)) for value in values):
        _take_numbers(row, path, values, names)
    elif any(isinstance(value, (str, bytes)) for value in values):
        row.left_out[path] = "text"
    elif len(values) > MOST_COMPONENTS:
        row.left_out[path] = f"more than {MOST_COMPONENTS} components"
    else:
        labels, key = _labels(values, names)
        for name, value in zip(labels, values, strict=True):
            parts = {each: part for each, part in parts_of(value).items() if each != key}
            _take_parts(row, path + name, parts)


def _take_numbers(row: Row, path: str, values: Sequence[float], names: list[str] | None) -> None:
    if len(values) > MOST_COMPONENTS:
        row.left_out[path] = f"more than {MOST_COMPONENTS} components"
    elif names is None:
        row.numbers.update((f"{path}[{index}]", float(value)) for index, value in enumerate(values))
    elif len(names) != len(values):
        if values:
            row.left_out[path] = "not as many values as names"
    elif len(set(names)) < len(names):
        row.left_out[path] = "a name stands twice"
    else:
        row.numbers.update((f"{path}/{name}", float(value)) for name, value in zip(names, values, strict=True))


def _labels(values: list[Any], names: list[str] | None) -> tuple[list[str], str]:
    """What to call each message of a list: by the names beside it, by a name in it (and its key), or by its place."""
    if names is not None and len(names) == len(values) == len(set(names)):
        return [f"/{name}" for name in names], ""
    for key in _LABELS:
        own = [parts_of(value).get(key) for value in values]
        if all(isinstance(each, str) and each for each in own) and len(set(own)) == len(own):
            return [f"/{each}" for each in own], key
    return [f"[{index}]" for index in range(len(values))], ""


def _are_names(value: Any) -> bool:
    if isinstance(value, (str, bytes, Mapping)) or not isinstance(value, Iterable):
        return False
    names = list(value)
    return bool(names) and all(isinstance(name, str) and name for name in names)
