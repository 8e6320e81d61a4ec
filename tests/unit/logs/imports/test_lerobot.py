"""Data sets in the layout of LeRobot."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from damage import ANY_FILE, JSON_FILE, refuses_every, survives_flips

from hqpipe.errors import HqpipeError
from hqpipe.logs.imports.lerobot import LerobotReader
from hqpipe.logs.imports.recording import ImportLogError

MOTORS = ["shoulder_pan.pos", "gripper.pos"]
RATE = 30
LENGTHS = (40, 25, 30)  # frames of the episodes


def features(names: object = MOTORS) -> dict:
    scalars = {"timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "next.done": "bool"}
    return {
        "observation.state": {"dtype": "float32", "shape": [2], "names": names},
        "action": {"dtype": "float32", "shape": [2], "names": names},
        "observation.images.top": {"dtype": "video", "shape": [480, 640, 3], "names": ["height", "width", "channels"]},
        "task": {"dtype": "string", "shape": [1], "names": None},
    } | {name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in scalars.items()}


def table(episode: int, jitter: float = 0.0) -> pa.Table:
    rng = np.random.default_rng(episode)
    count = LENGTHS[episode]
    time = np.arange(count) / RATE + jitter * rng.uniform(size=count)
    lists = {
        name: [row.astype(np.float32) for row in rng.normal(size=(count, 2))]
        for name in ("observation.state", "action")
    }
    return pa.table(
        {
            **lists,
            "timestamp": time.astype(np.float32),
            "frame_index": np.arange(count),
            "episode_index": np.full(count, episode),
            "next.done": np.arange(count) == count - 1,
            "task": ["pick"] * count,
        }
    )


def write(folder: Path, version: int = 3, names: object = MOTORS, jitter: float = 0.0) -> list[pa.Table]:
    """A data set of three episodes: in two files, the second episode cut between them, or in one each (version 2)."""
    (folder / "meta").mkdir(parents=True)
    (folder / "data" / "chunk-000").mkdir(parents=True)
    info = {"codebase_version": f"v{version}.0", "fps": RATE, "features": features(names)}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    episodes = [table(index, jitter) for index in range(3)]
    if version == 3:
        whole = pa.concat_tables(episodes)
        parts = {"file-000": whole.slice(0, 50), "file-001": whole.slice(50)}
    else:
        parts = {f"episode_{index:06d}": part for index, part in enumerate(episodes)}
    for name, part in parts.items():
        pq.write_table(part, folder / "data" / "chunk-000" / f"{name}.parquet")
    return episodes


def column(part: pa.Table, name: str) -> np.ndarray:
    return np.asarray(part[name].to_pylist(), np.float64)


@pytest.mark.parametrize("version", [2, 3])
def test_one_recording_per_episode(tmp_path: Path, version: int) -> None:
    written = write(tmp_path / "set", version)
    recordings = LerobotReader.read(tmp_path / "set")
    assert [each.name for each in recordings] == ["episode_000000", "episode_000001", "episode_000002"]
    for recording, part in zip(recordings, written, strict=True):
        (stream,) = recording.streams
        for index, motor in enumerate(MOTORS):
            for name in ("observation.state", "action"):
                np.testing.assert_array_equal(stream.fields[f"{name}/{motor}"], column(part, name)[:, index])
        np.testing.assert_array_equal(stream.fields["next.done"], column(part, "next.done"))
        np.testing.assert_array_equal(stream.time, column(part, "timestamp"))
        assert stream.time_name == "timestamp"


def test_notes(tmp_path: Path) -> None:
    write(tmp_path / "set")
    notes = LerobotReader.read(tmp_path / "set")[0].notes
    assert any("left out observation.images.top, task" in note for note in notes)
    assert any("nominal, not measured" in note for note in notes)


def test_measured_timestamps_are_not_called_nominal(tmp_path: Path) -> None:
    write(tmp_path / "set", jitter=0.01)
    assert not any("nominal" in note for note in LerobotReader.read(tmp_path / "set")[0].notes)


@pytest.mark.parametrize(
    ("names", "expected"),
    [({"motors": MOTORS}, f"/{MOTORS[1]}"), (None, "[1]"), (["state"], "[1]"), (["a", "a"], "[1]")],
)
def test_names_of_components(tmp_path: Path, names: object, expected: str) -> None:
    write(tmp_path / "set", names=names)
    assert f"action{expected}" in LerobotReader.read(tmp_path / "set")[0].streams[0].fields


def test_its_folder_is_claimed(tmp_path: Path) -> None:
    write(tmp_path / "set")
    assert LerobotReader.claims_folder(tmp_path / "set")
    assert not LerobotReader.claims_folder(tmp_path)


def test_damaged_info_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "set")
    info = tmp_path / "set" / "meta" / "info.json"
    refuses_every(ANY_FILE | JSON_FILE, lambda: LerobotReader.read(tmp_path / "set"), info, exit_code=1)


def test_damaged_data_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "set")
    file = tmp_path / "set" / "data" / "chunk-000" / "file-001.parquet"
    damages = {name: damage for name, damage in ANY_FILE.items() if name != "missing"}
    refuses_every(damages, lambda: LerobotReader.read(tmp_path / "set"), file, exit_code=1)
    survives_flips(lambda: LerobotReader.read(tmp_path / "set"), file, exit_code=1)


def test_data_that_contradicts_info_is_refused(tmp_path: Path) -> None:
    for names in ("timestamp", "episode_index"):
        folder = tmp_path / names
        write(folder)
        for file in (folder / "data").rglob("*.parquet"):
            pq.write_table(pq.read_table(file).drop_columns([names]), file)
        with pytest.raises(HqpipeError, match=names):
            LerobotReader.read(folder)
    write(tmp_path / "long")
    info = json.loads((tmp_path / "long" / "meta" / "info.json").read_text())
    info["features"]["action"]["shape"] = [3]
    (tmp_path / "long" / "meta" / "info.json").write_text(json.dumps(info))
    with pytest.raises(ImportLogError, match="another length than 3"):
        LerobotReader.read(tmp_path / "long")
