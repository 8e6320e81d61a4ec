"""The design of a joint from the entries of robot.yaml, worked out by hand."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from identify.small_logs import log_set, trajectory

from hqpipe.identify.constants.robot_design import designs_at, joint_design

FILE = {
    "fluid": {"bulk_modulus": 1e9},
    "cylinder": {"area_a": 1e-3, "area_b": 1e-3, "stroke": 0.1, "dead_volume_a": 5e-5, "dead_volume_b": 5e-5},
    "valve": {"null_opening": 0.03, "damping_ratio": 0.5, "bandwidth_hz": 100.0, "delay": 1e-3},
    "firmware": {"position_pid": {"kp": 2.0}},
    "supply": {"pressure": 2e7, "return_pressure": 1e6},
}
ERROR = np.array([0.02, -0.02, 10.0])  # rad; openings 0.04, 0.04 and all there is


def test_posture_moves_oil_from_one_chamber_to_the_other():
    design = joint_design(FILE, 0.05, 0.2, ERROR)
    assert (design.volume_a, design.volume_b) == pytest.approx((1.1e-4, 0.9e-4))
    assert design.pressure == pytest.approx(1.9e7)


def test_opening_and_lag_of_the_valve():
    design = joint_design(FILE, 0.05, 0.0, ERROR)
    assert design.opening == pytest.approx((0.05 + 0.05 + np.hypot(1.0, 0.03)) / 3.0)
    assert design.valve_delay == pytest.approx(1.0 / (2.0 * np.pi * 100.0) + 1e-3)


def test_unequal_areas_and_what_is_missing_are_not_known():
    unequal = copy.deepcopy(FILE)
    unequal["cylinder"]["area_b"] = 0.8e-3
    design = joint_design(unequal, 0.05, 0.0, ERROR)
    assert np.isnan([design.area, design.volume_a, design.swept, design.leakage, design.valve_gain]).all()
    assert design.gain == 2.0


@pytest.mark.parametrize(("mode", "known"), [("position", True), (None, True), ("torque", False)])
def test_only_position_control_opens_the_valve_by_the_position_error(mode, known):
    logs = log_set(trajectory(), splits=["fit"], control_mode=mode)
    found = designs_at(logs, FILE, {"hip": 0.05}, {"hip": 0.0})
    assert found["knee"].radius == 1.0 and np.isnan(found["knee"].area), "a joint of another machine"
    assert np.isfinite([found["hip"].gain, found["hip"].opening]).all() == known
    assert found["hip"].area == 1e-3
