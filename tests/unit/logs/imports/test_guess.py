"""Drafted mappings: what the habits of the field name, and what the values give away."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from foreign_tables import as_recorded, flat, machine

from hqpipe.errors import LogError
from hqpipe.logs.imports.csv_table import CsvReader
from hqpipe.logs.imports.draft_file import draft_text
from hqpipe.logs.imports.guess import draft_map
from hqpipe.logs.imports.guess_names import Meaning, meaning_of
from hqpipe.logs.imports.guess_values import clock_unit
from hqpipe.logs.imports.import_set import import_logs
from hqpipe.logs.imports.mapping import parse_map, read_map
from hqpipe.logs.imports.recording import Recording, Stream
from hqpipe.logs.imports.sources import find_sources
from hqpipe.logs.parquet import ParquetReader

NAMES = {
    "q[3]": Meaning("position", "joint3"),
    "q_3": Meaning("position", "joint3"),
    "q3": Meaning("position", "joint3"),
    "dq1": Meaning("velocity", "joint1"),
    "tau[0]": Meaning("effort", "joint0"),
    "q_des[2]": Meaning("position_command", "joint2"),
    "left_hip_pos": Meaning("position", "left_hip"),
    "pos_left_hip": Meaning("position", "left_hip"),
    "JointState.position/left_hip": Meaning("position", "left_hip"),
    "position/left_hip": Meaning("position", "left_hip"),
    "joint/knee/effort": Meaning("effort", "knee"),
    "Boom Ms": Meaning("position", "Boom"),
    "uart_latency_ms": None,
    "input delay [ms]": None,
    "q_ms": Meaning("position", "q"),
    "Boom Cmd": Meaning("command", "Boom"),
    "Boom Error": Meaning("error", "Boom"),
    "knee setpoint": Meaning("position_command", "knee"),
    "kneeTorque": Meaning("effort", "knee"),
    "pos [deg]": Meaning("position", "", "deg"),
    "angle_deg": Meaning("position", "", "deg"),
    "p_a_bar": Meaning("pressure_a", "", "bar"),
    "knee_pressure_b [bar]": Meaning("pressure_b", "knee", "bar"),
    "t_us": Meaning("clock", "", "us"),
    "timestamp": Meaning("clock"),
    "Time (ms)": Meaning("clock", "", "ms"),
    "p_supply": Meaning("supply/pressure"),
    "oil_temp": Meaning("supply/oil_temperature"),
    "motor_current_2": Meaning("current", "joint2"),
    "valve_cmd": Meaning("valve_command"),
    "tau_command[2]": Meaning("effort_command", "joint2"),
    "knee_tau_des": Meaning("effort_command", "knee"),
    "camera": None,
    "Confidence": None,
}


@pytest.mark.parametrize("name", list(NAMES))
def test_what_a_name_means(name):
    assert meaning_of(name) == NAMES[name]


def draft(fields: dict[str, np.ndarray], units: dict[str, str] | None = None):
    return draft_map(Recording(Path("a.csv"), (Stream("", fields, units or {}),)))


@pytest.mark.parametrize(
    ("values", "unit"),
    [
        (np.arange(1000) * 0.001, "s"),
        (np.arange(1000) * 5.0, "ms"),
        (np.arange(1000) * 1000.0, "us"),
        (np.arange(1000) * 1e6, "ns"),
        (1.7e18 + np.arange(1000) * 1e6, "ns"),
        (1.7e15 + np.arange(1000) * 1e3, "us"),
        (1.7e12 + np.arange(1000), "ms"),
        (1.7e9 + np.arange(1000) * 0.01, "s"),
    ],
)
def test_the_unit_of_a_clock(values, unit):
    assert clock_unit(values)[0] == unit


def test_a_messy_table_in_degrees_bar_and_microseconds(tmp_path):
    """Comment header, units that nobody states, semicolons: the draft imports it as it was."""
    known = machine(samples=2000)
    table = {"t": known["time"] * 1e6}
    for joint in ("hip", "knee"):
        table[f"{joint}_angle"] = np.degrees(known[f"joint/{joint}/position"])
        table[f"{joint}_angle_ref"] = np.degrees(known[f"joint/{joint}/position_command"])
        table[f"{joint}_speed"] = np.degrees(np.gradient(known[f"joint/{joint}/position_command"], 1 / 200.0))
        table[f"{joint}_torque"] = known[f"joint/{joint}/effort"]
        table[f"{joint}_pA"] = known[f"joint/{joint}/pressure_a"] * 1e-5
    table["p_supply"] = known["supply/pressure"] * 1e-5
    table["lamp"] = np.ones(2000)
    path = tmp_path / "rig.csv"
    rows = [";".join(f"{value:.9g}" for value in row) for row in zip(*table.values(), strict=True)]
    path.write_text("\n".join(["# rig 3, operator: nobody", "#" + ";".join(table), *rows]))
    found = draft_map(CsvReader.read(path)[0])
    assert not found.unclear and set(found.left) == {"lamp"}
    text = draft_text(found, path.name)
    map_path = tmp_path / "map.yaml"
    map_path.write_text(text, encoding="utf-8")
    content = yaml.safe_load(text)
    assert content["clock"] == {"field": "t", "unit": "us"} and content["control_mode"] == "position"
    assert (
        content["joints"]["hip"]["velocity"]["unit"] == "deg/s"
        and content["joints"]["hip"]["pressure_a"]["unit"] == "bar"
    )
    assert (
        "times the derivative of the position" in text and "reaches" in text and "lamp: its name says nothing" in text
    )
    result = import_logs(find_sources([path]), read_map(map_path), text, tmp_path / "out")
    columns = ParquetReader.read(tmp_path / "out" / result.trials[0].file).columns
    for name, values in known.items():
        tolerance = 1e-6 * np.abs(values).max()
        np.testing.assert_allclose(columns[name], values[: len(columns["time"])], atol=tolerance, err_msg=name)


def test_arrays_of_joints_become_numbered_joints():
    found = draft(flat(as_recorded(machine())))
    joints = found.content["joints"]
    assert list(joints) == ["joint0", "joint1"]
    assert (
        joints["joint1"]["position"] == {"field": "q[1]", "unit": "rad"}
        or joints["joint1"]["position"]["unit"] == "deg"
    )
    assert (
        found.content["shared"]["supply/pressure"]["unit"] == "bar"
    )  # MPa of 20 look like 20 bar: said in the comment
    parse_map({"format": "hqpipe-log-map/1", **found.content}, Path("map.yaml"))


def test_qd_beside_dq_is_the_desired_position():
    t = np.arange(2000) / 200.0
    q, target = np.sin(4 * t - 0.1), np.sin(4 * t)
    found = draft({"t": t, "q": q, "qd": target, "dq": 4 * np.cos(4 * t - 0.1)})
    (joint,) = found.content["joints"].values()
    assert joint["position_command"]["field"] == "qd" and joint["velocity"]["field"] == "dq"


def test_a_command_that_does_not_follow_the_position_is_the_valve():
    t = np.arange(2000) / 50.0
    opening = np.where(t % 4 < 1, 9.5, np.where((t % 4 > 2) & (t % 4 < 3), 5.5, 7.5))
    stroke = 5.0 + np.cumsum(opening - 7.5) / 50.0
    found = draft({"Time": t, "Boom Ms": stroke, "Boom Cmd": opening, "Boom JS": np.zeros(2000)})
    entry = found.content["joints"]["Boom"]["valve_command"]
    assert entry == {"field": "Boom Cmd", "zero": 7.5, "scale": 0.5} and found.content["control_mode"] == "valve"
    assert "Boom JS" in found.left and "CHECK" in found.reasons[("joints", "Boom", "valve_command")]


@pytest.mark.parametrize("sign", [1, -1])
def test_an_error_beside_the_position_gives_the_target(sign):
    """Only with the right sign does the sensor's noise cancel."""
    t = np.arange(500) / 50.0
    position = np.sin(t - 0.1) + 0.02 * np.random.default_rng(0).normal(size=500)
    found = draft({"Time": t, "Boom Ms": position, "Boom Error": sign * (np.sin(t) - position)})
    parts = found.content["joints"]["Boom"]["position_command"]["sum"]
    assert [part["field"] for part in parts] == ["Boom Ms", "Boom Error"] and parts[1].get("sign", 1) == sign


@pytest.mark.parametrize(
    ("fields", "part"),
    [
        ({"q": np.sin(np.arange(100.0)), "tau": np.cos(np.arange(100.0))}, "which field is the clock"),
        ({"t": np.arange(100.0), "q": np.sin(np.arange(100.0))}, "counts samples"),
        ({"t": np.arange(100) / 50.0, "foo": np.sin(np.arange(100.0))}, "which fields are positions"),
        ({"t": np.arange(100) / 50.0, "q": np.round(9000 * np.sin(np.arange(100.0)))}, "counts_per_turn"),
    ],
)
def test_what_only_a_person_knows_is_asked_for(fields, part):
    found = draft(fields)
    assert part in " ".join(found.unclear) and part in draft_text(found, "a.csv")


def test_a_draft_with_hostile_names_is_still_yaml():
    t = np.arange(200) / 50.0
    names = ["knee: pos", "hip # pos", "a\nb pos", "{x} pos", "'y' pos", "- pos"]
    fields = {"t": t} | {name: np.sin(t + i) for i, name in enumerate(names)}
    found = draft(fields)
    content = yaml.safe_load(draft_text(found, "a\nb.csv"))
    assert {c["position"]["field"] for c in content["joints"].values()} <= set(names)


def test_an_empty_recording_is_no_crash():
    with pytest.raises(LogError):
        parse_map({"format": "hqpipe-log-map/1", **draft({"t": np.arange(5.0)}).content}, Path("map.yaml"))


def test_topics_with_clocks_of_their_own_need_no_clock():
    t = 1.7e9 + np.arange(1000) / 100.0
    streams = (
        Stream("/joint_states", {"position/hip": np.sin(t), "position/knee": np.cos(t)}, time=t),
        Stream("/torques", {"hip effort": np.cos(t[::2]), "knee effort": np.sin(t[::2])}, time=t[::2]),
    )
    found = draft_map(Recording(Path("a.mcap"), streams))
    assert "clock" not in found.content and "clocks" not in found.content and not found.unclear
    log_map = parse_map(yaml.safe_load(draft_text(found, "a.mcap")), Path("map.yaml"))
    assert log_map.sources["joint/knee/effort"].terms[0].names == ("/torques/knee effort",)
    assert log_map.sources["joint/hip/position"].terms[0].names == ("/joint_states/position/hip",)


def test_names_of_another_language_are_asked_for_with_what_their_units_say():
    t = np.arange(100) / 50.0
    found = draft({"Zeit": t, "Winkel": np.sin(t)}, {"Zeit": "s", "Winkel": "°"})
    assert found.content["clock"] == {"field": "Zeit", "unit": "s"} and set(found.left) == {"Winkel", "(no effort)"}
    (question,) = found.unclear
    assert "which fields are positions" in question and "in units of angle or length: Winkel" in question


def arm(**more: np.ndarray) -> dict[str, np.ndarray]:
    """Two joints that follow their targets, and what else was logged."""
    t = np.arange(500) / 50.0
    fields = {"t": t}
    for j in range(2):
        fields |= {f"q[{j}]": np.sin(t + j - 0.05), f"qd[{j}]": np.cos(t + j - 0.05), f"q_cmd[{j}]": np.sin(t + j)}
        fields[f"tau[{j}]"] = np.cos(2 * t + j)
    return fields | more


@pytest.mark.parametrize("point", [{"ee_pos[0]": "position"}, {"ee_pos[0]": "position", "ee_vel[0]": "velocity"}])
def test_a_point_of_the_machine_costs_its_joints_nothing(point):
    found = draft(arm(**{name: np.sin(np.arange(500.0)) for name in point}))
    joints = found.content["joints"]
    assert list(joints) == ["joint0", "joint1"] and set(point) <= set(found.left)
    assert all({"velocity", "effort", "position_command"} <= set(channels) for channels in joints.values())
    assert "'ee0' has only position" in found.left["ee_pos[0]"]


def test_a_time_beside_the_joints_is_none_of_them():
    found = draft(arm(uart_latency_ms=np.abs(200 * np.sin(np.arange(500.0)))))
    assert list(found.content["joints"]) == ["joint0", "joint1"]
    assert found.content["joints"]["joint0"]["position"]["unit"] == "rad"


def test_joints_that_all_have_a_position_alone_stay():
    t = np.arange(500) / 50.0
    assert list(draft({"t": t, "hip_pos": np.sin(t), "knee_pos": np.cos(t)}).content["joints"]) == ["hip", "knee"]


def test_a_command_that_never_changes_is_no_command():
    t = np.arange(2000) / 200.0
    fields = {"t": t, "position": np.sin(4 * t - 0.1), "position_cmd": np.zeros(2000), "torque_cmd": np.cos(4 * t)}
    found = draft(fields)
    assert found.content["control_mode"] == "torque" and "never changes" in found.left["position_cmd"]
    kept = draft_map(Recording(Path("a.csv"), (Stream("", fields, {}),)), still=())  # it changes in another file
    assert kept.content["control_mode"] == "position"


def test_a_command_that_changes_in_one_joint_is_a_command_of_all():
    found = draft(arm(**{"q_cmd[1]": np.zeros(500)}))
    assert found.content["joints"]["joint1"]["position_command"]["field"] == "q_cmd[1]"


def test_plain_commands_of_numbered_joints_are_one_kind():
    fields = {name.replace("q_cmd", "u"): values for name, values in arm().items()}
    assert draft(fields).content["joints"]["joint1"]["position_command"]["field"] == "u[1]"


def test_the_case_of_a_joint_name_does_not_count():
    t = np.arange(500) / 50.0
    found = draft({"t": t, "KNEE_PosFb": np.sin(t), "Knee_Current": np.cos(t)})
    assert found.content["joints"]["KNEE"]["current"]["field"] == "Knee_Current"


def test_a_name_that_begins_with_that_of_the_position_is_of_its_joint():
    t = np.arange(500) / 50.0
    fields = {"t": t} | {f"q{j}{what}": np.sin(t + j) for j in (3, 31) for what in ("", "_tau_J_compensated")}
    joints = draft(fields).content["joints"]
    assert [channels["effort"]["field"] for channels in joints.values()] == [
        "q3_tau_J_compensated",
        "q31_tau_J_compensated",
    ]


def test_a_range_of_less_than_a_turn_in_degrees_is_in_radians():
    t = np.arange(1000) / 50.0
    angle, speed = 40.0 * np.sin(0.7 * t), 28.0 * np.cos(0.7 * t)
    (joint,) = draft({"t": t, "q": np.mod(angle + 12.5, 25.0) - 12.5, "qd": speed}).content["joints"].values()
    assert (joint["position"]["unit"], joint["velocity"]["unit"]) == ("rad", "rad/s")
    (joint,) = draft({"t": t, "q": np.mod(np.rad2deg(angle), 360.0), "qd": speed}).content["joints"].values()
    assert (joint["position"]["unit"], joint["velocity"]["unit"]) == ("deg", "rad/s")
