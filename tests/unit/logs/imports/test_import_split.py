"""Which trials of an import are held out where no rule of the mapping says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from hqpipe.logs.imports.import_set import import_logs
from hqpipe.logs.imports.mapping import read_map
from hqpipe.logs.imports.recording import ImportLogError
from hqpipe.logs.imports.sources import find_sources
from hqpipe.logs.log_set import read_log_set

ROWS, RATE = 1000, 100.0  # Hz
JOINTS = {"hip": {"position": "q0", "effort": "u0"}, "knee": {"position": "q1", "effort": "u1"}}
ENCODER = 1e-4  # rad, of noise where a joint rests


def recording(folder: Path, name: str, *sizes: float, rows: int = ROWS) -> dict[str, np.ndarray]:
    """A file in which joints swing by these sizes, rad."""
    rng, time = np.random.default_rng([ord(letter) for letter in name]), np.arange(rows) / RATE
    columns = {"t": time}
    for j, size in enumerate(sizes):
        columns[f"q{j}"] = size * np.sin(2.0 * np.pi * (0.4 + 0.1 * j) * time) + ENCODER * rng.standard_normal(rows)
        columns[f"u{j}"] = np.cos(2.0 * np.pi * 0.4 * time)
    folder.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(columns), folder / f"{name}.parquet")
    return columns


def imported(folder: Path, **content):
    path = folder / "map.yaml"
    path.write_text(
        yaml.safe_dump({"format": "hqpipe-log-map/1", "clock": {"field": "t"}, "joints": JOINTS, **content})
    )
    return import_logs(find_sources([folder / "raw"]), read_map(path), path.read_text(), folder / "out")


def splits(folder: Path) -> dict[str, str]:
    return {trial.file: trial.split for trial in read_log_set(folder / "out").trials}


def test_the_last_recording_is_held_out_where_all_joints_move_in_it(tmp_path):
    for name in ("a", "b", "c"):
        recording(tmp_path / "raw", name, 0.5, 0.1)
    imported(tmp_path)
    assert splits(tmp_path) == {"a.parquet": "fit", "b.parquet": "fit", "c.parquet": "heldout"}


@pytest.mark.parametrize("last", [(0.0, 0.4), (0.02, 0.4)])
def test_of_recordings_of_one_joint_at_a_time_the_end_of_each_is_held_out(tmp_path, last):
    whole = {"a": recording(tmp_path / "raw", "a", 0.5, 0.0), "b": recording(tmp_path / "raw", "b", *last)}
    result = imported(tmp_path)
    assert splits(tmp_path) == {f"{n}_{p}.parquet": s for n in "ab" for p, s in (("first", "fit"), ("last", "heldout"))}
    assert sorted(path.name for path in (tmp_path / "out").glob("*.parquet")) == sorted(splits(tmp_path))
    assert [trial.file for trial in result.trials] == list(splits(tmp_path))
    for trial in read_log_set(tmp_path / "out").trials:
        q = whole[trial.file[0]]["q0"].astype(np.float32)
        expected = q[: trial.trajectory.samples] if trial.split == "fit" else q[-trial.trajectory.samples :]
        np.testing.assert_array_equal(trial.trajectory.position[:, 0], expected)
        assert trial.trajectory.samples == (700 if trial.split == "fit" else 250)  # half a second between them


def test_a_rule_of_the_mapping_is_kept(tmp_path):
    recording(tmp_path / "raw", "a", 0.5, 0.0)
    recording(tmp_path / "raw", "b", 0.0, 0.4)
    imported(tmp_path, trials=[{"files": "a*", "split": "heldout"}])
    assert splits(tmp_path) == {"a.parquet": "heldout", "b.parquet": "fit"}


def test_parts_get_names_that_no_recording_has(tmp_path):
    for name, sizes in (("run", (0.5, 0.0)), ("run_first", (0.5, 0.0)), ("stop", (0.0, 0.4))):
        recording(tmp_path / "raw", name, *sizes)
    imported(tmp_path)
    assert sorted(splits(tmp_path)) == sorted(
        f"{name}.parquet"
        for name in ("run_first_2", "run_last", "run_first_first", "run_first_last", "stop_first", "stop_last")
    )


def test_a_recording_too_short_to_be_cut_is_fitted_whole(tmp_path):
    recording(tmp_path / "raw", "a", 0.5, 0.0)
    recording(tmp_path / "raw", "b", 0.0, 0.4, rows=30)
    imported(tmp_path)
    assert splits(tmp_path) == {"a_first.parquet": "fit", "a_last.parquet": "heldout", "b.parquet": "fit"}


def test_a_lone_recording_too_short_to_be_cut_is_refused_by_its_own_name(tmp_path):
    recording(tmp_path / "raw", "a", 0.5, 0.1, rows=30)
    with pytest.raises(ImportLogError, match=r"a.parquet: 30 rows: the end of a lone .* 8 rows, expected at least 10"):
        imported(tmp_path)
    assert not (tmp_path / "out").exists()
