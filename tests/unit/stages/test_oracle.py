"""The oracle's numbers are the plant's: by the formulas of the design, effect by effect, and by its error on its logs."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from hqpipe.errors import UsageError
from hqpipe.identify.constants.design import chamber_expected
from hqpipe.identify.constants.robot_design import joint_design
from hqpipe.identify.paper_model.fit_actuator import fit_actuator
from hqpipe.logs.trajectory import LogSet, Trial
from hqpipe.robots import load_robot, robot_folder
from hqpipe.stages.compare import Params
from hqpipe.stages.comparison.controllers import Controller, read_controllers
from hqpipe.stages.comparison.model_check import _trial, free_run_errors, without_friction
from hqpipe.stages.comparison.oracle import FRICTION, oracle_actuator

ROBOT = "hydraulic_quadruped"
DT = 1e-3
SOUND = {"valve_delay", "flow_saturation", "valve_lag", "supply_droop", "orifice_flow", *FRICTION}
WORN = {"valve": {"delay": 0.008, "overlap": 0.05, "bandwidth_hz": 20.0}}


@pytest.fixture(scope="module")
def robot():
    return load_robot(ROBOT)


def stage(plant: dict, seed: int = 1) -> SimpleNamespace:
    return SimpleNamespace(params=SimpleNamespace(plant=plant), robot=robot_folder(ROBOT), seed=seed, inputs={})


def test_constants_are_those_of_the_design(robot):
    model = oracle_actuator(robot, {}, DT)
    design = joint_design(robot.hydraulics, 0.06, 0.0, np.zeros(2))
    expected = chamber_expected(design)
    fade = -np.log1p(-model.column("k2")) / DT
    stiffness = model.column("k3") * fade / model.column("k2")
    # Oil under half of the supply is denser by 1 + p/β, which the design leaves out.
    denser = 1.0 + 10.75e6 / 0.7e9
    np.testing.assert_allclose(stiffness, denser * expected["hydraulic stiffness"], rtol=1e-12)
    np.testing.assert_allclose(model.column("k1") / model.column("k3"), expected["flow gain"] / denser, rtol=1e-12)
    np.testing.assert_allclose(fade, 1.0 / expected["leak time constant"], rtol=1e-12)
    np.testing.assert_allclose(1.0 / model.column("orifice_flow_effort_max_nm"), expected["full torque"], rtol=1e-12)
    delay = model.column("valve_lag_time_constant_s") + model.column("valve_delay_delay_s")
    np.testing.assert_allclose(delay, expected["valve time constant"], rtol=1e-12)
    assert np.all(model.column("k4") == 0.0)


@pytest.mark.parametrize(
    ("plant", "effect", "column", "value"),
    [
        ({"firmware": {"command_delay": 0.01}}, "command_delay", "command_delay_delay_s", 0.01),
        ({"valve": {"neutral_offset": 0.05}}, "position_bias", "position_bias_rad", 0.02),
        ({"firmware": {"position_pid": {"ki": 5.0}}}, "integral_action", "integral_action_ki", 2.0),
        ({"valve": {"overlap": 0.05}}, "valve_deadband", "valve_deadband_half_width", 0.02),
        ({"valve": {"asymmetry": 0.1}}, "direction_asymmetry", "direction_asymmetry_ratio", 0.1),
        ({"valve": {"gain_drift": -0.01}}, "gain_drift", "gain_drift_rate_per_s", -0.01),
        ({"fluid": {"heating_rate": 0.5}}, "leakage_drift", "leakage_drift_rate_per_s", 0.015),
        ({"chain": {"slack": 0.003}}, "backlash", "backlash_gap", 0.05),
        ({"cylinder": {"coulomb_friction": 100.0}}, None, "coulomb_friction_friction_nm", 12.0),
        ({"valve": {"opening_limit": 0.5}}, None, "flow_saturation_limit", 5.0),
        ({"valve": {"delay": 0.004}}, None, "valve_delay_delay_s", 0.004),
    ],
)
def test_an_override_of_the_plant_is_its_effect_and_no_other(robot, plant, effect, column, value):
    model = oracle_actuator(robot, plant, DT)
    assert set(model.effects) == SOUND | ({effect} - {None})
    np.testing.assert_allclose(model.column(column), value, rtol=1e-9)


def test_an_override_of_one_joint_is_of_that_joint_and_one_of_a_span_of_none(robot):
    model = oracle_actuator(robot, {"joints": {"LFK": {"valve": {"overlap": 0.05}}}}, DT)
    assert model.effects["valve_deadband"] == ("LFK",)
    passing = oracle_actuator(robot, {"spans": [{"time": [1.0, 2.0], "valve": {"overlap": 0.05}}]}, DT)
    assert "valve_deadband" not in passing.effects


def test_unequal_chambers_make_the_stiffness_hang_on_the_position(robot):
    slope = oracle_actuator(robot, {"cylinder": {"dead_volume_a": 3e-5}}, DT).column(
        "position_dependent_stiffness_slope_per_rad"
    )
    assert np.all(slope < 0.0)  # chamber A is the smaller one, and grows with the position


def test_without_a_position_loop_there_is_no_oracle(robot):
    plant = {"firmware": {"position_pid": {"kp": 0.0}}}
    with pytest.raises(UsageError, match="position loop has no gain"):
        oracle_actuator(robot, plant, DT)
    found, left_out = read_controllers(stage(plant), ["stiff_pd", "oracle"], "strong")
    assert [each.name for each in found] == ["stiff_pd"] and "has no gain" in left_out[0]


def log_set(*trajectories) -> LogSet:
    trials = tuple(Trial(f"t{i}.parquet", "fit", None, t, "fixed") for i, t in enumerate(trajectories))
    head = {"robot": None, "base": "fixed", "control_mode": "position", "effort_source": "pressure", "rate_hz": 1000.0}
    return LogSet(
        path=None, sha256="0" * 64, format="hqpipe-log/1", joints=trajectories[0].joints, trials=trials, **head
    )


@pytest.mark.parametrize(
    "plant", [WORN, {**WORN, "effort_source": "load_cell", "cylinder": {"coulomb_friction": 300.0}}]
)
def test_the_oracle_is_nearer_to_the_plant_than_what_is_fitted_to_its_logs(robot, plant):
    fitted = fit_actuator(log_set(_trial(stage(plant, seed=2))[0]), effort_limit=950.0).model
    oracle = oracle_actuator(robot, plant, DT)
    names = {"fitted": fitted, "oracle": oracle}
    check = free_run_errors(stage(plant), [Controller(name, "position", model) for name, model in names.items()])
    rmse = check["rmse"]
    assert rmse["oracle"] < 0.25 * rmse["fitted"]
    assert rmse["oracle"] < 0.2 * min(check["effort_rms"], check["persistence"])


def test_what_no_log_can_be_replayed_with_has_no_error(robot):
    plant = {"chain": {"slack": 0.003}}
    controllers = [Controller("oracle", "position", oracle_actuator(robot, plant, DT))]
    assert free_run_errors(stage(plant), controllers)["rmse"] == {"oracle": None}


def test_numbers_that_are_known_have_no_spread_in_a_training_unless_one_is_asked_for(robot):
    model = oracle_actuator(robot, {}, DT)
    oracle, fitted = (Controller(name, "position", model) for name in ("oracle", "fitted"))
    usual = Params().training
    sought = Params(training={"randomisation": {"actuator": {"mode": "half_range"}}}).training
    assert fitted.training(usual) == usual and oracle.training(sought) == sought
    changed = oracle.training(usual)
    assert (
        changed["randomisation"]["actuator"]["mode"] == "none" and usual["randomisation"]["actuator"]["mode"] == "auto"
    )
    assert changed["randomisation"]["friction"] == usual["randomisation"]["friction"]


def test_friction_does_not_show_in_pressures(robot):
    model = oracle_actuator(robot, {}, DT)
    assert without_friction(model).to_dict() == oracle_actuator(robot, {}, DT, friction=False).to_dict()
