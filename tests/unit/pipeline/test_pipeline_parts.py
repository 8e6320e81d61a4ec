"""The stage table, reasons, progress lines, redirection, metrics, and provenance."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from hqpipe.errors import ConfigError, HqpipeError, UsageError
from hqpipe.pipeline.executor import check_metrics
from hqpipe.pipeline.manifest import Manifest, Recipe
from hqpipe.pipeline.progress import LineProgress
from hqpipe.pipeline.project import Project, find_root
from hqpipe.pipeline.provenance import provenance
from hqpipe.pipeline.reasons import differences
from hqpipe.pipeline.stage import Input, Stage, StageTable
from hqpipe.pipeline.streams import stdout_to_stderr

FIT = Stage("fit-it", "fit", "m", "Fit.")


def table(*stages: Stage) -> StageTable:
    return StageTable(stages, template=Path("unused"))


def test_table_refuses_a_stage_before_its_input():
    with pytest.raises(ValueError, match="no earlier stage makes 'fit'"):
        table(Stage("use", "used", "m", "", inputs=(Input("fit", "fit", "--fit"),)), FIT)


@pytest.mark.parametrize("twin", [Stage("fit-it", "other", "m", ""), Stage("other", "fit", "m", "")])
def test_table_refuses_a_name_twice(twin):
    with pytest.raises(ValueError, match="is taken"):
        table(FIT, twin)


def test_table_names_the_near_match():
    stages = table(FIT)
    assert FIT.section == "fit_it" and stages.maker("fit") is FIT
    with pytest.raises(UsageError, match="did you mean 'fit-it'"):
        stages["fit-ti"]


def test_differences_name_every_cause():
    made = Recipe("fit", 1, {"a": 1, "b": {"c": [1, 2]}, "gone": {"x": 0}}, 1, {"logs": "0" * 64}, "r" * 64)
    wanted = Recipe("fit", 2, {"a": 1, "b": {"c": [1, 3]}, "new": 5}, 2, {"logs": "1" * 64}, "s" * 64)
    reasons = differences(Manifest(made, {}, {}, {}, {}), wanted)
    assert [(reason.kind, reason.name) for reason in reasons] == [
        ("code", "fit"),
        ("parameter", "b.c"),
        ("parameter", "gone.x"),
        ("parameter", "new"),
        ("seed", "seed"),
        ("input", "logs"),
        ("robot", "robot"),
    ]
    assert reasons[1].text == "b.c [1, 2] → [1, 3]"
    assert reasons[3].text == "new (not set) → 5"
    assert differences(Manifest(made, {}, {}, {}, {}), made) == ()


def test_one_line_a_minute(capsys):
    now = 0.0
    progress = LineProgress("train", 60.0, clock=lambda: now)
    for now in range(0, 181, 10):
        progress(now, 200, "reward 3")
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["train: 30 %  reward 3", "train: 60 %  reward 3", "train: 90 %  reward 3"]


def test_output_of_python_and_of_child_processes_is_redirected(capfd):
    with stdout_to_stderr():
        print("from python")
        subprocess.run(["echo", "from a child"], check=True)
        os.write(1, b"from a library\n")
    print("the answer")
    out, err = capfd.readouterr()
    assert out == "the answer\n"
    assert {"from python", "from a child", "from a library"} <= set(err.splitlines())


def test_output_is_restored_after_an_error(capfd):
    with pytest.raises(ValueError, match="x"), stdout_to_stderr():
        raise ValueError("x")
    print("the answer")
    assert capfd.readouterr().out == "the answer\n"


def test_metrics_become_plain_data():
    metrics = {"a": np.float64(1.5), "b": np.arange(3), "c": (np.int64(2), float("inf")), 4: np.True_}
    assert check_metrics(FIT, metrics) == {"a": 1.5, "b": [0, 1, 2], "c": [2, None], "4": True}
    with pytest.raises(HqpipeError, match=r"fit-it: metrics.a\[1\]: expected plain data, got object"):
        check_metrics(FIT, {"a": [1, object()]})


def git(folder: Path, *arguments: str) -> None:
    identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    subprocess.run(["git", "-C", str(folder), *identity, *arguments], check=True, capture_output=True)


def test_provenance_tells_commit_and_changes(tmp_path):
    clean, dirty, bare = tmp_path / "clean", tmp_path / "dirty", tmp_path / "bare"
    for folder in (clean, dirty):
        folder.mkdir()
        git(folder, "init")
        (folder / "a").write_text("a")
        git(folder, "add", "a")
        git(folder, "commit", "-m", "a")
    (dirty / "a").write_text("b")
    bare.mkdir()
    assert provenance(clean)["git"]["dirty"] is False
    assert provenance(dirty)["git"]["dirty"] is True
    assert provenance(bare)["git"] is None
    record = provenance(bare)
    assert record["packages"]["numpy"] == np.__version__ and record["machine"]["cores"] >= 1


def test_root_is_the_nearest_folder_above(tmp_path):
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "pipeline.yaml").write_text("robot: x")
    (tmp_path / "a" / "pipeline.yaml").write_text("robot: x")
    assert find_root(tmp_path / "a" / "b") == tmp_path / "a"


class _File:
    def __init__(self, robot: str) -> None:
        self.file = self
        self.robot = robot


@pytest.mark.parametrize("name", ["mine", "robot/mine", "./robot/mine"])
def test_robot_is_found_by_name_and_path(tmp_path, name):
    folder = tmp_path / "robot" / "mine"
    folder.mkdir(parents=True)
    (folder / "robot.yaml").write_text("name: mine")
    project = Project(tmp_path, table(FIT), _File(name), None)
    assert project.robot_folder().resolve() == folder
    before = project.robot_hash()
    (folder / "robot.urdf").write_text("<robot/>")
    assert project.robot_hash() != before


def test_robot_that_comes_with_the_package_is_found_elsewhere(tmp_path):
    folder = Project(tmp_path, table(FIT), _File("hydraulic_quadruped"), None).robot_folder()
    assert (folder / "robot.yaml").is_file()


@pytest.mark.parametrize(("name", "part"), [("hydraulic_quadrupe", "did you mean"), ("a/b", "not exist")])
def test_unknown_robot(tmp_path, name, part):
    with pytest.raises(ConfigError, match=part):
        Project(tmp_path, table(FIT), _File(name), None).robot_folder()
