"""MCAP files are read back with mcap-ros2-support, which shares no code with the writer, and hold the arrays of the log."""

from __future__ import annotations

import builtins
import json

import numpy as np
import pytest
from log_builders import make_columns, put

from hqpipe.errors import UsageError
from hqpipe.logs.export.mcap_file import EPOCH_S, METADATA, write_mcap
from hqpipe.logs.export.ros_topics import topics
from hqpipe.logs.log_set import read_log_set

mcap_ros2 = pytest.importorskip("mcap_ros2.decoder", reason="needs the package mcap-ros2-support")
pytest.importorskip("rosbags", reason="needs the package rosbags")

EXTRA = (
    *(f"base/{part}/{a}" for part in ("position", "linear_velocity", "angular_velocity") for a in "xyz"),
    *(f"base/orientation/{a}" for a in "xyzw"),
    *(f"imu/linear_acceleration/{a}" for a in "xyz"),
    *(f"foot/LF/force/{a}" for a in "xyz"),
    *("foot/LF/contact", "command/vx", "command/vy", "command/wz", "supply/pressure", "supply/oil_temperature"),
    *("supply/voltage", "joint/hip/duty", "2nd clock", "2nd_clock"),
)


@pytest.fixture
def rich(tmp_path):
    """A log set in single precision with every kind of column."""
    rng = np.random.default_rng(3)
    columns = make_columns(samples=200)
    for joint in ("hip", "knee"):
        columns |= {f"joint/{joint}/{c}": rng.normal(size=200) for c in ("valve_command", "effort_command")}
        columns |= {f"joint/{joint}/pressure_{c}": 1e7 + 1e5 * rng.normal(size=200) for c in "ab"}
    columns |= {name: rng.normal(size=200) for name in EXTRA}
    stored = {name: v if name == "time" else v.astype(np.float32) for name, v in columns.items()}
    put(tmp_path / "logs", "a.parquet", stored)
    return read_log_set(tmp_path / "logs", all_heldout=True)


def messages(path):
    """Topic → (log times in ns, decoded messages), and the reader."""
    from mcap.reader import make_reader

    found = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[mcap_ros2.DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            times, parts = found.setdefault(channel.topic, ([], []))
            times.append(message.log_time)
            parts.append(decoded)
    return found


@pytest.fixture
def exported(rich, tmp_path):
    write_mcap(tmp_path / "a.mcap", rich, rich.trials[0])
    return messages(tmp_path / "a.mcap")


def column(parts, *names):
    """(T,) or (T, J) of a field of messages."""
    values = parts
    for name in names:
        values = [getattr(value, name) for value in values]
    return np.array(values)


def test_joint_states_and_commands_are_equal_to_the_log(rich, exported):
    t = rich.trials[0].trajectory
    states, commands = exported["/joint_states"][1], exported["/joint_commands"][1]
    assert {tuple(m.name) for m in (*states, *commands)} == {("hip", "knee")}
    for name in ("position", "velocity", "effort"):
        np.testing.assert_array_equal(column(states, name), getattr(t, name))
    np.testing.assert_array_equal(column(commands, "position"), t.position_command)
    np.testing.assert_array_equal(column(commands, "effort"), t.effort_command)
    assert column(commands, "velocity").shape == (200, 0), "there is no such command"


def test_times_count_from_the_fixed_epoch(rich, exported):
    expected = EPOCH_S * 10**9 + np.round(rich.trials[0].trajectory.time * 1e9).astype(np.int64)
    for times, parts in exported.values():
        np.testing.assert_array_equal(times, expected)
        if hasattr(parts[0], "header"):
            stamps = column(parts, "header", "stamp", "sec") * 10**9 + column(parts, "header", "stamp", "nanosec")
            np.testing.assert_array_equal(stamps, expected)


@pytest.mark.parametrize(
    ("topic", "fields", "name"),
    [
        ("/joint/hip/valve_command", ("data",), "joint/hip/valve_command"),
        ("/joint/knee/pressure_b", ("fluid_pressure",), "joint/knee/pressure_b"),
        ("/supply/pressure", ("fluid_pressure",), "supply/pressure"),
        ("/supply/oil_temperature", ("temperature",), "supply/oil_temperature"),
        ("/supply/voltage", ("data",), "supply/voltage"),
        ("/joint/hip/duty", ("data",), "joint/hip/duty"),
        ("/foot/LF/contact", ("data",), "foot/LF/contact"),
        ("/foot/LF/force", ("vector", "z"), "foot/LF/force/z"),
        ("/base/pose", ("pose", "position", "y"), "base/position/y"),
        ("/base/pose", ("pose", "orientation", "w"), "base/orientation/w"),
        ("/base/linear_velocity", ("vector", "x"), "base/linear_velocity/x"),
        ("/base/angular_velocity", ("vector", "z"), "base/angular_velocity/z"),
        ("/imu", ("linear_acceleration", "y"), "imu/linear_acceleration/y"),
        ("/command", ("twist", "linear", "y"), "command/vy"),
        ("/command", ("twist", "angular", "z"), "command/wz"),
    ],
)
def test_every_kind_of_column_is_in_its_message(rich, exported, topic, fields, name):
    values = rich.trials[0].table(rich.path).columns[name]
    np.testing.assert_array_equal(column(exported[topic][1], *fields), values)


def test_no_column_is_lost_and_no_topic_holds_two(rich):
    found = topics(rich.trials[0].trajectory)
    columns = [name for topic in found for name in topic.columns]
    assert sorted(columns) == sorted(set(rich.trials[0].trajectory.columns()) - {"time"})
    names = [topic.name for topic in found]
    assert len(set(names)) == len(names) and {"/_2nd_clock", "/_2nd_clock_2"} <= set(names)


def test_an_imu_says_what_it_does_not_measure(exported):
    first = exported["/imu"][1][0]
    assert (first.orientation_covariance[0], first.angular_velocity_covariance[0]) == (-1.0, -1.0)


def test_a_velocity_that_was_not_recorded_is_left_out(tmp_path):
    columns = {name: v for name, v in make_columns(samples=100).items() if not name.endswith(("velocity", "effort"))}
    put(tmp_path / "logs", "a.parquet", columns)
    log_set = read_log_set(tmp_path / "logs", all_heldout=True)
    write_mcap(tmp_path / "a.mcap", log_set, log_set.trials[0])
    state = messages(tmp_path / "a.mcap")["/joint_states"][1][0]
    assert (len(state.position), len(state.velocity), len(state.effort)) == (2, 0, 0)


def test_definitions_and_facts_of_the_log_are_in_the_file(rich, tmp_path):
    from mcap.reader import make_reader

    write_mcap(tmp_path / "a.mcap", rich, rich.trials[0])
    with (tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}[METADATA]
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    joint_state = next(s for s in summary.schemas.values() if s.name == "sensor_msgs/msg/JointState")
    assert b"float64[] position" in joint_state.data and b"MSG: std_msgs/Header" in joint_state.data
    assert metadata["trial"] == "a.parquet" and metadata["log_set_sha256"] == rich.sha256
    assert json.loads(metadata["topics"])["/base/pose"][0] == "base/position/x"
    assert json.loads(metadata["units"])["joint/hip/effort"] == "N·m"


def test_the_same_log_gives_the_same_bytes(rich, tmp_path):
    for name in ("a.mcap", "b.mcap"):
        write_mcap(tmp_path / name, rich, rich.trials[0])
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_without_the_packages_one_line_says_how_to_get_them(rich, tmp_path, monkeypatch):
    real = builtins.__import__

    def lacking(name, *args, **kwargs):
        if name.startswith("rosbags"):
            raise ModuleNotFoundError("No module named 'rosbags'", name="rosbags")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", lacking)
    with pytest.raises(UsageError, match=r"without the package rosbags: pip install 'hqpipe\[ros\]'"):
        write_mcap(tmp_path / "a.mcap", rich, rich.trials[0])
    assert not (tmp_path / "a.mcap").exists()
