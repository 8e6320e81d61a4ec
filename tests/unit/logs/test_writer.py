"""Written log sets: same data, same bytes; small files; and what is written can be read."""

from __future__ import annotations

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from log_builders import JOINTS, make_columns, put

from hqpipe.errors import LogError
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.writer import LogSetWriter

META = {"robot": "two_joints", "base": "fixed", "control_mode": "position", "rate_hz": 1000.0}


def write(folder, order=1):
    with LogSetWriter(folder, **META, clock_source="controller tick", urdf_sha256="ab" * 32) as writer:
        for file, seed, split in (("a.parquet", 0, "fit"), ("b.parquet", 1, "heldout")):
            columns = dict(list(make_columns(seed=seed).items())[::order])
            columns = {k: columns[k] for k in sorted(columns, key=lambda k: k.split("/")[1:2])}
            writer.add(file, columns, split=split, command={"vx": 0.4})
    return folder


def rewrite(folder, trials, **meta):
    with LogSetWriter(folder, **meta) as writer:
        for trial in trials:
            columns = trial.trajectory.columns()
            writer.add(trial.file, columns, split=trial.split, command=trial.command, base=trial.base)


def test_same_data_same_bytes(tmp_path):
    first, second = write(tmp_path / "x"), write(tmp_path / "y", order=-1)
    for name in ("a.parquet", "b.parquet", "logset.yaml"):
        assert (first / name).read_bytes() == (second / name).read_bytes()


def test_what_is_written_is_read(tmp_path):
    log_set = read_log_set(write(tmp_path / "x"))
    assert log_set.warnings == ()
    assert (log_set.robot, log_set.rate_hz, log_set.joints) == ("two_joints", 1000.0, JOINTS)
    trial = log_set.heldout[0]
    assert trial.command == {"vx": 0.4}
    expected = make_columns(seed=1)
    np.testing.assert_array_equal(trial.trajectory.time, expected["time"])
    np.testing.assert_allclose(trial.trajectory.effort[:, 1], expected["joint/knee/effort"], rtol=1e-6)


def test_file_metadata_and_encoding(tmp_path):
    meta = pq.ParquetFile(write(tmp_path / "x") / "b.parquet")
    text = {k.decode(): v.decode() for k, v in meta.schema_arrow.metadata.items()}
    assert text["format"] == "hqpipe-log/1"
    assert text["joints"] == "hip,knee"
    assert text["split"] == "heldout"
    assert text["clock_source"] == "controller tick"
    assert text["urdf_sha256"] == "ab" * 32
    assert json.loads(text["units"])["joint/hip/effort"] == "N·m"
    for i, name in enumerate(meta.schema_arrow.names):
        column = meta.metadata.row_group(0).column(i)
        assert column.compression == "ZSTD"
        assert "BYTE_STREAM_SPLIT" in column.encodings and not column.has_dictionary_page
        assert column.physical_type == ("DOUBLE" if name == "time" else "FLOAT")


def test_a_read_log_set_can_be_written_again(tmp_path):
    original = read_log_set(write(tmp_path / "x"))
    rewrite(tmp_path / "y", original.trials, **META)
    again = read_log_set(tmp_path / "y")
    for a, b in zip(original.trials, again.trials, strict=True):
        assert (a.file, a.split, a.command) == (b.file, b.split, b.command)
        for name, values in a.trajectory.channels().items():
            np.testing.assert_array_equal(values, b.trajectory.channels()[name])


def test_a_differentiated_velocity_is_not_written_as_measured(tmp_path):
    for file, seed in (("a.parquet", 0), ("b.parquet", 1)):
        kept = {k: v for k, v in make_columns(seed=seed).items() if not k.endswith("velocity")}
        put(tmp_path / "x", file, kept)
    rewrite(tmp_path / "y", read_log_set(tmp_path / "x").trials)
    assert "joint/hip/velocity" not in pq.read_schema(tmp_path / "y" / "a.parquet").names


def test_a_trial_may_have_a_base_of_its_own(tmp_path):
    with LogSetWriter(tmp_path, base="floating") as writer:
        writer.add("walk.parquet", make_columns(seed=1))
        writer.add("gantry.parquet", make_columns(seed=2), base="fixed")
    assert {trial.file: trial.base for trial in read_log_set(tmp_path).trials} == {
        "walk.parquet": "floating",
        "gantry.parquet": "fixed",
    }
    manifest = tmp_path / "logset.yaml"
    manifest.write_text(manifest.read_text().replace("fixed", "fixd"))
    with pytest.raises(LogError, match=r"trials\[1\]\.base is 'fixd' – did you mean 'fixed'\?"):
        read_log_set(tmp_path)


def test_what_could_not_be_read_is_not_written(tmp_path):
    columns = make_columns()
    columns["joint/hip/effort"][5] = np.nan
    with pytest.raises(LogError, match="row 5"), LogSetWriter(tmp_path / "x") as writer:
        writer.add("a.parquet", columns)
    assert not (tmp_path / "x" / "logset.yaml").exists()
    assert not (tmp_path / "x" / "a.parquet").exists()


def test_an_existing_log_set_is_not_overwritten(tmp_path):
    write(tmp_path / "x")
    with pytest.raises(LogError, match="already holds a log set"):
        LogSetWriter(tmp_path / "x")
    with pytest.raises(LogError, match="at least one trial"), LogSetWriter(tmp_path / "z"):
        pass
