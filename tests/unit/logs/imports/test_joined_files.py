"""Logs without a clock, and trials that lie in several files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from hqpipe.logs.imports.import_set import import_logs
from hqpipe.logs.imports.mapping import read_map
from hqpipe.logs.imports.recording import ImportLogError
from hqpipe.logs.imports.sources import find_sources
from hqpipe.logs.log_set import read_log_set

RATE = 50.0  # Hz
JOINTS = {"hip": {"position": "q", "effort": "tau"}}


def run(folder: Path, *sources: Path, **content):
    path = folder / "map.yaml"
    path.write_text(yaml.safe_dump({"format": "hqpipe-log-map/1", "joints": JOINTS, **content}, sort_keys=False))
    return import_logs(find_sources(sources), read_map(path), path.read_text(), folder / "out")


def signals(seed: int = 0, samples: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    time = np.arange(samples) / RATE
    return time, np.sin(2 * np.pi * time + seed), np.cos(2 * np.pi * time + seed)


def column(path: Path, values: np.ndarray, header: str = "") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*([header] if header else []), *(repr(float(v)) for v in values)]) + "\n")


def table(path: Path, **columns: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(repr(float(v)) for v in row) for row in rows)]) + "\n")


def imported(folder: Path):
    return read_log_set(folder / "out")


def test_a_rate_stands_for_the_clock_that_was_not_recorded(tmp_path):
    for seed in range(2):
        _, q, tau = signals(seed)
        table(tmp_path / "raw" / f"{seed}.csv", q=q, tau=tau)
    run(tmp_path, tmp_path / "raw", clock={"rate_hz": RATE})
    first = imported(tmp_path).trials[0].trajectory
    np.testing.assert_allclose(first.time, signals()[0], atol=1e-12)
    np.testing.assert_allclose(first.position[:, 0], signals()[1], atol=1e-6)


def test_no_clock_and_no_rate_says_what_to_write(tmp_path):
    table(tmp_path / "a.csv", q=signals()[1], tau=signals()[2])
    with pytest.raises(ImportLogError, match=r"no clock is named"):
        run(tmp_path, tmp_path / "a.csv")
    (tmp_path / "map.yaml").unlink()
    with pytest.raises(ImportLogError, match=r"rate_hz.*belongs to unit: samples"):
        run(tmp_path, tmp_path / "a.csv", clock={"field": "q", "rate_hz": 50})


@pytest.mark.parametrize("pattern", ["{trial}/{part}.csv", "{trial}_{part}.csv", "{part}/{trial}.csv"])
def test_one_file_per_channel_makes_one_trial(tmp_path, pattern):
    for seed in range(2):
        for part, values in zip(("t", "q", "tau"), signals(seed), strict=True):
            column(tmp_path / "raw" / pattern.format(trial=f"run{seed}", part=part), values)
    result = run(tmp_path, tmp_path / "raw", join=pattern, clock={"field": "t"})
    assert [trial.file for trial in result.trials] == ["run0.parquet", "run1.parquet"]
    for seed, trial in enumerate(imported(tmp_path).trials):
        _, q, tau = signals(seed)
        np.testing.assert_array_equal(trial.trajectory.position[:, 0], q.astype(np.float32))
        np.testing.assert_array_equal(trial.trajectory.effort[:, 0], tau.astype(np.float32))
    assert any("row by row with 't'" in note for note in result.notes())


def test_a_folder_without_trials_in_its_names_is_one_trial(tmp_path):
    for part, values in zip(("q", "tau"), signals()[1:], strict=True):
        column(tmp_path / "swing" / f"{part}.txt", values)
    result = run(tmp_path, tmp_path / "swing", join="{part}.txt", clock={"rate_hz": RATE})
    assert [trial.file for trial in result.trials] == ["swing_first.parquet", "swing_last.parquet"]


def test_inputs_may_end_a_row_before_the_states(tmp_path):
    for seed in range(2):
        time, q, tau = signals(seed)
        table(tmp_path / "raw" / f"{seed}" / "state.csv", t=time, q=q)
        table(tmp_path / "raw" / f"{seed}" / "input.csv", tau=tau[:-1])
    _, q, tau = signals()
    run(tmp_path, tmp_path / "raw", join="{trial}/{part}.csv", clock={"field": "t"})
    first = imported(tmp_path).trials[0].trajectory
    np.testing.assert_array_equal(first.effort[:, 0], tau[:-1].astype(np.float32))
    np.testing.assert_array_equal(first.position[:, 0], q[:-1].astype(np.float32))


def test_other_lengths_are_refused_with_both_counts(tmp_path):
    time, q, tau = signals()
    column(tmp_path / "raw" / "t.csv", time)
    column(tmp_path / "raw" / "q.csv", q)
    column(tmp_path / "raw" / "tau.csv", tau[:-7])
    with pytest.raises(ImportLogError, match=r"'tau' has 393 rows and no clock, 't' has 400"):
        run(tmp_path, tmp_path / "raw", join="{part}.csv", clock={"field": "t"})


def test_commands_in_a_table_with_a_clock_of_its_own_are_held(tmp_path):
    every = slice(None, None, 5)
    for seed in (1, 0):
        time, q, tau = signals(seed)
        table(tmp_path / "raw" / f"{seed}_measured.csv", t=time, q=q, tau=tau)
        table(tmp_path / "raw" / f"{seed}_wanted.csv", t=time[every], goal=q[every])
    joints = {"hip": {"position": "measured/q", "effort": "measured/tau", "position_command": "wanted/goal"}}
    run(tmp_path, tmp_path / "raw", join="{trial}_{part}.csv", clock={"field": "t"}, joints=joints)
    command = imported(tmp_path).trials[0].trajectory.position_command[:, 0]
    np.testing.assert_allclose(command, np.repeat(q[every], 5)[: len(command)], atol=1e-6)


def test_the_folder_of_a_trial_may_be_named(tmp_path):
    for seed in range(2):
        table(tmp_path / "raw" / f"m_{seed}" / "a.csv", t=signals()[0], q=signals(seed)[1])
        table(tmp_path / "raw" / f"m_{seed}" / "b.csv", t=signals()[0], tau=signals(seed)[2])
    (tmp_path / "raw" / "notes.csv").write_text("x\n1\n2\n")
    rules = [{"files": "m_0", "split": "heldout"}]
    sources = [tmp_path / "raw" / "m_0", tmp_path / "raw" / "m_1", tmp_path / "raw" / "notes.csv"]
    result = run(tmp_path, *sources, join="m_{trial}/{part}.csv", clock={"field": "t"}, trials=rules)
    assert [(t.file, t.split) for t in result.trials] == [("m_0.parquet", "heldout"), ("m_1.parquet", "fit")]
    assert result.skipped == {"not named as join in the mapping says": ["notes.csv"]}


def test_a_pattern_that_no_file_fits_names_some(tmp_path):
    table(tmp_path / "raw" / "a.csv", t=signals()[0], q=signals()[1], tau=signals()[2])
    with pytest.raises(ImportLogError, match=r"no file fits join: \{trial\}-\{part\}\.csv \(found: .*a\.csv\)"):
        run(tmp_path, tmp_path / "raw", join="{trial}-{part}.csv", clock={"field": "t"})


@pytest.mark.parametrize(
    "pattern", ["{trial}.csv", "{part}{part}.csv", "{run}_{part}.csv", "/x/{part}.csv", "../{part}.csv"]
)
def test_a_bad_pattern_says_what_is_expected(tmp_path, pattern):
    with pytest.raises(ImportLogError, match=r"join: expected file names with \{part\} once"):
        run(tmp_path, tmp_path, join=pattern)


def test_two_files_for_one_part_are_refused(tmp_path):
    for name in ("q.csv", "q.txt"):
        column(tmp_path / "raw" / name, signals()[1])
    with pytest.raises(ImportLogError, match=r"q\.txt: join: .* takes it and q\.csv for the same part 'q' of raw"):
        run(tmp_path, tmp_path / "raw", join="{part}.*", clock={"rate_hz": RATE})
