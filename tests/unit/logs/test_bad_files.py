"""What is no sound Parquet file, samples without physical sense, and files that ask for all of the memory."""

from __future__ import annotations

import os

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from log_builders import make_columns, put

from hqpipe.errors import LogError
from hqpipe.logs import size
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.parquet import ParquetReader
from hqpipe.logs.writer import LogSetWriter


def refusal(logs, **options):
    with pytest.raises(LogError) as info:
        read_log_set(logs, **options)
    error = info.value
    assert error.file == str(logs / "a.parquet") and error.fix
    assert len(str(error)) < 600 + 2 * len(str(logs))
    return error


def folder(path):
    path.mkdir()


def fifo(path):
    os.mkfifo(path)


def broken_link(path):
    path.symlink_to("nowhere")


def loop(path):
    path.symlink_to(path.name)


def encrypted(path):
    path.write_bytes(b"PARE" + bytes(200) + b"PARE")


def garbage(path):
    path.write_bytes(np.random.default_rng(0).bytes(5000))


def wrong_footer(path):
    path.write_bytes(b"PAR1" + bytes(500) + (400).to_bytes(4, "little") + b"PAR1")


def huge_footer(path):
    path.write_bytes(b"PAR1" + bytes(500) + (2**31 - 1).to_bytes(4, "little") + b"PAR1")


@pytest.mark.parametrize("make", [folder, fifo, broken_link, loop, encrypted, garbage, wrong_footer, huge_footer])
@pytest.mark.parametrize("options", [{}, {"most": 100}])
def test_what_is_no_parquet_file(logs, make, options):
    (logs / "a.parquet").unlink()
    make(logs / "a.parquet")
    refusal(logs, **options)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads every file")
def test_a_file_without_the_right_to_read_it(logs):
    (logs / "a.parquet").chmod(0)
    assert "Permission denied" in str(refusal(logs))


def test_cut_at_every_length(logs):
    whole = (logs / "a.parquet").read_bytes()
    for length in np.linspace(0, len(whole) - 1, 60).astype(int):
        (logs / "a.parquet").write_bytes(whole[:length])
        refusal(logs)


@pytest.mark.parametrize("checksums", [True, False])
def test_flipped_bytes_give_an_error_or_numbers(logs, checksums):
    """Whatever byte is hit: no other exception. A page that has a checksum is never taken for whole."""
    rng = np.random.default_rng(1)
    table = pa.table(make_columns(samples=300))
    pq.write_table(table, logs / "a.parquet", write_page_checksum=checksums, compression="zstd")
    whole = (logs / "a.parquet").read_bytes()
    footer = len(whole) - 8 - int.from_bytes(whole[-8:-4], "little")
    for place in rng.integers(4, len(whole), 300):
        (logs / "a.parquet").write_bytes(
            whole[:place] + bytes([whole[place] ^ (1 << rng.integers(8))]) + whole[place + 1 :]
        )
        try:
            found = ParquetReader.read(logs / "a.parquet")
        except LogError as error:
            assert error.file and error.fix
        else:
            if checksums and place < footer:
                for name, values in found.columns.items():
                    np.testing.assert_array_equal(values, table.column(name).to_numpy())


def test_a_flipped_byte_of_a_written_log_set_is_named(tmp_path):
    with LogSetWriter(tmp_path / "x") as writer:
        path = writer.add("a.parquet", make_columns())
        writer.add("b.parquet", make_columns(seed=1), split="heldout")
    column = pq.ParquetFile(path).metadata.row_group(0).column(2)
    middle = column.data_page_offset + column.total_compressed_size // 2
    whole = path.read_bytes()
    path.write_bytes(whole[:middle] + bytes([whole[middle] ^ 16]) + whole[middle + 1 :])
    error = refusal(tmp_path / "x")
    assert error.field == column.path_in_schema and "does not match its checksum" in str(error)


def as_type(kind):
    return lambda values: pa.array(values).cast(kind, safe=False)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda v: pa.array([str(x) for x in v]), "holds string"),
        (lambda v: pa.array([[x] for x in v]), "holds list<element: double>"),
        (lambda v: pa.array([{"x": x} for x in v]), "holds struct"),
        (lambda v: pa.array([str(round(x)) for x in v]).dictionary_encode(), "holds dictionary"),
        (lambda v: pa.array(np.arange(len(v)), pa.timestamp("ns")), "holds timestamp[ns]"),
        (lambda v: pa.array(np.arange(len(v)), pa.duration("ns")), "holds duration[ns]"),
        (lambda v: pa.array(np.arange(len(v))).cast(pa.decimal128(25, 2)), "holds decimal128"),
        (lambda v: pa.nulls(len(v)), "holds null"),
    ],
)
@pytest.mark.parametrize("options", [{}, {"most": 100}])
def test_columns_of_other_types(logs, columns, make, words, options):
    put(logs, "a.parquet", columns | {"joint/hip/effort": make(columns["joint/hip/effort"])})
    error = refusal(logs, **options)
    assert error.field == "joint/hip/effort" and words in str(error)


@pytest.mark.parametrize("kind", [pa.int8(), pa.int64(), pa.uint32(), pa.float16(), pa.float32(), pa.bool_()])
def test_numbers_of_every_kind_are_read(logs, columns, kind):
    put(
        logs,
        "a.parquet",
        columns | {"joint/hip/effort": as_type(kind)(np.abs(np.round(columns["joint/hip/effort"] / 9)))},
    )
    for options in ({}, {"most": 1000}):
        assert read_log_set(logs, **options).trials[0].trajectory.effort.dtype == np.float64


@pytest.mark.parametrize("value", [-1e300, 1e300, 1e30, np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", ["time", "joint/hip/effort", "joint/knee/position", "battery/voltage"])
def test_samples_without_physical_sense(logs, columns, column, value):
    columns["battery/voltage"] = np.full(2000, 24.0)
    columns[column][[700, 900, 901]] = value
    put(logs, "a.parquet", columns)
    for options in ({"strict": True}, {"strict": True, "most": 1000}):
        error = refusal(logs, **options)
        assert error.field == column and "row 700: " in str(error) and "(3 such rows)" in str(error)
    for options in ({}, {"most": 1000}):
        if column == "time":
            assert refusal(logs, **options).field == column
        else:
            assert all(
                np.isfinite(v).all()
                for t in read_log_set(logs, **options).trials
                for v in t.trajectory.columns().values()
            )


@pytest.mark.parametrize(
    "change",
    [
        lambda v: v * 57.3 * 16384,  # counts of an encoder behind a gear
        lambda v: np.where(np.arange(len(v)) == 5, 5e-324, v),
        lambda v: np.where(np.arange(len(v)) == 5, -0.0, v),
        lambda v: np.full(len(v), 7.0),
        lambda v: np.full(len(v), 4294967295.0),
    ],
)
def test_numbers_that_may_be_are_read(logs, columns, change):
    for file, seed in (("a.parquet", 0), ("b.parquet", 1)):
        columns = make_columns(seed=seed)
        columns["time"] += seed  # else the constant ones would be one file twice
        put(logs, file, columns | {name: change(v) for name, v in columns.items() if name.startswith("joint")})
    assert read_log_set(logs).trials


@pytest.mark.parametrize("dtype", [np.int64, np.uint64, np.float64])
def test_a_clock_in_nanoseconds_since_1970(logs, columns, dtype):
    steps = np.arange(2000, dtype=np.int64) * 1_000_000
    put(logs, "a.parquet", columns | {"time": (steps + 1_700_000_000_000_000_001).astype(dtype)})
    put(logs, "b.parquet", make_columns(seed=1) | {"time": steps})
    for options in ({}, {"most": 1000}):
        log_set = read_log_set(logs, **options)
        exact = 0.0 if dtype != np.float64 else 512.0
        np.testing.assert_allclose(np.diff(log_set.trials[0].trajectory.time), 1e6, atol=exact)
        assert any("looks like ns" in text for text in log_set.warnings)


@pytest.mark.parametrize("step", [5e-324, 1e-300, 1e14])
def test_steps_that_no_unit_of_time_explains(logs, columns, step):
    put(logs, "a.parquet", columns | {"time": np.arange(2000) * step})
    assert "expected seconds between samples" in str(refusal(logs))


def test_a_lone_trial_whose_clock_is_broken(tmp_path, columns):
    for value in (np.nan, 0.0):
        put(tmp_path / "one", "a.parquet", columns | {"time": np.full(2000, value)})
        refusal(tmp_path / "one", most=100)


@pytest.mark.parametrize("rows", [0, 1, 9])
def test_too_few_rows(logs, columns, rows):
    put(logs, "a.parquet", {name: values[:rows] for name, values in columns.items()})
    for options in ({}, {"most": 5}):
        assert f"{rows} rows, expected at least 10" in str(refusal(logs, **options))


@pytest.mark.parametrize("options", [{}, {"most": 1000}])
def test_a_small_file_that_asks_for_all_of_the_memory(logs, monkeypatch, options):
    zeros = pa.array(np.zeros(3_000_000))
    names = ["time", *(f"joint/{i}/position" for i in range(3))]
    pq.write_table(pa.table(dict.fromkeys(names, zeros)), logs / "a.parquet")
    assert (logs / "a.parquet").stat().st_size < 200_000
    monkeypatch.setattr(size, "memory_bytes", lambda: 60_000_000)
    monkeypatch.setattr(ParquetReader, "read_columns", lambda *_: pytest.fail("it was decoded"))
    error = refusal(logs, **options)
    assert "3000000 rows of 4 columns" in str(error) and "GiB" in str(error)


def test_the_memory_of_this_machine_is_known():
    assert 2**28 < size.memory_bytes() < 2**50


def test_a_column_with_a_dot_beside_one_without(logs, columns):
    """Parquet names nested fields with dots."""
    put(logs, "a.parquet", columns | {"time.sensor": np.ones(2000), "servo": np.zeros(2000), "servo.x": np.ones(2000)})
    trial = read_log_set(logs).trials[0].trajectory
    assert trial.duration == pytest.approx(1.999) and trial.extra["servo"].max() == 0.0
