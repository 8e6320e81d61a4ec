"""MCAP files, written with mcap and mcap-ros2-support."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from damage import ANY_FILE, refuses_every, survives_flips

pytest.importorskip("mcap")
pytest.importorskip("rosbags")

from mcap.writer import CompressionType, Writer
from ros_messages import ROS1, START, joint_state, motion

from hqpipe.errors import HqpipeError
from hqpipe.logs.imports.mcap import McapReader
from hqpipe.logs.imports.recording import ImportLogError, Recording

JOINTS = ("hip", "knee")
_LINE = "=" * 80
JOINT_STATE = f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{_LINE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_LINE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
IMAGE = f"""std_msgs/Header header
uint8[] data
{JOINT_STATE[JOINT_STATE.index(_LINE) :]}"""


def read_one(path: Path) -> Recording:
    (recording,) = McapReader.read(path)
    return recording


def write_ros2(path: Path, chunks: bool = True):
    """Joint states and images."""
    ros2 = pytest.importorskip("mcap_ros2.writer")
    data = motion()
    with path.open("wb") as stream:
        writer = ros2.Writer(stream, enable_crcs=True) if chunks else ros2.Writer(stream)
        states = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        images = writer.register_msgdef("sensor_msgs/msg/Image", IMAGE)
        for i, (stamp, logged) in enumerate(zip(data.stamps, data.logged, strict=True)):
            header = {"stamp": {"sec": int(stamp) // 10**9, "nanosec": int(stamp) % 10**9}, "frame_id": "base"}
            state = {"header": header, "name": list(JOINTS), "position": data.position[i].tolist()}
            state |= {"velocity": data.velocity[i].tolist(), "effort": []}
            writer.write_message("/joint_states", states, state, log_time=int(logged), publish_time=int(logged))
            writer.write_message("/camera", images, {"header": header, "data": [1, 2, 3]}, log_time=int(logged))
        writer.finish()
    return data


def named(name: str, position: float) -> dict:
    return {"name": name, "q": position}


def write_json(path: Path, messages: list[object], **options: object) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start()
        schema = writer.register_schema("Command", "jsonschema", b"{}")
        channel = writer.register_channel("/command", "json", schema)
        for index, message in enumerate(messages):
            writer.add_message(channel, START + index * 10**7, json.dumps(message).encode(), START + index * 10**7)
        writer.finish()


def test_messages_of_ros2(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    data = write_ros2(path)
    recording = read_one(path)
    (state,) = recording.streams
    for index, joint in enumerate(JOINTS):
        np.testing.assert_array_equal(state.fields[f"position/{joint}"], data.position[:, index])
        np.testing.assert_array_equal(state.fields[f"velocity/{joint}"], data.velocity[:, index])
    assert state.time_name == "header stamp"
    np.testing.assert_allclose(state.time, (data.stamps - START) / 1e9, atol=1e-9)
    assert any(note.startswith("/camera: not read (images") for note in recording.notes)


def test_messages_of_ros1(tmp_path: Path) -> None:
    path, data = tmp_path / "log.mcap", motion()
    kind = "sensor_msgs/msg/JointState"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros1")
        definition, _ = ROS1.generate_msgdef(kind)
        schema = writer.register_schema("sensor_msgs/JointState", "ros1msg", definition.encode())
        channel = writer.register_channel("/joint_states", "ros1", schema)
        for i, (stamp, logged) in enumerate(zip(data.stamps, data.logged, strict=True)):
            message = joint_state(ROS1, int(stamp), JOINTS, data.position[i])
            writer.add_message(channel, int(logged), bytes(ROS1.serialize_ros1(message, kind)), int(logged))
        writer.finish()
    (state,) = read_one(path).streams
    np.testing.assert_array_equal(state.fields["position/knee"], data.position[:, 1])
    assert state.time_name == "header stamp"


def test_messages_of_ros2_defined_in_idl(tmp_path: Path) -> None:
    from rosbags.typesys import Stores, get_types_from_idl, get_typestore

    idl = "module robot { module msg { struct Motor { double q; sequence<double> tau; string mode; }; }; };"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_idl(idl))
    kind = "robot/msg/Motor"
    with (tmp_path / "log.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        text = f"{'=' * 80}\nIDL: {kind}\n{idl}"
        channel = writer.register_channel("/motor", "cdr", writer.register_schema(kind, "ros2idl", text.encode()))
        for i in range(3):
            message = store.types[kind](0.5 * i, np.array([1.0, i]), "stand")
            writer.add_message(channel, START + i, bytes(store.serialize_cdr(message, kind)), START)
        writer.finish()
    (motor,) = read_one(tmp_path / "log.mcap").streams
    np.testing.assert_array_equal(motor.fields["q"], [0, 0.5, 1])
    np.testing.assert_array_equal(motor.fields["tau[1]"], [0, 1, 2])


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.ZSTD},
        {"compression": CompressionType.LZ4},
        {"use_chunking": False},
        {"use_statistics": False, "use_summary_offsets": False, "repeat_channels": False, "repeat_schemas": False},
    ],
    ids=["zstd", "lz4", "no chunks", "no summary"],
)
def test_messages_in_json(tmp_path: Path, options: dict) -> None:
    path = tmp_path / "log.mcap"
    messages = [
        {
            "timestamp": {"sec": 5, "nsec": i},
            "joints": [{"name": "b", "q": i}, {"name": "a", "q": -i}],
            "on": i > 1,
            "mode": "x",
        }
        for i in range(4)
    ]
    write_json(path, messages, **options)
    recording = read_one(path)
    (command,) = recording.streams
    np.testing.assert_array_equal(command.fields["joints/a/q"], [0, -1, -2, -3])
    np.testing.assert_array_equal(command.fields["joints/b/q"], [0, 1, 2, 3])
    np.testing.assert_array_equal(command.fields["on"], [0, 0, 1, 1])
    assert sum("left out mode" in note and "text" in note for note in recording.notes) == 1


def test_messages_in_protobuf(tmp_path: Path) -> None:
    pb2 = pytest.importorskip("google.protobuf.descriptor_pb2")
    from google.protobuf import descriptor_pool, message_factory, timestamp_pb2

    stamp = pb2.FileDescriptorProto.FromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
    own = pb2.FileDescriptorProto(name="motor.proto", package="robot", syntax="proto3", dependency=[stamp.name])
    kind = own.message_type.add(name="Motor")
    types = pb2.FieldDescriptorProto
    kind.field.add(name="timestamp", number=1, label=1, type=types.TYPE_MESSAGE, type_name=".google.protobuf.Timestamp")
    kind.field.add(name="q", number=2, label=3, type=types.TYPE_DOUBLE)
    kind.field.add(name="speed", number=3, label=1, type=types.TYPE_FLOAT)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(stamp)
    pool.Add(own)
    make = message_factory.GetMessageClass(pool.FindMessageTypeByName("robot.Motor"))
    with (tmp_path / "log.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        files = pb2.FileDescriptorSet(file=[own, stamp]).SerializeToString()
        channel = writer.register_channel(
            "/motor", "protobuf", writer.register_schema("robot.Motor", "protobuf", files)
        )
        for i in range(3):
            message = make(q=[i, -i], speed=0.5 * i)
            message.timestamp.FromNanoseconds(START + i * 10**6)
            writer.add_message(channel, START + i * 10**6 + 5, message.SerializeToString(), START)
        writer.finish()
    (motor,) = read_one(tmp_path / "log.mcap").streams
    np.testing.assert_array_equal(motor.fields["q[1]"], [0, -1, -2])
    np.testing.assert_array_equal(motor.fields["speed"], [0, 0.5, 1])
    assert motor.time_name == "header stamp"
    np.testing.assert_allclose(motor.time, [0, 1e-3, 2e-3], atol=1e-12)


def test_messages_out_of_order_are_sorted_by_log_time(tmp_path: Path) -> None:
    with (tmp_path / "log.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/x", "json", writer.register_schema("X", "jsonschema", b"{}"))
        for time in (3, 1, 2):
            writer.add_message(channel, time * 10**9, json.dumps({"x": time}).encode(), 0)
        writer.finish()
    (stream_x,) = read_one(tmp_path / "log.mcap").streams
    np.testing.assert_array_equal(stream_x.fields["x"], [1, 2, 3])
    np.testing.assert_array_equal(stream_x.time, [0, 1, 2])


def test_unknown_encodings_are_named(tmp_path: Path) -> None:
    with (tmp_path / "log.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/x", "flatbuffer", writer.register_schema("X", "flatbuffer", b"1"))
        writer.add_message(channel, 1, b"123", 0)
        writer.finish()
    with pytest.raises(ImportLogError, match="/x: not read .messages in flatbuffer"):
        McapReader.read(tmp_path / "log.mcap")


def test_damaged_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_ros2(path)
    refuses_every(ANY_FILE, lambda: McapReader.read(path), path, exit_code=1)
    survives_flips(lambda: McapReader.read(path), path, exit_code=1)


def test_messages_that_are_no_objects(tmp_path: Path) -> None:
    for messages in ([1, 2], [[1, 2]], ["a"], [None], [{}]):
        write_json(tmp_path / "log.mcap", messages)
        with pytest.raises(HqpipeError, match="no topic with a number"):
            McapReader.read(tmp_path / "log.mcap")


def test_a_missing_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_json(tmp_path / "log.mcap", [{"x": 1}])
    monkeypatch.setitem(__import__("sys").modules, "mcap", None)
    with pytest.raises(ImportLogError, match=r"pip install 'hqpipe\[ros\]'"):
        McapReader.read(tmp_path / "log.mcap")
