"""Machines of one hydraulic joint, written as log sets and diagnosed from end to end with the whole library."""

from __future__ import annotations

import pytest
from single_joint_truth import LIMITED_PUMP, WEAK_SUPPLY, Machine, write_logs

from hqpipe.gap.diagnosis import diagnose

SHORT = {"seconds": 6.0, "trials": 3}
ROD = {"area_b": 3.2e-4}
FLOW_PER_SPEED = Machine().area_a * Machine().lever  # m³/s per rad/s
DROOP = FLOW_PER_SPEED / WEAK_SUPPLY["pump_slope"] / (Machine().pressure - Machine().tank)  # s/rad


def answer(folder, mode="position", without=(), **kwargs):
    return diagnose(write_logs(folder, mode, **SHORT, **kwargs), without=without).content


def names(content):
    return {cause["effect"] for cause in content["causes"]}


def number(content, effect, parameter):
    (cause,) = [c for c in content["causes"] if c["effect"] == effect]
    return cause["parameters"][parameter]["value"]


def late_as_the_spool(content):
    """Names of what is late, if each is the spool's lag or lists it as alike."""
    late = [c for c in content["causes"] if c["effect"] in ("valve_lag", "valve_delay", "command_delay")]
    return {c["effect"] for c in late if "valve_lag" in (c["effect"], *c["confused_with"])}


def near_the_floor(content):
    """Within twice the sensor's noise, or 3 % of what the torque changes by in a window: the valve is no exact model of any."""
    gap = content["gap"]
    return content["verdict"] == "explained" and gap["after"] < max(2.0 * gap["noise_floor"], 0.03 * gap["persistence"])


@pytest.mark.parametrize("mode", ["position", "torque"])
def test_the_supply_of_one_joint_sags(tmp_path, mode):
    content = answer(tmp_path, mode, **WEAK_SUPPLY)
    assert near_the_floor(content)
    assert {"supply_droop", "orifice_flow"} <= names(content)
    assert not {"torque_bias", "viscous_friction", "flow_saturation"} & names(content)
    if mode == "position":  # in torque mode it is the share of the pressure that is lost at usual speeds
        assert number(content, "supply_droop", "droop") == pytest.approx(
            DROOP, rel=0.3
        )  # the speed is not all of the flow
    assert number(content, "supply_droop", "recovery_s") == pytest.approx(0.15, rel=0.3)


@pytest.mark.parametrize("seed", [2, 4])
def test_short_logs_of_a_sagging_supply_get_no_wrong_name(tmp_path, seed):
    """One trial of 6 s to fit: the supply may stay unnamed, but nothing else takes its place; what is late is the spool, or may
    be it."""
    content = diagnose(write_logs(tmp_path, seconds=6.0, trials=2, seed=seed, **WEAK_SUPPLY)).content
    assert "orifice_flow" in names(content)
    assert names(content) <= {"orifice_flow", "supply_droop", *late_as_the_spool(content)}


def test_sag_beside_overlap(tmp_path):
    content = answer(tmp_path, overlap=0.03, **WEAK_SUPPLY)
    assert near_the_floor(content)
    assert {"supply_droop", "valve_deadband"} <= names(content)
    wanted = 0.03 / Machine().position_gain
    assert number(content, "valve_deadband", "half_width") == pytest.approx(wanted, rel=0.05)


def test_a_pump_that_gives_all_it_can(tmp_path):
    content = answer(tmp_path, **LIMITED_PUMP)
    assert content["verdict"] == "explained" and "supply_droop" in names(content)
    wanted = LIMITED_PUMP["pump_flow"] / FLOW_PER_SPEED
    assert number(content, "supply_droop", "pump_velocity_rad_s") == pytest.approx(wanted, rel=0.25)


def test_without_the_right_name_the_gap_is_not_called_explained(tmp_path):
    content = answer(tmp_path, without=["supply_droop"], **LIMITED_PUMP)
    assert content["gap"]["after"] > 2.0 * content["gap"]["noise_floor"]
    assert content["verdict"] in ("partly_explained", "unknown")


def test_a_rod_on_one_side_is_no_offset_of_the_torque_sensor(tmp_path):
    content = answer(tmp_path, **ROD)
    assert near_the_floor(content)
    assert {"direction_asymmetry", "orifice_flow"} <= names(content)
    assert not {"torque_bias", "supply_droop"} & names(content)
    areas = (Machine().area_a - ROD["area_b"]) / (Machine().area_a + ROD["area_b"])
    assert number(content, "direction_asymmetry", "areas") == pytest.approx(areas, rel=0.15)


def test_a_force_loop_on_unequal_areas_shows_them_in_the_effort_at_which_the_flow_stops(tmp_path):
    content = answer(tmp_path, "torque", **ROD)
    assert near_the_floor(content)
    assert {"direction_asymmetry", "orifice_flow"} <= names(content) and "supply_droop" not in names(content)
    machine = Machine(**ROD)
    stall = machine.lever * (machine.pressure - machine.tank) * machine.area_a
    assert number(content, "orifice_flow", "effort_max_nm") == pytest.approx(stall, rel=0.15)
    assert number(content, "orifice_flow", "area_ratio") == pytest.approx(machine.area_b / machine.area_a, rel=0.15)


def test_a_valve_that_passes_more_one_way_has_equal_areas(tmp_path):
    content = answer(tmp_path, extending=1.3)
    assert near_the_floor(content)
    assert number(content, "direction_asymmetry", "ratio") == pytest.approx(0.3 / 2.3, rel=0.15)
    assert abs(number(content, "direction_asymmetry", "areas")) < 0.05


@pytest.mark.parametrize("mode", ["position", "torque"])
def test_delay(tmp_path, mode):
    content = answer(tmp_path, mode, delay=0.006)
    assert near_the_floor(content) and "command_delay" in names(content)
    assert not {"supply_droop", "direction_asymmetry", "torque_bias"} & names(content)
    assert 0.0055 < number(content, "command_delay", "delay_s") < 0.009  # alone, or with the spool's lag of 2 ms in it


def test_a_stiff_supply_is_no_cause(tmp_path):
    content = answer(tmp_path)
    assert near_the_floor(content)
    assert not {"supply_droop", "direction_asymmetry", "torque_bias", "command_delay"} & names(content)


def test_rests_at_the_stops_make_no_cause(tmp_path):
    content = answer(tmp_path, at_stops=True)
    assert near_the_floor(content)
    assert names(content) <= {"orifice_flow", "position_bias", *late_as_the_spool(content)}
