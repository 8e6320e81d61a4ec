"""A robot that cannot be used is refused before the first stage starts."""

from __future__ import annotations

import shutil

import pytest

from hqpipe.cli import run_cli
from hqpipe.robots import robot_folder
from hqpipe.stages import STAGES


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """The robot of a project of its own."""
    shutil.copytree(robot_folder("hydraulic_quadruped"), tmp_path / "robot" / "mine")
    (tmp_path / "pipeline.yaml").write_text("robot: mine\nseed: 1\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "robot" / "mine"


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("robot.urdf", 'mass value="208"', 'mass value="inf"', "link trunk: mass: value is 'inf'"),
        ("robot.yaml", "base_link: trunk", "base_link: trunc", "did you mean 'trunk'"),
        ("robot.yaml", "leakage: 1.0e-11", "leakage: -1.0", "hydraulics.cylinder.leakage: expected 0 to"),
        ("robot.yaml", "leakage: 1.0e-11", "leakege: 1.0e-11", "did you mean 'cylinder.leakage'"),
    ],
)
@pytest.mark.parametrize("options", [["--dry-run"], []], ids=["dry run", "run"])
def test_before_any_stage(mine, capsys, name, old, new, words, options):
    path = mine / name
    path.write_text(path.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    assert run_cli(STAGES, ["run", "all", *options]) == 2
    told = capsys.readouterr().err
    assert words in told and str(path) in told
    assert not list(mine.parents[1].glob("artifacts/store/*"))


def test_a_robot_without_hydraulics_serves_stages_without_the_plant(mine, capsys):
    path = mine / "robot.yaml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text[: text.index("hydraulics:")] + "hydraulics: {}\n", encoding="utf-8")
    assert run_cli(STAGES, ["bootstrap", "--dry-run"]) == 0
    assert run_cli(STAGES, ["run", "all", "--dry-run"]) == 2
    assert "hydraulics: missing field 'fluid.bulk_modulus'" in capsys.readouterr().err
