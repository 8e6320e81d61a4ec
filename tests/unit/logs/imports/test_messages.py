"""Messages as rows of named numbers."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.logs.imports.messages import MOST_COMPONENTS, nanoseconds, row_of
from hqpipe.logs.imports.topics import MOST_FIELDS, Topic


def numbers(message: object) -> dict[str, float]:
    return row_of(message).numbers


def test_nested_fields_are_named_by_their_path() -> None:
    message = {"pose": {"position": {"x": 1, "y": 2.5}}, "ok": True, "gains": [3, 4]}
    assert numbers(message) == {
        "pose/position/x": 1.0,
        "pose/position/y": 2.5,
        "ok": 1.0,
        "gains[0]": 3.0,
        "gains[1]": 4.0,
    }


def test_arrays_beside_names_are_named_by_them() -> None:
    message = {"name": ["hip", "knee"], "position": [1, 2], "effort": [], "velocity": np.array([3.0, 4.0])}
    assert numbers(message) == {"position/hip": 1, "position/knee": 2, "velocity/hip": 3, "velocity/knee": 4}


def test_arrays_in_a_message_beside_names_are_named_by_them() -> None:
    state = {
        "joint_names": ["hip", "knee"],
        "actual": {"positions": [1, 2]},
        "time_from_start": {"sec": 1, "nanosec": 5},
    }
    assert numbers(state) == {"actual/positions/hip": 1, "actual/positions/knee": 2, "time_from_start": 1.000000005}


def test_interfaces_of_joints() -> None:
    values = [
        {"interface_names": ["position", "effort"], "values": [1, 2]},
        {"interface_names": ["position"], "values": [3]},
    ]
    state = {"joint_names": ["hip", "knee"], "interface_values": values}
    assert numbers(state) == {
        "interface_values/hip/values/position": 1,
        "interface_values/hip/values/effort": 2,
        "interface_values/knee/values/position": 3,
    }


def test_as_many_values_as_names_are_needed() -> None:
    row = row_of({"name": ["a", "b"], "position": [1, 2, 3]})
    assert row.numbers == {}
    assert row.left_out == {"position": "not as many values as names"}
    assert row_of({"name": ["a", "a"], "position": [1, 2]}).left_out == {"position": "a name stands twice"}


def test_messages_in_a_list_are_named_by_themselves_or_their_place() -> None:
    assert numbers({"joints": [{"name": "b", "q": 1}, {"name": "a", "q": 2}]}) == {"joints/b/q": 1, "joints/a/q": 2}
    assert numbers({"motor_state": [{"q": 1}, {"q": 2}]}) == {"motor_state[0]/q": 1, "motor_state[1]/q": 2}


def test_what_is_no_number_is_left_out() -> None:
    row = row_of({"mode": "stand", "data": b"123", "many": [0.0] * (MOST_COMPONENTS + 1), "none": None, "x": 1})
    assert row.numbers == {"x": 1}
    assert set(row.left_out) == {"mode", "data", "many"}


@pytest.mark.parametrize(
    ("message", "stamp"),
    [
        ({"header": {"stamp": {"sec": 2, "nanosec": 7}, "frame_id": "x"}, "x": 1}, 2_000_000_007),
        ({"header": {"seq": 1, "stamp": {"secs": 2, "nsecs": 7}}, "x": 1}, 2_000_000_007),
        ({"stamp": {"sec": 2, "nanosec": 7}, "x": 1}, 2_000_000_007),
        ({"timestamp": {"seconds": 2, "nanos": 7}, "x": 1}, 2_000_000_007),
        ({"x": 1}, None),
    ],
)
def test_stamps(message: dict, stamp: int | None) -> None:
    row = row_of(message)
    assert (row.stamp, row.numbers) == (stamp, {"x": 1})


def test_a_timestamp_that_is_a_number_is_a_field() -> None:
    row = row_of({"timestamp": 12})
    assert (row.stamp, row.numbers) == (None, {"timestamp": 12})
    assert nanoseconds({"sec": 1.5, "nanosec": 0}) is None


def test_a_topic_fills_what_a_message_lacks() -> None:
    topic = Topic("/x")
    for time, message in enumerate(({"a": 1}, {"b": 2}, {"a": 3, "b": 4})):
        topic.add(message, time)
    np.testing.assert_array_equal(topic.fields()["a"], [1, np.nan, 3])
    np.testing.assert_array_equal(topic.fields()["b"], [np.nan, 2, 4])


def test_a_topic_has_a_bounded_number_of_fields() -> None:
    topic = Topic("/x")
    for time in range(2):
        topic.add({f"{time}_{index}": 1 for index in range(MOST_FIELDS - 10)}, time)
    assert len(topic.fields()) == MOST_FIELDS
    assert any(f"a topic may have {MOST_FIELDS} fields" in note for note in topic.notes())
