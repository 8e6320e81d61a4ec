"""Exported files appear whole, inside the target, and in place of others only when asked."""

from __future__ import annotations

import pytest

from hqpipe.errors import UsageError
from hqpipe.logs.export.targets import targets, write_all

FILES = ["a.parquet", "sub/b.parquet"]


def write(path, index):
    path.write_text(f"trial {index}")


def tree(folder):
    return {str(p.relative_to(folder)): p.read_text() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_a_new_folder_gets_all_files(tmp_path):
    out = tmp_path / "new" / "out"
    write_all(out, targets(out, FILES, ".csv"), write)
    assert tree(tmp_path) == {"new/out/a.csv": "trial 0", "new/out/sub/b.csv": "trial 1"}


def test_other_files_of_a_folder_stay(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    write_all(tmp_path, targets(tmp_path, FILES, ".csv"), write)
    assert tree(tmp_path) == {"a.csv": "trial 0", "mine.txt": "mine", "sub/b.csv": "trial 1"}


def test_a_single_trial_may_be_a_file(tmp_path):
    out = tmp_path / "one.csv"
    assert targets(out, ["a.parquet"], ".csv") == [out]
    write_all(out, [out], write)
    assert tree(tmp_path) == {"one.csv": "trial 0"}
    with pytest.raises(UsageError, match="one file, expected a folder for 2 trials"):
        targets(tmp_path / "two.csv", FILES, ".csv")
    with pytest.raises(UsageError, match="ends in .csv, expected a folder or a file that ends in .mcap"):
        targets(tmp_path / "two.csv", FILES[:1], ".mcap")


@pytest.mark.parametrize("single", [True, False])
def test_what_is_there_is_replaced_only_with_force(tmp_path, single):
    out = tmp_path / "a.csv" if single else tmp_path
    paths = targets(out, FILES[:1], ".csv")
    (tmp_path / "a.csv").write_text("old")
    with pytest.raises(UsageError, match="is there already.*--force"):
        write_all(out, paths, write)
    assert tree(tmp_path) == {"a.csv": "old"}
    write_all(out, paths, write, force=True)
    assert tree(tmp_path) == {"a.csv": "trial 0"}


@pytest.mark.parametrize("there", [True, False])
def test_a_failure_leaves_everything_as_it_was(tmp_path, there):
    out = tmp_path / "out"
    if there:
        out.mkdir()
        (out / "a.csv").write_text("old")

    def fail(path, index):
        write(path, index)
        if index == 1:
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_all(out, targets(out, FILES, ".csv"), fail, force=True)
    assert tree(tmp_path) == ({"out/a.csv": "old"} if there else {})
    assert [p.name for p in tmp_path.iterdir()] == (["out"] if there else [])


def test_a_link_does_not_lead_out_of_the_target(tmp_path):
    outside, out = tmp_path / "outside", tmp_path / "out"
    outside.mkdir()
    out.mkdir()
    (out / "sub").symlink_to(outside)
    with pytest.raises(UsageError, match="leads out of"):
        write_all(out, targets(out, FILES, ".csv"), write)
    assert list(outside.iterdir()) == []


def test_a_link_in_place_of_a_file_is_replaced_and_not_followed(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "theirs").write_text("theirs")
    (out / "a.csv").symlink_to(tmp_path / "theirs")
    write_all(out, targets(out, FILES[:1], ".csv"), write, force=True)
    assert (tmp_path / "theirs").read_text() == "theirs" and (out / "a.csv").read_text() == "trial 0"


def test_trials_that_differ_in_their_ending_only_need_two_files(tmp_path):
    with pytest.raises(UsageError, match="would hold two trials"):
        targets(tmp_path, ["a.parquet", "a.csv"], ".mcap")


def test_a_folder_in_place_of_a_file_is_refused(tmp_path):
    (tmp_path / "a.csv").mkdir()
    with pytest.raises(UsageError, match="is a folder"):
        write_all(tmp_path, targets(tmp_path, FILES[:1], ".csv"), write, force=True)
