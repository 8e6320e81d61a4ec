"""Layouts of known projects, on files that are written as those projects write them."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from damage import ANY_FILE, JSON_FILE, TEXT_FILE, refuses_every, survives_flips
from torch_files import write_torch

from hqpipe.logs.imports import FOREIGN_READERS, PRESETS
from hqpipe.logs.imports.convert import Converted, convert
from hqpipe.logs.imports.csv_table import CsvReader
from hqpipe.logs.imports.mapping import parse_map
from hqpipe.logs.imports.presets import bam, pace, sage, unitree
from hqpipe.logs.imports.recording import ImportLogError, Recording

RNG = np.random.default_rng(5)


def converted(recordings: list[Recording], content: dict[str, Any]) -> list[Converted]:
    """Each recording with the mapping of a preset, which must be a sound mapping file."""
    log_map = parse_map(content, Path("preset"))
    return [convert(recording, log_map) for recording in recordings]


def test_presets_and_their_readers_are_registered() -> None:
    assert {"pace", "bam", "sage", "unitree"} <= set(PRESETS)
    assert all(callable(PRESETS[name]) for name in PRESETS)
    assert {"pace", "bam", "sage"} <= set(FOREIGN_READERS)


# PACE


def write_pace(path: Path, even: bool = True) -> dict[str, np.ndarray]:
    time = np.linspace(0, 1, 201) + (0 if even else 2e-3 * RNG.uniform(size=201))
    made = {"time": time, "dof_pos": RNG.normal(size=(201, 3)), "des_dof_pos": RNG.normal(size=(201, 3))}
    write_torch(path, made)
    return made


def test_pace(tmp_path: Path) -> None:
    made = write_pace(tmp_path / "chirp.pt")
    recordings = pace.PaceReader.read(tmp_path / "chirp.pt")
    (trial,) = converted(recordings, pace.mapping(recordings))
    for index in range(3):
        joint = f"joint/joint_{index:02d}"
        np.testing.assert_array_equal(trial.columns[f"{joint}/position"], made["dof_pos"][:, index])
        np.testing.assert_array_equal(trial.columns[f"{joint}/position_command"], made["des_dof_pos"][:, index])
    np.testing.assert_allclose(trial.columns["time"], made["time"], atol=1e-12)
    assert any("evenly spaced" in note for note in recordings[0].notes)


def test_pace_with_the_gains_of_its_drives(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    made = {"time": torch.linspace(0, 1, 201), "dof_pos": torch.zeros(201, 2), "des_dof_pos": torch.zeros(201, 2)}
    torch.save({**made, "kp": np.array([80.0, 120.0]), "kd": np.array([2.5, 2.0])}, tmp_path / "chirp.pt")
    (recording,) = pace.PaceReader.read(tmp_path / "chirp.pt")
    assert recording.drive == {"joint_00": {"kp": 80.0, "kd": 2.5}, "joint_01": {"kp": 120.0, "kd": 2.0}}


def test_pace_with_a_measured_clock(tmp_path: Path) -> None:
    write_pace(tmp_path / "chirp.pt", even=False)
    assert not any("evenly spaced" in note for note in pace.PaceReader.read(tmp_path / "chirp.pt")[0].notes)


@pytest.mark.parametrize(
    "tensors",
    [
        {"time": np.arange(5.0), "dof_pos": np.zeros((5, 2))},
        {"time": np.arange(5.0), "dof_pos": np.zeros((5, 2)), "des_dof_pos": np.zeros((4, 2))},
        {"time": np.arange(5.0), "dof_pos": np.zeros(5), "des_dof_pos": np.zeros(5)},
        {"time": np.arange(1.0), "dof_pos": np.zeros((1, 2)), "des_dof_pos": np.zeros((1, 2))},
    ],
)
def test_other_tensors_are_no_recording_of_pace(tmp_path: Path, tensors: dict[str, np.ndarray]) -> None:
    write_torch(tmp_path / "chirp.pt", tensors)
    with pytest.raises(ImportLogError):
        pace.PaceReader.read(tmp_path / "chirp.pt")


# BAM


def bam_content(count: int = 40, off_from: int | None = None, duty: bool = False, **more: Any) -> dict[str, Any]:
    entries = []
    for index in range(count):
        pwm = 100 * np.sin(index)
        load = pwm / 885 if duty else float(int(pwm) % 2**16)
        entry = {"position": 0.01 * index, "speed": 0.5, "load": load, "input_volts": 7.4, "temp": 30}
        entry |= {"timestamp": 0.005 * index + 0.003, "goal_position": 0.02 * index}
        entries.append(entry | {"torque_enable": off_from is None or index < off_from})
    head = {"mass": 0.49, "length": 0.1, "kp": 200, "vin": 7.4, "motor": "xl330", "trajectory": "sin_sin"}
    return head | more | {"entries": entries}


@pytest.fixture
def bam_file(tmp_path: Path) -> Path:
    return tmp_path / "2026-01-15_10h28m10.json"


@pytest.mark.parametrize("duty", [False, True])
def test_bam(bam_file: Path, duty: bool) -> None:
    bam_file.write_text(json.dumps(bam_content(duty=duty)))
    assert bam.BamReader.claims_file(bam_file)
    recordings = bam.BamReader.read(bam_file)
    (trial,) = converted(recordings, bam.mapping(recordings))
    index = np.arange(40)
    np.testing.assert_allclose(trial.columns["joint/pendulum/position"], 0.01 * index, rtol=1e-12)
    np.testing.assert_allclose(trial.columns["joint/pendulum/position_command"], 0.02 * index, rtol=1e-12)
    pwm = 100 * np.sin(index) if duty else np.trunc(100 * np.sin(index))
    np.testing.assert_allclose(trial.columns["joint/pendulum/duty"], pwm / 885, atol=1e-12)
    np.testing.assert_allclose(trial.columns["supply/voltage"], 7.4)
    np.testing.assert_allclose(trial.columns["time"], 0.005 * index, atol=1e-12)
    assert recordings[0].name == "sin_sin_kp200"
    assert recordings[0].load == {"pendulum": {"mass_kg": 0.49, "lever_m": 0.1}}
    assert recordings[0].drive == {"pendulum": {"firmware_kp": 200.0, "supply_v": 7.4}}


def test_the_free_swing_is_a_recording_of_its_own(bam_file: Path) -> None:
    bam_file.write_text(json.dumps(bam_content(off_from=15)))
    recordings = bam.BamReader.read(bam_file)
    assert [(r.name, len(r.streams[0].fields["position"])) for r in recordings] == [
        ("sin_sin_kp200", 15),
        ("sin_sin_kp200_off", 25),
    ]
    assert bam.mapping(recordings)["trials"] == [{"files": "*_off*", "split": "skip"}]


def test_the_load_of_other_servos_is_no_duty(bam_file: Path) -> None:
    bam_file.write_text(json.dumps(bam_content(motor="mx106")))
    recordings = bam.BamReader.read(bam_file)
    assert "duty" not in bam.mapping(recordings)["joints"]["pendulum"]


@pytest.mark.parametrize(
    "change", [{"kp": "high"}, {"entries": []}, {"entries": [{"position": 1}]}, {"entries": 3}, {"mass": True}]
)
def test_bad_recordings_of_bam_are_refused(bam_file: Path, change: dict) -> None:
    bam_file.write_text(json.dumps(bam_content() | change))
    with pytest.raises(ImportLogError):
        bam.BamReader.read(bam_file)


def test_damaged_recordings_of_bam_are_refused(bam_file: Path) -> None:
    bam_file.write_text(json.dumps(bam_content()))
    refuses_every(ANY_FILE | JSON_FILE, lambda: bam.BamReader.read(bam_file), bam_file, exit_code=1)
    survives_flips(lambda: bam.BamReader.read(bam_file), bam_file, exit_code=1)


# SAGE

JOINTS = ("Rotation", "Pitch", "Elbow")


def write_sage(folder: Path, unit: float = 1e6, width: int = 3, sign: bool = True) -> dict[str, np.ndarray]:
    folder.mkdir(parents=True, exist_ok=True)
    time = 0.02 * np.arange(300)
    phase = np.outer(time, [1.0, 1.5, 2.0][:width])
    made = {"positions": np.sin(phase), "velocities": np.cos(phase) * [1.0, 1.5, 2.0][:width]}
    made["torques"] = np.sin(phase) if sign else np.abs(np.sin(phase))
    made["time"], made["command"] = time, np.sin(phase + 0.1)
    for name, kind, lists in (
        ("control", "CONTROL", {"positions": made["command"]}),
        ("state_motor", "STATE_MOTOR", {key: made[key] for key in ("positions", "velocities", "torques")}),
    ):
        with (folder / f"{name}.csv").open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(["type", "timestamp", *lists])
            for index, at in enumerate(time):
                writer.writerow([kind, 5.0 + at * unit, *(values[index].tolist() for values in lists.values())])
    (folder / "joint_list.txt").write_text("".join(f"/World/robot/{joint}\n" for joint in JOINTS))
    return made


@pytest.mark.parametrize(("unit", "name"), [(1e6, "µs"), (1e5, "10 µs"), (1.0, None)])
def test_sage(tmp_path: Path, unit: float, name: str | None) -> None:
    made = write_sage(tmp_path / "chirp", unit)
    assert sage.SageReader.claims_folder(tmp_path / "chirp")
    recordings = sage.SageReader.read(tmp_path / "chirp")
    (trial,) = converted(recordings, sage.mapping(recordings))
    for index, joint in enumerate(JOINTS):
        column = f"joint/{joint}"
        np.testing.assert_array_equal(trial.columns[f"{column}/position"], made["positions"][:, index])
        np.testing.assert_array_equal(trial.columns[f"{column}/velocity"], made["velocities"][:, index])
        np.testing.assert_array_equal(trial.columns[f"{column}/effort"], made["torques"][:, index])
        np.testing.assert_array_equal(trial.columns[f"{column}/position_command"], made["command"][:, index])
    np.testing.assert_allclose(trial.columns["time"], made["time"], atol=1e-9)
    assert any(f"units of {name}" in note for note in recordings[0].notes) == (name is not None)


def test_sage_tells_that_torques_have_no_sign(tmp_path: Path) -> None:
    write_sage(tmp_path / "signed")
    write_sage(tmp_path / "bare", sign=False)
    notes = [sage.SageReader.read(tmp_path / name)[0].notes for name in ("signed", "bare")]
    assert [any("no sign" in note for note in each) for each in notes] == [False, True]


def test_a_shorter_list_is_that_of_the_last_joints(tmp_path: Path) -> None:
    write_sage(tmp_path / "upper", width=2)
    recordings = sage.SageReader.read(tmp_path / "upper")
    assert list(sage.mapping(recordings)["joints"]) == ["Pitch", "Elbow"]
    assert any("2 of the 3 joints" in note for note in recordings[0].notes)


@pytest.mark.parametrize("name", ["control.csv", "state_motor.csv", "joint_list.txt"])
def test_damaged_folders_of_sage_are_refused(tmp_path: Path, name: str) -> None:
    write_sage(tmp_path / "chirp")
    damages = ANY_FILE | TEXT_FILE
    if name != "joint_list.txt":  # a table that ends early between two rows is a shorter one; in a row it is damaged
        damages = {key: damage for key, damage in damages.items() if not key.startswith("cut")}
    else:
        damages = {key: damages[key] for key in ("missing", "empty", "a folder", "blank", "not UTF-8")}
    refuses_every(damages, lambda: sage.SageReader.read(tmp_path / "chirp"), tmp_path / "chirp" / name, exit_code=1)


def test_lists_of_other_lengths_are_refused(tmp_path: Path) -> None:
    write_sage(tmp_path / "chirp")
    (tmp_path / "chirp" / "joint_list.txt").write_text("A\nB\n")
    with pytest.raises(ImportLogError, match="lists of 3 numbers"):
        sage.SageReader.read(tmp_path / "chirp")
    file = tmp_path / "chirp" / "control.csv"
    file.write_text(file.read_text() + 'CONTROL,7000000.0,"[1.0, 2.0]"\n')
    with pytest.raises(ImportLogError, match="differ in length"):
        sage.SageReader.read(tmp_path / "chirp")


# Unitree


def write_table(path: Path, columns: dict[str, np.ndarray]) -> None:
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*(np.asarray(values).tolist() for values in columns.values()), strict=True))


CLOCK = 0.002 * np.arange(50)
SIGNALS = RNG.normal(size=(5, 50, 12))
FORMS = {
    "deployment": ("q_{n}", "dq_{n}", "tau_{n}", "q_des_{n}", "temp_{n}"),
    "estimates": ("q_{n}", "dq_act_{n}", "tau_est_{n}", "q_cmd_{n}", "temperature_{n}"),
    "brackets": ("q[{n}]", "dq[{n}]", "tau_est[{n}]", "q_des[{n}]", "temp[{n}]"),
    "PlotJuggler": (
        "/lowstate/motor_state[{n}]/q",
        "/lowstate/motor_state[{n}]/dq",
        "/lowstate/motor_state[{n}]/tau_est",
        "/lowcmd/motor_cmd[{n}]/q",
        "/lowstate/motor_state[{n}]/temperature",
    ),
    "flat": ("motor_state_{n}_q", "motor_state_{n}_dq", "motor_state_{n}_tau_est", "motor_cmd_{n}_q", "temp_{n}"),
    "names": ("{joint}_q", "{joint}_dq", "{joint}_tau_est", "{joint}_q_des", "{joint}_temp"),
}
QUADRUPED = [f"{leg}_{part}" for leg in ("FR", "FL", "RR", "RL") for part in ("hip", "thigh", "calf")]


@pytest.mark.parametrize("form", FORMS)
def test_unitree(tmp_path: Path, form: str) -> None:
    columns = {"time": CLOCK, "imu_qw": np.ones(50), "foot_force_0": np.ones(50)}
    for signals, template in zip(SIGNALS, FORMS[form], strict=True):
        for number, joint in enumerate(QUADRUPED):
            columns[template.format(n=number, joint=joint)] = signals[:, number]
    write_table(tmp_path / "run.csv", columns)
    recordings = CsvReader.read(tmp_path / "run.csv")
    (trial,) = converted(recordings, unitree.mapping(recordings))
    channels = ("position", "velocity", "effort", "position_command", "temperature")
    for signals, channel in zip(SIGNALS, channels, strict=True):
        for number, joint in enumerate(QUADRUPED):
            np.testing.assert_array_equal(trial.columns[f"joint/{joint}/{channel}"], signals[:, number])
    np.testing.assert_allclose(trial.columns["time"], CLOCK, atol=1e-12)


def table_of(path: Path, template: str, count: int, **more: np.ndarray) -> list[Recording]:
    clock = {} if set(more) & {"tick", "stamp", "time_us"} else {"time": CLOCK}
    write_table(path, clock | {template.format(n=n): SIGNALS[0][:, n % 12] for n in range(count)} | more)
    return CsvReader.read(path)


def test_motors_of_other_robots_and_orders_keep_their_numbers(tmp_path: Path) -> None:
    for template, count in (("q_{n}", 29), ("dof_pos_{n}", 12)):
        recordings = table_of(tmp_path / "run.csv", template, count)
        joints = unitree.mapping(recordings)["joints"]
        assert list(joints) == [f"motor_{n:02d}" for n in range(count)]


def test_constant_gains_are_stated(tmp_path: Path) -> None:
    gains = {"kp_0": np.full(50, 25.0), "kd_0": np.full(50, 0.5), "kp_1": CLOCK, "kd_1": np.full(50, 0.5)}
    recordings = table_of(tmp_path / "run.csv", "q_{n}", 2, **gains)
    assert unitree.mapping(recordings)["drive"] == {
        "motor_00": {"kp": 25.0, "kd": 0.5},
        "motor_01": {"kd": 0.5},
    }


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [("tick", 1e3, "ms"), ("time_us", 1e6, "us"), ("timestamp", 1e9, "ns"), ("timestamp", 1e3, "ms"), ("t", 1.0, "s")],
)
def test_units_of_the_clock(tmp_path: Path, name: str, factor: float, unit: str) -> None:
    columns = {name: factor * CLOCK} | {f"q_{n}": SIGNALS[0][:, n] for n in range(3)}
    write_table(tmp_path / "run.csv", columns)
    assert unitree.mapping(CsvReader.read(tmp_path / "run.csv"))["clock"] == {"field": name, "unit": unit}


def test_a_channel_that_one_motor_lacks_is_left_out(tmp_path: Path) -> None:
    recordings = table_of(tmp_path / "run.csv", "q_{n}", 2, dq_0=CLOCK)
    assert list(unitree.mapping(recordings)["joints"]["motor_00"]) == ["position"]


@pytest.mark.parametrize("order", [range(12), (3, 0, 9, 6, 4, 1, 10, 7, 5, 2, 11, 8)], ids=["motors", "policy"])
def test_targets_in_the_order_of_a_policy(tmp_path: Path, order: tuple[int, ...]) -> None:
    positions = np.cumsum(SIGNALS[0], axis=0)
    columns = {"time": CLOCK} | {f"q_{n}": positions[:, n] for n in range(12)}
    columns |= {f"q_des_{place}": positions[:, motor] + 0.1 for place, motor in enumerate(order)}
    write_table(tmp_path / "run.csv", columns)
    recordings = CsvReader.read(tmp_path / "run.csv")
    (trial,) = converted(recordings, unitree.mapping(recordings))
    for joint in QUADRUPED:
        error = trial.columns[f"joint/{joint}/position_command"] - trial.columns[f"joint/{joint}/position"]
        np.testing.assert_allclose(error, 0.1, atol=1e-9)


@pytest.mark.parametrize("columns", [{"time": CLOCK, "x": CLOCK}, {"q_0": CLOCK}, {"time": np.ones(50), "q_0": CLOCK}])
def test_other_tables_are_refused(tmp_path: Path, columns: dict[str, np.ndarray]) -> None:
    write_table(tmp_path / "run.csv", {"other": np.ones(50)} | columns)
    with pytest.raises(ImportLogError):
        unitree.mapping(CsvReader.read(tmp_path / "run.csv"))


# The logs that the shared log sets were made of; where the originals lie is for the developer to say

SHARED = Path(__file__).parents[5] / "shared" / "data"
ORIGINALS = Path(os.environ.get("HQPIPE_ORIGINALS", "/nowhere"))
needs_originals = pytest.mark.skipif(
    not (SHARED.is_dir() and ORIGINALS.is_dir()),
    reason="needs ../shared/data, and HQPIPE_ORIGINALS with the files that its README names: traj_0.pt, raw/*.json, custom/*/",
)


@needs_originals
def test_the_shared_go2_comes_from_its_original() -> None:
    recordings = pace.PaceReader.read(ORIGINALS / "traj_0.pt")
    (trial,) = converted(recordings, pace.mapping(recordings))
    start = {"a": 0, "b": 1450, "c": 2100, "d": 3750}  # 50 samples are left out between the parts
    for name, first in start.items():
        table = pq.read_table(SHARED / "go2" / f"{name}.parquet")
        for channel in ("position", "position_command"):
            columns = [each for each in table.schema.names if each.endswith(f"/{channel}")]
            for index, column in enumerate(columns):
                values = trial.columns[f"joint/joint_{index:02d}/{channel}"]
                np.testing.assert_array_equal(values[first : first + table.num_rows], table[column].to_numpy())


@needs_originals
def test_the_shared_xl330_comes_from_its_originals() -> None:
    recordings = [r for file in sorted((ORIGINALS / "raw").glob("*.json")) for r in bam.BamReader.read(file)]
    content = bam.mapping(recordings)
    seen = 0
    for recording, trial in zip(recordings, converted(recordings, content), strict=True):
        file = SHARED / "xl330" / f"{recording.name.replace('_and_drop', '')}.parquet"
        if file.exists():
            seen += 1
            same(trial, pq.read_table(file))
    assert seen == 16


@needs_originals
def test_the_shared_so101_comes_from_its_originals() -> None:
    folders = [folder for folder in sorted((ORIGINALS / "custom").iterdir()) if folder.is_dir()]
    assert folders
    for folder in folders:
        recordings = sage.SageReader.read(folder)
        (trial,) = converted(recordings, sage.mapping(recordings))
        same(trial, pq.read_table(SHARED / "so101" / f"{folder.name}.parquet"))


def same(trial: Converted, table: pa.Table) -> None:
    assert set(trial.columns) == set(table.schema.names)
    for name in table.schema.names:
        np.testing.assert_allclose(trial.columns[name], table[name].to_numpy(), rtol=0, atol=1e-9, err_msg=name)
