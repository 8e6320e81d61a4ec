"""Bags of ROS 1 and ROS 2, written with rosbags."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from damage import ANY_FILE, refuses_every, survives_flips

pytest.importorskip("rosbags")

from ros_messages import ROS1, ROS2, START, image, joint_state, motion, multi_array
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from hqpipe.errors import HqpipeError
from hqpipe.logs.imports.recording import ImportLogError
from hqpipe.logs.imports.rosbag import RosbagReader
from hqpipe.logs.imports.topics import LARGEST_MESSAGE

STATE, COMMAND, CAMERA = "/joint_states", "/command", "/camera"
JOINTS = ("hip", "knee")


def write(path: Path, ros: int, storage: StoragePlugin = StoragePlugin.SQLITE3, shift: int = 0) -> object:
    """A bag with joint states, a command without header and images; `shift` puts the stamps on another clock."""
    data, store = motion(), ROS1 if ros == 1 else ROS2
    writer = Writer1(path) if ros == 1 else Writer2(path, version=9, storage_plugin=storage)
    serialize = store.serialize_ros1 if ros == 1 else store.serialize_cdr
    with writer:
        connections = {
            topic: writer.add_connection(topic, f"{kind}", typestore=store)
            for topic, kind in (
                (STATE, "sensor_msgs/msg/JointState"),
                (COMMAND, "std_msgs/msg/Float64MultiArray"),
                (CAMERA, "sensor_msgs/msg/Image"),
            )
        }
        for i, (stamp, logged) in enumerate(zip(data.stamps, data.logged, strict=True)):
            state = joint_state(store, int(stamp) + shift, JOINTS, data.position[i], data.velocity[i])
            for topic, message in (
                (STATE, state),
                (COMMAND, multi_array(store, data.command[i])),
                (CAMERA, image(store, int(stamp), 64)),
            ):
                kind = connections[topic].msgtype
                writer.write(connections[topic], int(logged), serialize(message, kind))
    return data


@pytest.fixture(params=["ros1", "sqlite3", "mcap"])
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, object]:
    path = tmp_path / ("log.bag" if request.param == "ros1" else "log")
    storage = StoragePlugin.MCAP if request.param == "mcap" else StoragePlugin.SQLITE3
    return path, write(path, 1 if request.param == "ros1" else 2, storage)


def test_arrays_come_back(bag: tuple[Path, object]) -> None:
    path, data = bag
    (recording,) = RosbagReader.read(path)
    state, command = recording.streams
    assert (state.name, command.name) == (STATE, COMMAND)
    for index, joint in enumerate(JOINTS):
        np.testing.assert_array_equal(state.fields[f"position/{joint}"], data.position[:, index])
        np.testing.assert_array_equal(state.fields[f"velocity/{joint}"], data.velocity[:, index])
        np.testing.assert_array_equal(command.fields[f"data[{index}]"], data.command[:, index])
    assert not any(name.startswith(("effort", "header", "name")) for name in state.fields)


def test_clocks_share_an_epoch(bag: tuple[Path, object]) -> None:
    path, data = bag
    state, command = RosbagReader.read(path)[0].streams
    assert (state.time_name, command.time_name) == ("header stamp", "log time")
    np.testing.assert_allclose(state.time, (data.stamps - START) / 1e9, atol=1e-9)
    np.testing.assert_allclose(command.time, (data.logged - START) / 1e9, atol=1e-9)


def test_notes_state_delay_and_what_is_not_read(bag: tuple[Path, object]) -> None:
    path, data = bag
    (recording,) = RosbagReader.read(path)
    median = float(np.median(data.logged - data.stamps)) / 1e6
    assert any(f"{STATE}: time is the header stamp" in note and f"{median:.2f} ms" in note for note in recording.notes)
    assert any(note.startswith(f"{CAMERA}: not read (images") for note in recording.notes)


def test_a_folder_of_ros2_is_claimed(tmp_path: Path) -> None:
    write(tmp_path / "log", 2)
    assert RosbagReader.claims_folder(tmp_path / "log")
    assert not RosbagReader.claims_folder(tmp_path)


def test_compressed_bags_are_read(tmp_path: Path) -> None:
    states = [joint_state(store, START, JOINTS, [1.0, 2.0]) for store in (ROS1, ROS2)]
    for index, compression in enumerate(Writer1.CompressionFormat):
        writer = Writer1(tmp_path / f"{index}.bag")
        writer.set_compression(compression)
        with writer:
            connection = writer.add_connection(STATE, "sensor_msgs/msg/JointState", typestore=ROS1)
            writer.write(connection, START, ROS1.serialize_ros1(states[0], connection.msgtype))
    for mode in (CompressionMode.FILE, CompressionMode.MESSAGE):
        writer = Writer2(tmp_path / mode.name, version=9)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            connection = writer.add_connection(STATE, "sensor_msgs/msg/JointState", typestore=ROS2)
            writer.write(connection, START, ROS2.serialize_cdr(states[1], connection.msgtype))
    paths = list(tmp_path.iterdir())
    assert len(paths) == 4
    for path in paths:
        assert RosbagReader.read(path)[0].streams[0].fields["position/knee"] == [2.0]


def test_a_lone_database_is_read(tmp_path: Path) -> None:
    data = write(tmp_path / "log", 2)
    (recording,) = RosbagReader.read(next((tmp_path / "log").glob("*.db3")))
    np.testing.assert_array_equal(recording.streams[0].fields["position/hip"], data.position[:, 0])


def test_stamps_of_another_clock_are_shifted_to_the_log(tmp_path: Path) -> None:
    data = write(tmp_path / "log", 2, shift=-START + 10**9)
    (recording,) = RosbagReader.read(tmp_path / "log")
    state, command = recording.streams
    least = int((data.logged - data.stamps).min())
    np.testing.assert_allclose(state.time - command.time, (data.stamps + least - data.logged) / 1e9, atol=2e-9)
    assert any("on another clock than the log" in note for note in recording.notes)


def test_joints_in_varying_order_and_number(tmp_path: Path) -> None:
    orders = [("hip", "knee"), ("knee", "hip"), ("knee",), ("hip", "ankle")]
    with Writer2(tmp_path / "log", version=9) as writer:
        connection = writer.add_connection(STATE, "sensor_msgs/msg/JointState", typestore=ROS2)
        for index, names in enumerate(orders):
            message = joint_state(ROS2, START + index, names, [len(name) + 10 * index for name in names])
            writer.write(connection, START + index, ROS2.serialize_cdr(message, connection.msgtype))
    fields = RosbagReader.read(tmp_path / "log")[0].streams[0].fields
    nan = np.nan
    np.testing.assert_array_equal(fields["position/hip"], [3, 13, nan, 33])
    np.testing.assert_array_equal(fields["position/knee"], [4, 14, 24, nan])
    np.testing.assert_array_equal(fields["position/ankle"], [nan, nan, nan, 35])


@pytest.mark.parametrize(("stamps", "reason"), [((0, 0, 0), "not all set"), ((5, 3, 4), "run backwards 1 times")])
def test_unsound_stamps_leave_the_log_time(tmp_path: Path, stamps: tuple[int, ...], reason: str) -> None:
    with Writer2(tmp_path / "log", version=9) as writer:
        connection = writer.add_connection(STATE, "sensor_msgs/msg/JointState", typestore=ROS2)
        for index, stamp in enumerate(stamps):
            message = joint_state(ROS2, stamp, JOINTS, [index, 0.0])
            writer.write(connection, START + 10**6 * index, ROS2.serialize_cdr(message, connection.msgtype))
    (recording,) = RosbagReader.read(tmp_path / "log")
    assert recording.streams[0].time_name == "log time"
    np.testing.assert_allclose(recording.streams[0].time, [0, 1e-3, 2e-3])
    assert any(reason in note for note in recording.notes)


def test_long_arrays_and_large_messages_are_left_out(tmp_path: Path) -> None:
    with Writer2(tmp_path / "log", version=9) as writer:
        connection = writer.add_connection(COMMAND, "std_msgs/msg/Float64MultiArray", typestore=ROS2)
        for index, count in enumerate((3, 200, LARGEST_MESSAGE // 8)):
            message = multi_array(ROS2, np.ones(count))
            writer.write(connection, START + index, ROS2.serialize_cdr(message, connection.msgtype))
    (recording,) = RosbagReader.read(tmp_path / "log")
    np.testing.assert_array_equal(recording.streams[0].fields["data[2]"], [1, np.nan])
    assert any("more than 128 components" in note for note in recording.notes)
    assert any("1 messages of more than" in note for note in recording.notes)


def test_a_bag_without_numbers_is_refused(tmp_path: Path) -> None:
    with Writer2(tmp_path / "log", version=9) as writer:
        connection = writer.add_connection(CAMERA, "sensor_msgs/msg/Image", typestore=ROS2)
        writer.write(connection, START, ROS2.serialize_cdr(image(ROS2, START, 10), connection.msgtype))
    with pytest.raises(ImportLogError, match="no topic with a number"):
        RosbagReader.read(tmp_path / "log")


def test_damaged_bags_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.bag"
    write(path, 1)
    refuses_every(ANY_FILE, lambda: RosbagReader.read(path), path, exit_code=1)
    survives_flips(lambda: RosbagReader.read(path), path, exit_code=1)


@pytest.mark.parametrize(
    "content", ["", "a: [", "rosbag2_bagfile_information: 3", "rosbag2_bagfile_information: {version: 99}"]
)
def test_bad_metadata_is_refused(tmp_path: Path, content: str) -> None:
    write(tmp_path / "log", 2)
    (tmp_path / "log" / "metadata.yaml").write_text(content)
    with pytest.raises(HqpipeError):
        RosbagReader.read(tmp_path / "log")
