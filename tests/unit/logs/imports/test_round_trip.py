"""The same known log in every table format comes back as it was."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from foreign_tables import JOINTS, MAP, WRITERS, as_recorded, machine, write_csv, write_map

from hqpipe.errors import UsageError
from hqpipe.logs.imports.import_set import MAP as KEPT
from hqpipe.logs.imports.import_set import import_logs
from hqpipe.logs.imports.mapping import read_map
from hqpipe.logs.imports.recording import ImportLogError
from hqpipe.logs.imports.sources import find_sources
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.parquet import ParquetReader


def run(folder, *sources, content=MAP, **options):
    path = write_map(folder / "map.yaml", content)
    return import_logs(find_sources(sources), read_map(path), path.read_text(), folder / "out", **options)


@pytest.mark.parametrize("file", list(WRITERS))
def test_every_format_gives_the_known_log(tmp_path, file):
    known = machine()
    source = tmp_path / "in" / file
    source.parent.mkdir()
    WRITERS[file](source, as_recorded(known))
    result = run(tmp_path, source)
    first, last = (ParquetReader.read(tmp_path / "out" / trial.file).columns for trial in result.trials)
    assert set(first) == set(known)
    for name, values in known.items():
        scale = np.abs(values).max()
        np.testing.assert_allclose(first[name], values[: len(first[name])], rtol=0, atol=2e-7 * scale)
        end = values[-len(last[name]) :]
        np.testing.assert_allclose(last[name], end - end[0] if name == "time" else end, rtol=0, atol=2e-7 * scale)
    assert [trial.split for trial in result.trials] == ["fit", "heldout"]
    assert result.unit("joint/knee/position") == "rad" and result.unit("joint/knee/effort") == "N·m"


def test_the_log_set_is_one_that_hqpipe_reads(tmp_path):
    for seed, name in enumerate(("a.csv", "b.csv", "c.csv")):
        write_csv(tmp_path / name, as_recorded(machine(seed=seed)))
    run(tmp_path, tmp_path, content=MAP)
    log_set = read_log_set(tmp_path / "out")
    assert log_set.control_mode == "position" and log_set.effort_source == "pressure" and log_set.joints == JOINTS
    assert [(t.file, t.split) for t in log_set.trials] == [
        ("a.parquet", "fit"),
        ("b.parquet", "fit"),
        ("c.parquet", "heldout"),
    ]
    assert yaml.safe_load((tmp_path / "out" / KEPT).read_text()) == MAP


def test_rules_of_trials(tmp_path):
    for seed, name in enumerate(("a.csv", "b.csv", "c.csv")):
        write_csv(tmp_path / name, as_recorded(machine(seed=seed)))
    rules = [
        {"files": "a.*", "split": "heldout", "command": {"vx": 0.4}, "drive": {"hip": {"kp": 30}}},
        {"files": ["x", "b.csv"], "split": "skip"},
    ]
    content = MAP | {"trials": rules, "drive": {"hip": {"kp": 20, "kd": 1}}, "load": {"knee": {"mass_kg": 2}}}
    result = run(tmp_path, tmp_path, content=content)
    assert {t.file: t.split for t in result.trials} == {"a.parquet": "heldout", "c.parquet": "fit"}
    stated = yaml.safe_load((tmp_path / "out" / "logset.yaml").read_text())
    assert stated["drive"] == {"hip": {"kp": 20.0, "kd": 1.0}} and stated["load"] == {"knee": {"mass_kg": 2.0}}
    held = next(trial for trial in stated["trials"] if trial["split"] == "heldout")
    assert held["command"] == {"vx": 0.4} and held["drive"] == {"hip": {"kp": 30.0, "kd": 1.0}} and "load" not in held
    assert "drive" not in next(trial for trial in stated["trials"] if trial["split"] == "fit")
    assert len(read_log_set(tmp_path / "out").trials) == 2


def test_what_does_not_fit_is_skipped_and_said(tmp_path):
    write_csv(tmp_path / "a.csv", as_recorded(machine()))
    write_csv(tmp_path / "b.csv", as_recorded(machine(seed=1)))
    (tmp_path / "c_copy.csv").write_bytes((tmp_path / "a.csv").read_bytes())
    (tmp_path / "d_empty.csv").touch()
    (tmp_path / "e_header.csv").write_text((tmp_path / "a.csv").read_text().splitlines()[0] + "\n")
    (tmp_path / "f_other.csv").write_text("x,y\n1,2\n3,4\n5,6\n")
    (tmp_path / "g_short.csv").write_text("t,q,dq,tau\n" + "0,1,2\n1,2,3\n2,3,4\n" * 5)
    (tmp_path / "h.xyz").write_text("?")
    (tmp_path / "inner").mkdir()
    result = run(tmp_path, tmp_path)
    assert [t.source for t in result.trials] == ["a.csv", "b.csv"]
    reasons = {name: reason for reason, names in result.skipped.items() for name in names}
    assert reasons.pop("map.yaml") and reasons.keys() == {
        *("c_copy.csv", "d_empty.csv", "e_header.csv", "f_other.csv", "g_short.csv", "h.xyz", "inner")
    }
    assert reasons["c_copy.csv"] == "same bytes as a.csv" and "no field 'q[0]'" in reasons["f_other.csv"]
    assert reasons["g_short.csv"] == "the header has 4 names, the rows have 3 cells"


@pytest.mark.parametrize("other", ["x,y\n1,2\n3,4\n5,6\n", ""])
def test_strict_refuses_what_would_be_skipped_and_leaves_nothing(tmp_path, other):
    (tmp_path / "in").mkdir()
    write_csv(tmp_path / "in" / "a.csv", as_recorded(machine()))
    (tmp_path / "in" / "b.csv").write_text(other)
    with pytest.raises(ImportLogError) as caught:
        run(tmp_path, tmp_path / "in", strict=True)
    assert caught.value.file.endswith("b.csv") and caught.value.fix
    assert {p.name for p in tmp_path.iterdir()} == {"in", "map.yaml"}


def test_missing_samples_gaps_and_disorder_are_kept_or_counted(tmp_path):
    recorded = as_recorded(machine())
    recorded["q"][100:103, 0] = np.nan
    recorded = {name: np.delete(values, slice(500, 540), axis=0) for name, values in recorded.items()}
    recorded["t"][200] = recorded["t"][199]
    recorded["t"][300] = 1e9
    np.savez(tmp_path / "a.npz", **recorded)
    np.savez(tmp_path / "b.npz", **as_recorded(machine(seed=1)))
    (tmp_path / "in").mkdir()
    result = run(tmp_path, tmp_path / "a.npz", tmp_path / "b.npz")
    first = result.trials[0]
    assert first.samples == 960 - 2 and first.missing == {"joint/hip/position": 3} and first.gaps == 1
    assert first.longest_s == pytest.approx(41 / 200.0) and first.rate_hz == pytest.approx(200.0)
    assert "1 repeated time stamps, 1 rows out of order" in first.notes[0]
    columns = ParquetReader.read(tmp_path / "out" / "a.parquet").columns
    assert np.isnan(columns["joint/hip/position"]).sum() == 3 and (np.diff(columns["time"]) > 0).all()
    with pytest.raises(ImportLogError, match="1 repeated time stamps"):
        run(tmp_path / "in", tmp_path / "a.npz", strict=True)


def test_a_folder_with_something_in_it_is_left_alone(tmp_path):
    write_csv(tmp_path / "a.csv", as_recorded(machine()))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    with pytest.raises(UsageError, match="exists already"):
        run(tmp_path, tmp_path / "a.csv")
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["mine.txt"]


def test_a_trial_far_larger_than_the_others_is_warned_of(tmp_path):
    for seed in range(4):
        write_csv(tmp_path / f"t{seed}.csv", as_recorded(machine(seed=seed)))
    recorded = as_recorded(machine(seed=4))
    recorded["pa"] *= 10.0
    write_csv(tmp_path / "t4.csv", recorded)
    result = run(tmp_path, tmp_path)
    assert len(result.warnings) == 2 and all("t4.parquet" in text for text in result.warnings)


def moved_alone(tmp_path, channels):
    """Warnings on five trials, in each of which one joint of three moves while the others hardly do."""
    rng = np.random.default_rng(0)
    time = np.arange(0, 10, 0.01)
    joints = {f"j{j}": {channel: f"{channel}{j}" for channel in channels} for j in range(3)}
    for moving in range(5):
        table = {"t": time}
        for j in range(3):
            size = 1.0 if j == moving % 3 else 0.01
            made = {"position": np.sin(time), "velocity": np.cos(time), "effort": 20 * np.sin(time)}
            table |= {f"{n}{j}": size * made[n] + 1e-4 * rng.normal(size=len(time)) for n in channels}
        write_csv(tmp_path / f"t{moving}.csv", table)
    content = {"format": "hqpipe-log-map/1", "clock": {"field": "t"}, "joints": joints}
    return run(tmp_path, tmp_path, content=content).warnings


@pytest.mark.parametrize("channels", [("position",), ("position", "effort"), ("position", "velocity", "effort")])
def test_joints_that_move_one_at_a_time_are_in_no_other_unit(tmp_path, channels):
    assert moved_alone(tmp_path, channels) == ()


@pytest.mark.parametrize(("factor", "warned"), [(1.0, 0), (180 / np.pi, 1)])
def test_a_joint_that_turns_further_by_its_own_velocity_is_in_no_other_unit(tmp_path, factor, warned):
    time = np.arange(0, 10, 0.01)
    for seed in range(5):
        turns = 40.0 if seed == 4 else 1.0
        angle, speed = turns * np.sin(0.3 * time + seed), 0.3 * turns * np.cos(0.3 * time + seed)
        table = {"t": time, "q": angle * (factor if seed == 4 else 1.0), "v": speed}
        write_csv(tmp_path / f"t{seed}.csv", table)
    joints = {"shaft": {"position": "q", "velocity": "v"}}
    result = run(tmp_path, tmp_path, content={"format": "hqpipe-log-map/1", "clock": {"field": "t"}, "joints": joints})
    assert sum("position" in text for text in result.warnings) == warned


def test_a_position_is_the_integral_of_a_recorded_speed(tmp_path):
    time = np.arange(0, 10, 0.01)
    for seed in range(2):
        speed = 60.0 * np.cos(time + seed)
        rows = [
            f"{t!r},{'' if i == 50 else repr(v)}"
            for i, (t, v) in enumerate(zip(time.tolist(), speed.tolist(), strict=True))
        ]
        (tmp_path / f"t{seed}.csv").write_text("\n".join(["t,n", *rows]))
    joints = {
        "shaft": {
            "position": {"field": "n", "unit": "rpm", "integral": True},
            "velocity": {"field": "n", "unit": "rpm"},
        }
    }
    content = {"format": "hqpipe-log-map/1", "clock": {"field": "t"}, "joints": joints}
    result = run(tmp_path, tmp_path, content=content)
    assert any("is the integral of 'n'" in note for note in result.notes())
    first = ParquetReader.read(tmp_path / "out" / "t0.parquet").columns["joint/shaft/position"]
    wanted = 2 * np.pi * np.sin(time)
    present = np.arange(len(time)) != 50
    np.testing.assert_allclose(first[present], wanted[present], atol=1e-3)
    assert np.isnan(first[50])


def test_a_position_that_starts_again_after_a_turn_is_joined(tmp_path):
    time = np.arange(0, 10, 0.01)
    for seed in range(2):
        angle = 0.4 * 360 * time + 30.0 * seed
        write_csv(tmp_path / f"t{seed}.csv", {"t": time, "q": np.mod(angle, 360), "goal": np.mod(angle + 20, 360)})
    joints = {
        "shaft": {"position": {"field": "q", "unit": "deg"}, "position_command": {"field": "goal", "unit": "deg"}}
    }
    content = {"format": "hqpipe-log-map/1", "clock": {"field": "t"}, "joints": joints}
    result = run(tmp_path, tmp_path, content=content)
    assert any("starts again after a turn: joined to one motion" in note for note in result.notes())
    first = read_log_set(tmp_path / "out").trials[0].trajectory
    np.testing.assert_allclose(first.position[:, 0], np.deg2rad(0.4 * 360 * time), atol=1e-5)
    np.testing.assert_allclose(first.position_command[:, 0], np.deg2rad(0.4 * 360 * time + 20), atol=1e-5)
    with pytest.raises(ImportLogError, match="starts again after a turn"):
        (tmp_path / "strict").mkdir()
        for seed in range(2):
            (tmp_path / f"t{seed}.csv").rename(tmp_path / "strict" / f"t{seed}.csv")
        run(tmp_path / "strict", tmp_path / "strict" / "t0.csv", content=content, strict=True)


def test_a_position_that_starts_again_at_the_end_of_its_encoder_is_joined(tmp_path):
    time = np.arange(0, 20, 0.01)
    angle = 40.0 * np.sin(0.7 * time)
    for seed in range(2):
        table = {"t": time, "q": np.mod(angle + seed + 12.5, 25.0) - 12.5, "goal": angle + seed + 0.2}
        write_csv(tmp_path / f"t{seed}.csv", table)
    joints = {
        "shaft": {"position": {"field": "q", "unit": "rad"}, "position_command": {"field": "goal", "unit": "rad"}}
    }
    content = {"format": "hqpipe-log-map/1", "clock": {"field": "t"}, "joints": joints}
    result = run(tmp_path, tmp_path, content=content)
    assert any("joint/shaft/position starts again after 25 rad: joined" in note for note in result.notes())
    first = read_log_set(tmp_path / "out").trials[0].trajectory
    np.testing.assert_allclose(first.position[:, 0], angle, atol=0.01)
    np.testing.assert_allclose(first.position_command[:, 0], angle + 0.2, atol=0.01)


def test_sums_zeros_and_the_first_field_that_exists(tmp_path):
    known = machine()
    time, q, target = (known[n] for n in ("time", "joint/hip/position", "joint/hip/position_command"))
    table = {
        "t": time,
        "pos": q * 100.0,
        "err": (target - q) * 100.0,
        "u_new": 7.0 + 2.0 * np.cos(time),
        "count": q * 4096,
    }
    np.savez(tmp_path / "a.npz", **table)
    np.savez(tmp_path / "b.npz", **{("u" if name == "u_new" else name): values + 0.0 for name, values in table.items()})
    joint = {
        "position": {"field": "pos", "unit": "cm"},
        "position_command": {"sum": [{"field": "pos", "unit": "cm"}, {"field": "err", "unit": "cm"}], "offset": 0.5},
        "valve_command": {"field": ["u_new", "u"], "zero": 7.0, "scale": 0.5, "sign": -1},
    }
    other = {"other/turns": {"field": "count", "unit": "counts", "counts_per_turn": 4096}}
    content = {"format": "hqpipe-log-map/1", "clock": {"field": "t"}, "joints": {"rod": joint}, "shared": other}
    run(tmp_path, tmp_path / "a.npz", tmp_path / "b.npz", content=content)
    for file in ("a.parquet", "b.parquet"):
        found = ParquetReader.read(tmp_path / "out" / file).columns
        np.testing.assert_allclose(found["joint/rod/position"], q, atol=1e-6)
        np.testing.assert_allclose(found["joint/rod/position_command"], target + 0.5, atol=1e-6)
        np.testing.assert_allclose(found["joint/rod/valve_command"], -np.cos(time), atol=1e-6)
        np.testing.assert_allclose(found["other/turns"], 2 * np.pi * q, atol=1e-5)


def test_the_unit_that_the_file_states_counts_where_the_mapping_is_silent(tmp_path):
    known = machine()
    text = "t [ms];q [deg]\n" + "\n".join(
        f"{1e3 * t!r};{np.degrees(q)!r}".replace("np.float64(", "").replace(")", "")
        for t, q in zip(known["time"].tolist(), known["joint/hip/position"].tolist(), strict=True)
    )
    (tmp_path / "a.csv").write_text(text)
    content = {"format": "hqpipe-log-map/1", "clock": {"field": "t [ms]"}, "joints": {"hip": {"position": "q [deg]"}}}
    result = run(tmp_path, tmp_path / "a.csv", content=content)
    found = ParquetReader.read(tmp_path / "out" / result.trials[0].file).columns
    np.testing.assert_allclose(
        found["joint/hip/position"], known["joint/hip/position"][: len(found["time"])], atol=1e-6
    )
    assert result.trials[0].rate_hz == pytest.approx(200.0) and "deg: q [deg]" in " ".join(result.trials[0].notes)


def test_the_same_import_gives_the_same_bytes(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write_csv(tmp_path / name / "a.csv", as_recorded(machine()))
        run(tmp_path / name, tmp_path / name / "a.csv")
    first, second = ({p.name: p.read_bytes() for p in (tmp_path / n / "out").iterdir()} for n in ("one", "two"))
    assert first == second
