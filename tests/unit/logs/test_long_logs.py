"""Long log sets: sections are read, every row is checked, short ones are read as ever."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from log_builders import JOINTS, make_columns, put

from hqpipe.errors import LogError
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.long_logs import joined
from hqpipe.logs.parquet import ParquetReader
from hqpipe.logs.trajectory import recording_of

RATE = 100.0
MOST = 2 * 6000  # two joints, 60 s
YAML = """
format: hqpipe-log/1
control_mode: position
rate_hz: 100
base: fixed
trials:
  - {file: a.parquet, split: fit, command: {vx: 0.4}}
  - {file: b.parquet, split: heldout}
"""


@pytest.fixture
def long_logs(tmp_path):
    """200 s to fit and 100 s held out, in row groups that end within the sections."""
    folder = tmp_path / "logs"
    folder.mkdir()
    for seed, (file, samples) in enumerate({"a.parquet": 20_000, "b.parquet": 10_000}.items()):
        table = pa.table(make_columns(samples=samples, rate=RATE, seed=seed))
        pq.write_table(table, folder / file, row_group_size=1357)
    (folder / "logset.yaml").write_text(YAML)
    return folder


def spoil(folder, row, value, column=f"joint/{JOINTS[1]}/effort"):
    columns = make_columns(samples=20_000, rate=RATE)
    columns[column][row] = value
    put(folder, "a.parquet", columns)


def test_sections_hold_the_rows_of_the_file_at_their_time(long_logs):
    whole = {t.file: t.trajectory for t in read_log_set(long_logs).trials}
    log_set = read_log_set(long_logs, most=MOST)
    assert sum(t.trajectory.samples for t in log_set.trials) == pytest.approx(6000, rel=0.2)
    for trial in log_set.trials:
        t, full = trial.trajectory, whole[recording_of(trial)]
        first = round(t.start * RATE)
        rows = slice(first, first + t.samples)
        assert t.time[0] == 0.0
        np.testing.assert_allclose(t.start + t.time, full.time[rows], atol=1e-9)
        for name, values in t.channels().items():
            np.testing.assert_array_equal(values, getattr(full, name)[rows])
        assert t.whole == full.duration


def test_sections_keep_split_command_and_base_of_their_trial(long_logs):
    log_set = read_log_set(long_logs, most=MOST)
    for split, file, command in (("fit", "a.parquet", {"vx": 0.4}), ("heldout", "b.parquet", None)):
        mine = [t for t in log_set.trials if t.split == split]
        assert {recording_of(t) for t in mine} == {file} and len(mine) == 3
        assert all(t.command == command and t.base == "fixed" for t in mine)
    names = [t.file for t in log_set.trials]
    assert len(set(names)) == len(names) and names[0] == "a.parquet (0–10 s)"


def test_a_warning_says_what_share_was_used(long_logs):
    text = read_log_set(long_logs, most=MOST).warnings[0]
    assert "30 s of 200 s of fit trials (15%, 3 evenly spaced sections)" in text
    assert "30 s of 100 s of held-out trials (30%, 3 evenly spaced sections)" in text
    assert "every row was checked" in text


def test_short_logs_are_untouched(long_logs):
    plain, limited = read_log_set(long_logs), read_log_set(long_logs, most=2 * 30_000)
    assert limited.header() == plain.header()
    for a, b in zip(plain.trials, limited.trials, strict=True):
        assert (a.file, a.split, b.trajectory.excerpt) == (b.file, b.split, None)
        np.testing.assert_array_equal(a.trajectory.effort, b.trajectory.effort)


def test_header_is_that_of_the_whole_files(long_logs):
    plain, limited = read_log_set(long_logs), read_log_set(long_logs, most=MOST)
    assert limited.warnings[1:] == plain.warnings
    for name in ("sha256", "joints", "control_mode", "rate_hz", "robot", "base"):
        assert getattr(limited, name) == getattr(plain, name)


@pytest.mark.parametrize("row", [5, 4321, 19_999])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_every_row_is_checked_for_numbers_if_nothing_is_to_be_repaired(long_logs, row, value):
    spoil(long_logs, row, value)
    with pytest.raises(LogError) as whole:
        read_log_set(long_logs, strict=True)
    with pytest.raises(LogError) as sections:
        read_log_set(long_logs, strict=True, most=MOST)
    assert str(sections.value) == str(whole.value)
    assert f"row {row}" in str(whole.value)
    for trial in read_log_set(long_logs, most=MOST).trials:
        assert all(np.isfinite(values).all() for values in trial.trajectory.columns().values())


def test_every_row_is_checked_for_its_time(long_logs):
    spoil(long_logs, 7777, 12.0, "time")
    with pytest.raises(LogError, match="row 7777.*runs backwards"):
        read_log_set(long_logs, most=MOST)


def test_wrong_columns_are_refused_before_the_rows_are_read(long_logs, monkeypatch):
    columns = make_columns(samples=20_000, rate=RATE)
    columns["joint/hip/efort"] = columns.pop("joint/hip/effort")
    put(long_logs, "a.parquet", columns)
    monkeypatch.setattr(ParquetReader, "read_rows", lambda *_, **__: pytest.fail("rows were read"))
    with pytest.raises(LogError, match="did you mean 'joint/hip/effort'"):
        read_log_set(long_logs, most=MOST)


def test_no_file_is_read_whole(long_logs, monkeypatch):
    monkeypatch.setattr(ParquetReader, "read", lambda *_: pytest.fail("the file was read whole"))
    assert read_log_set(long_logs, most=MOST).trials


def test_a_lone_trial_is_split_before_it_is_cut(tmp_path):
    folder = tmp_path / "one"
    put(folder, "a.parquet", make_columns(samples=40_000, rate=RATE))
    plain, limited = read_log_set(folder), read_log_set(folder, most=MOST)
    for whole, split in zip(plain.trials, ("fit", "heldout"), strict=True):
        mine = [t for t in limited.trials if t.split == split]
        assert {t.trajectory.whole for t in mine} == {whole.trajectory.duration}
        first, last = mine[0].trajectory, mine[-1].trajectory
        np.testing.assert_array_equal(first.effort, whole.trajectory.effort[: first.samples])
        np.testing.assert_array_equal(last.effort, whole.trajectory.effort[-last.samples :])
    assert len({t.file for t in limited.trials}) == len(limited.trials)
    assert "held out: a.parquet (100.0 s)" in limited.warnings[1]


def test_trials_without_a_section_are_read_all_the_same(tmp_path):
    folder = tmp_path / "many"
    for seed in range(12):
        put(folder, f"{seed:02d}.parquet", make_columns(samples=500, rate=RATE, seed=seed))
    assert len(read_log_set(folder, most=2 * 2000).trials) < 12
    columns = make_columns(samples=500, rate=RATE, seed=1)
    columns["joint/hip/effort"][7] = np.nan
    put(folder, "01.parquet", columns)
    with pytest.raises(LogError, match=r"01\.parquet.*row 7"):
        read_log_set(folder, strict=True, most=2 * 2000)


def test_checks_without_order_see_recorded_trials(long_logs):
    sections = read_log_set(long_logs, most=MOST).trials
    found = joined(sections)
    assert [t.file for t in found] == ["a.parquet", "b.parquet"]
    for trial in found:
        t = trial.trajectory
        assert len(t.effort) == t.samples
        np.testing.assert_allclose(np.diff(t.time), 1.0 / RATE, atol=1e-9)


def test_differentiation_does_not_reach_across_sections(long_logs):
    for file in ("a.parquet", "b.parquet"):
        columns = pq.read_table(long_logs / file)
        pq.write_table(columns.drop_columns([f"joint/{joint}/velocity" for joint in JOINTS]), long_logs / file)
    whole = {t.file: t.trajectory for t in read_log_set(long_logs).trials}
    for trial in read_log_set(long_logs, most=MOST).trials:
        first = round(trial.trajectory.start * RATE)
        full = whole[recording_of(trial)].velocity[first : first + trial.trajectory.samples]
        assert np.abs(trial.trajectory.velocity - full).max() < 0.05 * np.abs(full).max()


def test_sections_that_hold_nothing_but_gaps_are_refused_in_words(tmp_path):
    folder = tmp_path / "gaps"
    for seed, file in enumerate(("a.parquet", "b.parquet")):
        columns = make_columns(samples=20_000, rate=RATE, seed=seed)
        columns["joint/hip/position"][::3] = np.nan
        columns["joint/hip/effort"][1::3] = np.nan
        columns["joint/hip/position_command"][2::3] = np.nan
        put(folder, file, columns)
    for options in ({}, {"most": MOST}):
        with pytest.raises(LogError, match="no stretch of ten samples without a gap") as info:
            read_log_set(folder, **options)
        assert info.value.file and info.value.fix
