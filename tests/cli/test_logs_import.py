"""hqpipe logs import, as a user runs it: logs like those of a small excavator, cylinders in cm, duty cycles in per cent."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from hqpipe.cli import run_cli
from hqpipe.logs.columns import joint_column
from hqpipe.logs.imports.import_set import MAP
from hqpipe.logs.parquet import ParquetReader
from hqpipe.stages import STAGES

AXES = {"Boom": 7.4745, "Stick": 6.895, "Swing": 7.4695}
JOINTS = {
    axis.lower(): {
        "position": {"field": f"{axis} Ms", "unit": "rad" if axis == "Swing" else "cm"},
        "valve_command": {"field": [f"{axis} Blended", f"{axis} Cmd"], "zero": mid, "scale": 0.4},
    }
    for axis, mid in AXES.items()
}
CONTENT = {
    "format": "hqpipe-log-map/1",
    "base": "fixed",
    "control_mode": "valve",
    "clock": {"field": "Time", "unit": "s"},
    "joints": JOINTS,
}


def table(seed: int, blended: bool = False, rows: int = 600) -> dict[str, np.ndarray]:
    """About 20 Hz with jitter; the duty cycle drives the stroke."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(0.05 + 0.01 * rng.uniform(-1, 1, rows))
    columns = {"Time": time}
    for axis, mid in AXES.items():
        duty = mid + 2.5 * np.sign(np.sin(0.9 * time + rng.uniform(0, 6)))
        columns[f"{axis} {'Blended' if blended else 'Cmd'}"] = duty
        if blended:
            columns[f"{axis} Cmd"] = rng.uniform(-1, 1, rows)
        columns[f"{axis} Ms"] = 6.0 + np.cumsum(0.05 * (duty - mid))
    return columns


def write(path: Path, columns: dict[str, np.ndarray], short: int = 0) -> None:
    rows = zip(*columns.values(), strict=True)
    cells = [[f"{value:.9g}" for value in row] for row in rows]
    lines = [",".join(columns), *(",".join(row[: len(row) - short]) for row in cells)]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture
def rig(tmp_path) -> Path:
    """A folder as such rigs leave it."""
    folder = tmp_path / "rig"
    folder.mkdir()
    write(folder / "manual_1.csv", table(1))
    write(folder / "manual_2.csv", table(2))
    (folder / "manual_2_again.csv").write_bytes((folder / "manual_2.csv").read_bytes())
    write(folder / "blended.csv", table(3, blended=True))
    write(folder / "old_header.csv", table(4, rows=90), short=1)
    (folder / "crashed.csv").touch()
    (folder / "never_moved.csv").write_text((folder / "manual_1.csv").read_text().splitlines()[0] + "\n")
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(CONTENT, sort_keys=False))
    return folder


def test_a_folder_becomes_a_log_set(rig, tmp_path, capfd):
    out = tmp_path / "logs"
    assert run_cli(STAGES, ["logs", "import", str(rig), "--out", str(out), "--map", str(tmp_path / "map.yaml")]) == 0
    told = " ".join(capfd.readouterr().err.split())
    for part in (
        "skipped 1: manual_2_again.csv: same bytes as manual_2.csv",
        "skipped 1: old_header.csv: the header has 7 names, the rows have 6 cells",
        "skipped 1: crashed.csv: is empty",
        "skipped 1: never_moved.csv: no row of numbers in it",
        "3 trials",
        f"next: hqpipe logs check {out}",
        "joint/boom/position",
    ):
        assert part in told
    assert {p.name for p in out.iterdir()} == {
        *("blended.parquet", "manual_1.parquet", "manual_2.parquet", "logset.yaml", MAP)
    }
    source = table(3, blended=True)
    columns = ParquetReader.read(out / "blended.parquet").columns
    np.testing.assert_allclose(columns["time"], source["Time"] - source["Time"][0], atol=1e-6)
    np.testing.assert_allclose(columns["joint/stick/position"], source["Stick Ms"] / 100, atol=1e-6)
    expected = 0.4 * (source["Stick Blended"] - AXES["Stick"])
    np.testing.assert_allclose(columns["joint/stick/valve_command"], expected, atol=1e-6)


def test_json_is_one_object(rig, tmp_path, capfd):
    arguments = [
        "logs",
        "import",
        str(rig),
        "--out",
        str(tmp_path / "logs"),
        "--map",
        str(tmp_path / "map.yaml"),
        "--json",
    ]
    assert run_cli(STAGES, arguments) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["ok"] and len(found["trials"]) == 3 and found["channels"]["joint/boom/position"]["unit"] == "m"
    assert found["channels"]["joint/swing/position"]["unit"] == "rad"
    assert {name for skip in found["skipped"] for name in skip["files"]} >= {"crashed.csv", "manual_2_again.csv"}
    assert found["trials"][-1]["split"] == "heldout" and 15 < found["trials"][0]["rate_hz"] < 25
    assert run_cli(STAGES, arguments) == 2
    error = json.loads(capfd.readouterr().out)["error"]
    assert "exists already" in error["message"] and error["file"] == str(tmp_path / "logs")


def test_strict_stops_at_the_first_file_and_leaves_nothing(rig, tmp_path, capfd):
    out = tmp_path / "logs"
    arguments = ["logs", "import", str(rig), "--out", str(out), "--map", str(tmp_path / "map.yaml"), "--strict"]
    assert run_cli(STAGES, arguments) == 1
    assert "manual_2_again.csv: same bytes" in capfd.readouterr().err and not out.exists()
    assert {p.name for p in tmp_path.iterdir()} == {"rig", "map.yaml"}


def test_guess_writes_a_draft_and_imports_with_it(rig, tmp_path, capfd):
    out = tmp_path / "logs"
    assert run_cli(STAGES, ["logs", "import", str(rig / "manual_1.csv"), "--out", str(out), "--guess"]) == 0
    err = capfd.readouterr().err
    draft = tmp_path / "logs.map.yaml"
    assert "".join(f"drafted {draft}".split()) in "".join(err.split())  # whatever the width of the terminal
    content = yaml.safe_load(draft.read_text())
    assert content["joints"]["Boom"]["valve_command"]["field"] == "Boom Cmd" and "CHECK" in draft.read_text()
    assert (out / "logset.yaml").is_file() and (out / MAP).read_text() == draft.read_text()
    # a second draft would overwrite what a person has corrected
    assert run_cli(STAGES, ["logs", "import", str(rig / "manual_1.csv"), "--out", str(tmp_path / "b"), "--guess"]) == 0
    (tmp_path / "b.map.yaml").write_text("mine")
    assert (
        run_cli(STAGES, ["logs", "import", str(rig), "--out", str(tmp_path / "c"), "--guess", "--map", str(draft)]) == 2
    )
    assert "exists already" in capfd.readouterr().err


def test_a_draft_that_lacks_something_is_written_and_not_used(tmp_path, capfd):
    write(tmp_path / "a.csv", {"alpha": np.sin(np.arange(50.0)), "beta": np.cos(np.arange(50.0))})
    out = tmp_path / "logs"
    assert run_cli(STAGES, ["logs", "import", str(tmp_path / "a.csv"), "--out", str(out), "--guess", "--json"]) == 1
    error = json.loads(capfd.readouterr().out)["error"]
    assert "which field is the clock" in error["message"] and "import with --map" in error["fix"]
    assert (tmp_path / "logs.map.yaml").is_file() and not out.exists()


def test_a_preset_makes_the_mapping_and_leaves_it_to_be_seen(rig, tmp_path, monkeypatch):
    monkeypatch.setattr("hqpipe.logs.imports.PRESETS", {"rig": lambda recordings: CONTENT})
    assert run_cli(STAGES, ["logs", "import", str(rig), "--out", str(tmp_path / "logs"), "--preset", "rig"]) == 0
    assert yaml.safe_load((tmp_path / "logs.map.yaml").read_text()) == CONTENT
    assert len(list((tmp_path / "logs").glob("*.parquet"))) == 3


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["a.csv", "--out", "logs"], "give --map FILE, or --guess"),
        (["b.csv", "--out", "logs", "--guess"], "did you mean 'a.csv'"),
        (["a.csv", "--out", "logs", "--guess", "--preset", "x"], "exclude each other"),
        (["a.csv", "--out", "logs", "--preset", "nope"], "unknown preset 'nope'"),
        (["a.xyz", "--out", "logs", "--guess"], "no reader for '.xyz'"),
        (
            ["a.json", "--out", "logs", "--guess"],
            "no reader for '.json' but that of bam, which does not know what is in it",
        ),
        (["a.csv", "--out", "logs", "--map", "none.yaml"], "no such file"),
    ],
)
def test_wrong_arguments(tmp_path, monkeypatch, capfd, arguments, part):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "a.csv", table(1, rows=60))
    (tmp_path / "a.xyz").touch()
    (tmp_path / "a.json").write_text("{}")
    assert run_cli(STAGES, ["logs", "import", *arguments]) in (1, 2)
    assert part in " ".join(capfd.readouterr().err.split())
    assert {p.name for p in tmp_path.iterdir()} == {"a.csv", "a.json", "a.xyz"}


def test_a_folder_of_files_that_nobody_reads_names_them(tmp_path, capfd):
    (tmp_path / "raw").mkdir()
    (tmp_path / "raw" / "a.json").write_text("{}")
    assert run_cli(STAGES, ["logs", "import", str(tmp_path / "raw"), "--out", str(tmp_path / "logs"), "--guess"]) != 0
    assert "no file to import: no reader for a.json" in " ".join(capfd.readouterr().err.split())


def test_a_command_that_moves_in_one_of_the_files_is_one(tmp_path):
    """The draft reads the longest file, but a command counts by all of them."""
    for name, rows, moves in (("a", 900, 0.0), ("b", 300, 1.0)):
        t = np.arange(rows) / 100.0
        signals = np.stack([t, np.sin(t), moves * np.sin(t + 0.05), 0 * t], axis=1)
        np.savetxt(tmp_path / f"{name}.csv", signals, delimiter=",", header="t,q,q_cmd,tau_cmd", comments="")
    arguments = ["logs", "import", str(tmp_path), "--out", str(tmp_path / "logs"), "--guess"]
    assert run_cli(STAGES, arguments) == 0
    content = yaml.safe_load((tmp_path / "logs.map.yaml").read_text())
    assert content["control_mode"] == "position" and "effort_command" not in content["joints"]["joint"]


def test_the_group_lists_its_commands_and_near_matches(capfd):
    assert run_cli(STAGES, ["logs", "--help"]) == 0
    assert "import" in capfd.readouterr().out
    assert run_cli(STAGES, ["logs", "imprt"]) == 2
    assert "did you mean 'import'" in capfd.readouterr().err


def test_every_joint_has_its_columns(rig, tmp_path, capfd):
    run_cli(STAGES, ["logs", "import", str(rig), "--out", str(tmp_path / "logs"), "--map", str(tmp_path / "map.yaml")])
    names = ParquetReader.outline(tmp_path / "logs" / "manual_1.parquet").names
    assert {joint_column(axis.lower(), c) for axis in AXES for c in ("position", "valve_command")} < set(names)
