"""What a cylinder was built with is recovered from its positions: asymmetry, deadband, dead time, a pump that sags."""

from __future__ import annotations

import numpy as np
import pytest
from cylinder_truth import AREA_A, FULL_SPEED, HELD, SUPPLY, log_set, strokes
from fitting import fitted

from hqpipe.layers.valve import Valve

DT = 0.01
NOISE = 5e-5  # m, of the position


def joint(levels=(0.15, 1.0), pause=0.0, hold=(0.3, 1.2), **machine):
    commands = [strokes(40.0, DT, 1, levels, pause, hold), strokes(20.0, DT, 2, levels, pause, hold)]
    (model,) = Valve().joints(log_set(commands, DT, noise=NOISE, **machine)).models
    return model


def test_a_plain_cylinder_leaves_no_more_than_the_noise_and_the_lag_of_its_spool():
    model = joint()
    values, (fit, heldout) = fitted(model)
    assert model.unit == "m" and model.noise[0] == pytest.approx(NOISE, rel=0.2)
    assert values["gain"] == pytest.approx(FULL_SPEED, rel=0.01)
    assert values["neutral"] == pytest.approx(0.0, abs=2e-3)
    assert max(fit, heldout) < 1.4 * model.noise[0]


def test_an_asymmetry_of_1_4_is_recovered_between_rests_at_the_end_stops():
    model = joint(levels=(0.4, 1.0), hold=(1.5, 5.0), area_ratio=1.4**2)
    values, (fit, _) = fitted(model, "direction_asymmetry")
    assert (1.0 + values["ratio"]) / (1.0 - values["ratio"]) == pytest.approx(1.4, rel=0.01)
    assert fit < 1.4 * model.noise[0]
    assert any("end stop" in note for note in model.notes)


def test_the_asymmetry_of_a_cylinder_that_is_held_out_most_of_the_time():
    command = np.tile(np.concatenate([np.full(400, 0.8), np.full(300, -0.8)]), 6)
    (model,) = Valve().joints(log_set([command, command], DT, noise=NOISE, area_ratio=1.4**2)).models
    values, _ = fitted(model, "direction_asymmetry")
    gains = values["gain"] * np.array([1.0 + values["ratio"], 1.0 - values["ratio"]])
    speeds = gains * (np.array([0.8, 0.8]) + np.array([-1.0, 1.0]) * values["neutral"])
    assert speeds == pytest.approx(0.8 * FULL_SPEED * np.array([1.0, 1.0 / 1.4]), rel=0.01)


def test_a_deadband_round_a_neutral_point_off_zero():
    model = joint(levels=(0.1, 0.8), pause=0.4, overlap=0.12, neutral=0.3)
    values, (fit, heldout) = fitted(model, "valve_deadband")
    assert values["half_width"] == pytest.approx(0.12, rel=0.03)
    assert values["neutral"] == pytest.approx(0.3, abs=3e-3)
    assert max(fit, heldout) < 1.4 * model.noise[0]


def test_a_dead_time_to_half_a_sample():
    values, _ = fitted(joint(delay=0.04), "command_delay")
    spool = 5e-3
    total = values["delay_s"] + values["row_offset_s"]
    assert total == pytest.approx(0.04 + spool, abs=0.5 * DT)
    assert values["delay_s"] == pytest.approx(0.04, abs=1.6 * DT)  # the row that the command belongs to is not known


def test_a_supply_that_sags_with_the_flow_of_the_only_joint():
    values, (fit, _) = fitted(joint(droop=0.4), "supply_droop", "valve_lag")
    assert values["droop"] == pytest.approx(0.4 / FULL_SPEED, rel=0.1)
    assert values["recovery_s"] == pytest.approx(0.15, rel=0.15)
    assert fit < 1.5 * NOISE


def test_a_logged_supply_pressure_says_by_itself_what_it_costs():
    model = joint(droop=0.4, gauge=True)
    values, (fit, _) = fitted(model, "supply_droop", "valve_lag")
    assert [p.name for e in model.effects for p in e.parameters if e.name == "supply_droop"] == ["droop"]
    assert values["droop"] == pytest.approx(1.0, rel=0.05)
    assert fit < 1.5 * NOISE


def test_a_weight_makes_the_direction_count():
    model = joint(weight=6000.0)
    values, _ = fitted(model, "direction_asymmetry")
    up, down = (SUPPLY * AREA_A - 6000.0) ** 0.5, (SUPPLY * AREA_A + 6000.0) ** 0.5
    assert values["ratio"] == pytest.approx((up - down) / (up + down), rel=0.02)


def test_orifice_flow_under_a_logged_load():
    model = joint(spring=6e4)
    values, (fit, _) = fitted(model, "orifice_flow")
    assert values["effort_max_nm"] == pytest.approx(SUPPLY * AREA_A, rel=0.03)
    assert fit < 1.5 * NOISE


def test_four_effects_at_once():
    model = joint((0.2, 1.0), 0.3, (0.3, 3.0), area_ratio=1.96, overlap=0.1, delay=0.03, neutral=-0.1)
    values, (fit, heldout) = fitted(model, "direction_asymmetry", "valve_deadband", "command_delay", "valve_lag")
    assert values["ratio"] == pytest.approx(1.0 / 6.0, rel=0.03)
    assert values["half_width"] == pytest.approx(0.1, rel=0.03)
    assert max(fit, heldout) < 1.4 * model.noise[0]


def test_a_load_on_unequal_areas_stops_each_direction_at_its_own_force():
    model = joint(spring=6e4, area_ratio=1.5)
    values, (fit, _) = fitted(model, "orifice_flow", "direction_asymmetry")
    assert values["effort_max_nm"] == pytest.approx(SUPPLY * AREA_A, rel=0.03)
    assert values["area_ratio"] == pytest.approx(1.0 / 1.5, rel=0.05)
    assert fit < 1.5 * NOISE


def test_a_counterbalance_valve_takes_the_load_out_of_lowering():
    pilot = 5.0
    model = joint(spring=1.2e4, weight=9e3, pilot=pilot)
    with_it, (fit, _) = fitted(model, "orifice_flow", "direction_asymmetry", "counterbalance")
    _, (without, _) = fitted(model, "orifice_flow", "direction_asymmetry")
    # lowering, v² ∝ p − (setting − load/A)/(R + 1): how it depends on the load, beside how lifting does
    metered = SUPPLY - 1.3 * HELD / AREA_A / (pilot + 1.0)
    dependence = SUPPLY / metered / (pilot + 1.0)
    assert (1.0 - with_it["load_relief"]) / with_it["area_ratio"] == pytest.approx(dependence, abs=0.05)
    assert with_it["effort_max_nm"] == pytest.approx(SUPPLY * AREA_A, rel=0.05)
    assert fit < 1.5 * NOISE < without


def test_a_speed_limit_of_one_direction():
    values, (fit, _) = fitted(joint(lowest=-0.6 * FULL_SPEED), "one_way_speed_limit")
    assert values["speed_limit"] == pytest.approx(-0.6 * FULL_SPEED, rel=0.01)
    assert fit < 1.5 * NOISE


@pytest.mark.parametrize("apart", [0.04, -0.04])
def test_dead_times_that_differ_by_direction(apart):
    model = joint(delay=0.03, apart=apart)
    values, (fit, _) = fitted(model, "command_delay", "dead_time_asymmetry", "valve_lag")
    _, (without, _) = fitted(model, "command_delay", "valve_lag")
    assert values["difference_s"] == pytest.approx(apart, abs=2e-3)
    assert fit < 0.2 * without


def test_a_jump_at_the_edge_of_the_deadband():
    model = joint(levels=(0.1, 0.6), hold=(0.2, 0.5), overlap=0.2, jump=0.4)
    values, (fit, _) = fitted(model, "valve_deadband", "opening_jump")
    assert values["half_width"] == pytest.approx(0.2, rel=0.05)
    at_edge, at_most = 0.4 * 0.8, 0.4 * 0.8 + 0.6 * 0.4  # of the opening at the command 1; the largest command is 0.6
    assert values["jump"] == pytest.approx(at_edge / at_most, rel=0.05)
    assert fit < 0.3 * fitted(model, "valve_deadband")[1][0]


def test_a_lag_before_and_behind_the_edges():
    for where in ("spool_s", "behind_s"):
        model = joint(levels=(0.1, 0.8), overlap=0.15, **{where: 0.08})
        values, (fit, _) = fitted(model, "valve_deadband", "valve_lag")
        assert values["time_constant_s"] == pytest.approx(0.08, rel=0.1), where
        assert values["behind_edges"] == pytest.approx(float(where == "behind_s"), abs=0.1), where
        assert fit < 2.0 * NOISE, where


def test_a_loaded_cylinder_creeps_while_its_valve_is_closed():
    leak = 2e-7  # m/s per N
    model = joint(levels=(0.25, 0.8), pause=2.0, hold=(0.2, 0.6), overlap=0.15, spring=1.2e4, weight=9e3, leak=leak)
    values, (fit, _) = fitted(model, "valve_deadband", "orifice_flow", "leakage")
    assert values["speed_per_effort"] == pytest.approx(leak, rel=0.05)
    assert values["half_width"] == pytest.approx(0.15, rel=0.03)
    assert fit < 1.5 * NOISE
    assert "leakage" not in {e.name for e in joint(levels=(0.25, 0.8), pause=2.0, overlap=0.15).effects}
