"""What logset.yaml states of drives, loads and the robot description."""

from __future__ import annotations

import pytest
from log_builders import make_columns, put

from hqpipe.errors import LogError
from hqpipe.logs.drive import of_joint
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.manifest import read_manifest, write_manifest


@pytest.fixture
def folder(tmp_path):
    for seed, file in enumerate(("a.parquet", "b.parquet")):
        put(tmp_path / "logs", file, make_columns(seed=seed))
    return tmp_path / "logs"


def state(folder, general="", own=""):
    text = f"format: hqpipe-log/1\n{general}trials:\n  - {{file: a.parquet, split: fit{own}}}\n"
    (folder / "logset.yaml").write_text(text + "  - {file: b.parquet, split: heldout}\n")
    return folder


def test_a_trial_adds_to_what_its_set_states(folder):
    state(folder, "drive: {kp: 20.0, kd: 1.5}\nload: {knee: {mass_kg: 0.5}}\n", ", drive: {knee: {kp: 40}}")
    first, second = read_log_set(folder).trials
    assert of_joint(first.drive, "knee") == {"kp": 40.0, "kd": 1.5} and of_joint(first.drive, "hip")["kp"] == 20.0
    assert of_joint(second.drive, "knee")["kp"] == 20.0
    assert of_joint(first.load, "knee") == {"mass_kg": 0.5} and of_joint(first.load, "hip") == {}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("drive: {kpp: 1}\n", "unknown field 'drive.kpp' – did you mean 'kp'"),
        ("drive: {knee: {kp: high}}\n", "drive.knee.kp is 'high', expected a number of N·m/rad"),
        ("load: {mass_kg: -1}\n", "load.mass_kg is -1, expected a number of kg, 0 or more"),
        ("load: 3\n", "load is 3, expected numbers"),
        ("urdf: 5\n", "urdf is 5, expected the path of a URDF"),
        ("joint_map: {knee: 3}\n", "expected names of joints"),
    ],
)
def test_what_is_wrong_is_named(folder, text, words):
    with pytest.raises(LogError) as info:
        read_log_set(state(folder, text))
    assert words in str(info.value) and info.value.field and info.value.fix


def test_what_is_written_is_read(folder):
    text = "drive: {kp: 20.0}\nload: {knee: {mass_kg: 0.5, lever_m: 0.1}}\nurdf: arm.urdf\njoint_map: {knee: j2}\n"
    path = state(folder, text, ", drive: {kd: 1.0}") / "logset.yaml"
    found = read_manifest(path, ["a.parquet", "b.parquet"])
    write_manifest(path, found)
    assert read_manifest(path, ["a.parquet", "b.parquet"]) == found
