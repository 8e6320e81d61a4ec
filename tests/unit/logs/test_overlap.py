"""What is held out is not in the data of the fit, however it is called and saved; honest logs are not refused."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from log_builders import make_columns, put

from hqpipe.errors import LogError
from hqpipe.logs.log_set import read_log_set

REAL = Path(__file__).parents[4] / "shared" / "data"


def listed(folder, **splits):
    """Write logset.yaml; `splits` are file → split, with __ for a slash and without a suffix."""
    lines = [f"  - {{file: {name}, split: {split}}}" for name, split in splits.items()]
    (folder / "logset.yaml").write_text("format: hqpipe-log/1\ntrials:\n" + "\n".join(lines) + "\n")


def refusal(folder, **options):
    with pytest.raises(LogError) as info:
        read_log_set(folder, **options)
    error = info.value
    assert error.file and error.fix and str(folder) in error.file
    return str(error)


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "logs"
    put(folder, "a.parquet", make_columns())
    put(folder, "c.parquet", make_columns(seed=3))
    return folder


@pytest.mark.parametrize("split", ["heldout", "fit"])
@pytest.mark.parametrize("how", ["dot", "subfolder", "hard link", "symbolic link", "linked folder"])
def test_one_file_under_two_names(folder, how, split):
    name = "b.parquet"
    if how == "dot":
        name = "./a.parquet"
    elif how == "subfolder":
        (folder / "sub").mkdir()
        os.link(folder / "a.parquet", folder / "sub" / "a.parquet")
        name = "sub//a.parquet"
    elif how == "hard link":
        os.link(folder / "a.parquet", folder / name)
    elif how == "symbolic link":
        (folder / name).symlink_to("a.parquet")
    else:
        (folder / "here").symlink_to(".")
        name = "here/a.parquet"
    listed(folder, **{"a.parquet": "fit", name: split, "c.parquet": "heldout"})
    assert "is the same file as 'a.parquet'" in refusal(folder)


def test_a_link_without_logset_yaml(folder):
    (folder / "latest.parquet").symlink_to("a.parquet")
    assert "'latest.parquet' is the same file as 'a.parquet'" in refusal(folder)


def test_equal_bytes_in_both_splits(folder):
    still = {name: np.zeros(2000) if "/" in name else values for name, values in make_columns().items()}
    put(folder, "a.parquet", still)
    put(folder, "b.parquet", still)
    listed(folder, **{"a.parquet": "fit", "b.parquet": "heldout"})
    assert "b.parquet: has the same bytes as a.parquet" in refusal(folder)


def test_equal_bytes_in_one_split_are_a_warning(folder):
    put(folder, "b.parquet", make_columns())
    listed(folder, **{"a.parquet": "fit", "b.parquet": "fit", "c.parquet": "heldout"})
    assert any("b.parquet has the same bytes as a.parquet" in text for text in read_log_set(folder).warnings)


def single(columns):
    return {name: values if name == "time" else values.astype(np.float32) for name, values in columns.items()}


def later(columns):
    return columns | {"time": columns["time"] + 17.0}


def reordered(columns):
    return dict(reversed(columns.items()))


def other_commands(columns):
    return columns | {name: values + 0.1 for name, values in columns.items() if name.endswith("_command")}


def trimmed(columns):
    return {name: values[37:-41] for name, values in columns.items()}


def appended(columns):
    more = make_columns(seed=9)
    both = {name: np.concatenate([more[name][:777], values, more[name][777:]]) for name, values in columns.items()}
    return both | {"time": np.arange(len(both["time"])) / 1000.0}


def without_velocity_units(columns):
    return columns | {name: values * 57.3 for name, values in columns.items() if name.endswith("velocity")}


def one_joint_changed(columns):
    return columns | {"joint/hip/effort": columns["joint/hip/effort"] * 1.01}


CHANGES = [single, later, reordered, other_commands, trimmed, appended, without_velocity_units, one_joint_changed]


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("options", [{}, {"most": 3000}, {"strict": True}])
def test_a_copy_saved_in_another_way(folder, change, options):
    pq.write_table(pa.table(change(make_columns())), folder / "b.parquet", compression="gzip", row_group_size=321)
    listed(folder, **{"a.parquet": "fit", "c.parquet": "fit", "b.parquet": "heldout"})
    words = refusal(folder, **options)
    assert "b.parquet: rows" in words and "repeat a.parquet, bit for bit in joint/" in words


def test_the_rows_that_are_shared_are_named(folder):
    more, columns = make_columns(seed=9, samples=4000), make_columns()
    for name in columns:
        if name != "time":
            more[name][1000:2500] = columns[name][300:1800]
    put(folder, "b.parquet", more)
    listed(folder, **{"a.parquet": "fit", "b.parquet": "heldout"})
    words = refusal(folder)
    first, last = (int(n) for n in words.split("rows ")[1].split(" repeat")[0].split(" to "))
    assert 1000 <= first < 1064 and 2436 < last < 2500


def test_less_than_a_second_is_no_evidence(folder):
    more, columns = make_columns(seed=9), make_columns()
    for name in columns:
        if name != "time":
            more[name][1000:1600] = columns[name][300:900]
    put(folder, "b.parquet", more)
    listed(folder, **{"a.parquet": "fit", "b.parquet": "heldout"})
    assert not any("repeat" in text for text in read_log_set(folder).warnings)


def test_the_same_motion_under_another_load_is_a_warning(folder):
    columns, other = make_columns(), make_columns(seed=5)
    columns |= {name: other[name] for name in columns if name.endswith("effort")}
    put(folder, "b.parquet", columns)
    listed(folder, **{"a.parquet": "fit", "b.parquet": "heldout"})
    (warning,) = [text for text in read_log_set(folder).warnings if "repeat" in text]
    assert warning.startswith("b.parquet: rows 0 to 1999 repeat a.parquet, bit for bit in joint/hip/position")
    assert "what else was measured differs" in warning


def test_coarse_signals_are_named_but_not_refused(folder):
    """One joint, counts of an encoder and nothing else: a copy cannot be told from a machine that repeats well."""
    time = np.arange(4000) / 200.0
    columns = {"time": time, "joint/hip/position": np.round(300 * np.sin(3.0 * time)) * 2e-3}
    for file, rows in (("a.parquet", slice(0, 4000)), ("b.parquet", slice(55, 3900))):
        put(folder, file, {name: values[rows] for name, values in columns.items()})
    listed(folder, **{"a.parquet": "fit", "b.parquet": "heldout"})
    assert any("repeat a.parquet" in text and "a copy does" in text for text in read_log_set(folder).warnings)


@pytest.mark.parametrize("counts", [None, 4096, 400])
@pytest.mark.parametrize("rate", [1000.0, 190.0, 25.0])
def test_repeats_of_one_motion_are_not_accused(tmp_path, rate, counts):
    """The same command again and again, a coarse encoder, long times at rest, a dead sensor."""
    folder = tmp_path / "logs"
    rng = np.random.default_rng(0)
    time = np.arange(int(60 * rate)) / rate
    command = 0.4 * np.clip(np.sin(2 * np.pi * 0.3 * time), -0.5, 0.7)
    for file in ("a.parquet", "b.parquet", "c.parquet"):
        position = 0.9 * command + 2e-4 * rng.normal(size=len(time))
        effort = 300.0 * (command - position) + rng.normal(size=len(time))
        if counts:
            position = np.round(position * counts / 6.283) * 6.283 / counts
            effort = np.round(effort / 4.0) * 4.0
        columns = {"time": time}
        for joint in ("hip", "knee"):
            columns[f"joint/{joint}/position"] = position if joint == "hip" else np.full(len(time), 0.5)
            columns[f"joint/{joint}/effort"] = effort if joint == "hip" else np.zeros(len(time))
            columns[f"joint/{joint}/position_command"] = command
        put(folder, file, columns)
    assert not any("repeat" in text for text in read_log_set(folder).warnings)


def test_a_set_that_is_only_judged_may_hold_copies(folder):
    put(folder, "b.parquet", trimmed(make_columns()))
    assert len(read_log_set(folder, all_heldout=True).heldout) == 3


def test_a_lone_short_trial_has_a_gap(tmp_path):
    from hqpipe.logs.split import split_rows

    for samples in (10, 11, 19, 29, 2000):
        (_, fit_end), (held_start, end) = split_rows(samples, 1e-3)
        assert fit_end < held_start < end == samples


@pytest.mark.parametrize(
    "name", ["emps", "so101", "xl330", "xl330/drops", "go2", "cranfield_ref", "cranfield_same", "cranfield_lube1"]
)
def test_real_machines_are_not_accused(name):
    if not (REAL / name).is_dir():
        pytest.skip(f"{REAL / name} is not there")
    assert not any("repeat" in text or "same bytes" in text for text in read_log_set(REAL / name).warnings)


def test_real_trick_is_refused(tmp_path):
    if not (REAL / "emps").is_dir():
        pytest.skip(f"{REAL / 'emps'} is not there")
    (tmp_path / "motion_a.parquet").write_bytes((REAL / "emps" / "motion_a.parquet").read_bytes())
    listed(tmp_path, **{"motion_a.parquet": "fit", "./motion_a.parquet": "heldout"})
    assert "is the same file as 'motion_a.parquet'" in refusal(tmp_path)


def test_stress_trials_that_repeat_a_fit_trial(folder):
    from types import SimpleNamespace

    from hqpipe.stages.inputs.logs import read_stress

    put(folder / "stress", "drop.parquet", make_columns(seed=7))
    context = SimpleNamespace(inputs={"logs": folder}, params=SimpleNamespace(strict=False))
    log_set = read_log_set(folder)
    assert len(read_stress(context, log_set).heldout) == 1
    put(folder / "stress", "push.parquet", trimmed(make_columns()))
    with pytest.raises(LogError, match=r"stress/push\.parquet: rows .* repeat a\.parquet"):
        read_stress(context, log_set)
