"""CSV files are read back with NumPy, and hold the arrays of the log to the last digit."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from log_builders import make_columns, put

from hqpipe.logs.export.csv_file import write_csv
from hqpipe.logs.log_set import read_log_set


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_numbers_are_equal_when_they_are_read_back(tmp_path, kind):
    columns = make_columns(samples=300)
    columns["supply/note, with comma"] = np.linspace(1e-12, 1e7, 300)
    put(tmp_path / "logs", "a.parquet", {n: v if n == "time" else v.astype(kind) for n, v in columns.items()})
    log_set = read_log_set(tmp_path / "logs", all_heldout=True)
    path = tmp_path / "a.csv"
    write_csv(path, log_set, log_set.trials[0])
    with path.open(encoding="utf-8", newline="") as stream:
        names = next(csv.reader(stream))
    read = np.loadtxt(path, delimiter=",", skiprows=1)
    assert names[0] == "time" and sorted(names) == sorted(columns)
    expected = log_set.trials[0].trajectory.columns()
    for name, values in zip(names, read.T, strict=True):
        np.testing.assert_array_equal(values, expected[name], err_msg=name)


def test_a_velocity_that_was_not_recorded_is_left_out(tmp_path):
    columns = {name: v for name, v in make_columns(samples=100).items() if not name.endswith("velocity")}
    put(tmp_path / "logs", "a.parquet", columns)
    log_set = read_log_set(tmp_path / "logs", all_heldout=True)
    write_csv(tmp_path / "a.csv", log_set, log_set.trials[0])
    assert "velocity" not in (tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()[0]
