"""ULog files, written by the public specification of the format (docs.px4.io, ULog File Format)."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from damage import ANY_FILE, refuses_every, survives_flips

pytest.importorskip("pyulog")

from hqpipe.logs.imports.recording import ImportLogError
from hqpipe.logs.imports.ulog import UlogReader

START = 12_000_000  # µs
TOPIC = "esc_status:uint64_t timestamp;float[2] rpm;int16_t current;bool armed;char[4] text;uint8_t[3] _padding0;"


def message(kind: str, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), ord(kind)) + content


def file_header() -> bytes:
    return b"\x55\x4c\x6f\x67\x01\x12\x35\x01" + struct.pack("<Q", START)


def subscribe(number: int, instance: int, name: str) -> bytes:
    return message("A", struct.pack("<BH", instance, number) + name.encode())


def data(number: int, time: int, rpm: tuple[float, float], current: int) -> bytes:
    return message("D", struct.pack("<HQ2fh?4s", number, time, *rpm, current, True, b"text"))


def write(path: Path, instances: int = 2, count: int = 20, middle: bytes = b"") -> None:
    parts = [file_header(), message("B", bytes(40)), message("F", TOPIC.encode())]
    parts += [subscribe(number, number, "esc_status") for number in range(instances)]
    for i in range(count):
        for number in range(instances):
            parts.append(data(number, START + 5000 * i + 1000 * number, (i + 0.5, -i), 10 * i + number))
        if i == count // 2:
            parts.append(middle)
    path.write_bytes(b"".join(parts))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "flight.ulg"


def test_arrays_and_instances_come_back(path: Path) -> None:
    write(path)
    (recording,) = UlogReader.read(path)
    first, second = recording.streams
    assert (first.name, second.name) == ("esc_status[0]", "esc_status[1]")
    assert set(first.fields) == {"rpm[0]", "rpm[1]", "current", "armed"}
    np.testing.assert_array_equal(first.fields["rpm[0]"], np.arange(20) + 0.5)
    np.testing.assert_array_equal(second.fields["current"], 10 * np.arange(20) + 1)


def test_time_is_in_seconds_from_the_earliest_message(path: Path) -> None:
    write(path)
    first, second = UlogReader.read(path)[0].streams
    assert first.time_name == "timestamp"
    np.testing.assert_allclose(first.time, 0.005 * np.arange(20), atol=1e-12)
    np.testing.assert_allclose(second.time, 0.005 * np.arange(20) + 0.001, atol=1e-12)


def test_a_lone_instance_has_no_number(path: Path) -> None:
    write(path, instances=1)
    assert [stream.name for stream in UlogReader.read(path)[0].streams] == ["esc_status"]


def test_text_and_dropouts_are_noted(path: Path) -> None:
    write(path, middle=message("O", struct.pack("<H", 120)))
    notes = UlogReader.read(path)[0].notes
    assert any("text[0]" in note and "(text)" in note for note in notes)
    assert any("1 dropouts while logging, the longest 120 ms" in note for note in notes)


def test_messages_without_timestamp_are_left_out(path: Path) -> None:
    write(path, instances=1, count=4, middle=data(0, 0, (9, 9), 9))
    (recording,) = UlogReader.read(path)
    np.testing.assert_array_equal(recording.streams[0].fields["current"], [0, 10, 20, 30])
    assert any("1 messages have no timestamp" in note for note in recording.notes)


def test_messages_out_of_order_are_sorted(path: Path) -> None:
    write(path, instances=1, count=4, middle=data(0, START + 100, (9, 9), 9))
    (recording,) = UlogReader.read(path)
    np.testing.assert_array_equal(recording.streams[0].fields["current"], [0, 9, 10, 20, 30])
    assert any("not in the order" in note for note in recording.notes)


def test_a_file_that_ends_early_is_read_up_to_there(path: Path) -> None:
    write(path, instances=1)
    path.write_bytes(path.read_bytes()[:-7])
    assert len(UlogReader.read(path)[0].streams[0].time) == 19


def test_damage_is_noted(path: Path) -> None:
    write(path, instances=1, middle=bytes(50))
    (recording,) = UlogReader.read(path)
    assert any("damaged in places" in note for note in recording.notes)


def test_files_without_data_are_refused(path: Path) -> None:
    path.write_bytes(file_header() + message("B", bytes(40)) + message("F", TOPIC.encode()))
    with pytest.raises(ImportLogError, match="no topic with messages"):
        UlogReader.read(path)


def test_files_that_are_no_ulog_are_refused(path: Path) -> None:
    write(path)
    cuts = ("cut at 0.5", "cut at 0.9")  # which leave a log that ends early
    damages = {name: damage for name, damage in ANY_FILE.items() if name not in cuts}
    refuses_every(damages, lambda: UlogReader.read(path), path, exit_code=1)
    survives_flips(lambda: UlogReader.read(path), path, exit_code=1)
