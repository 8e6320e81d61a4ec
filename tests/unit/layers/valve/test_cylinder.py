"""What a cylinder was built with is recovered from its positions: asymmetry, deadband, dead time, a pump that sags."""

from __future__ import annotations

import numpy as np
import pytest
from cylinder_truth import AREA_A, FULL_SPEED, SUPPLY, log_set, strokes
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
