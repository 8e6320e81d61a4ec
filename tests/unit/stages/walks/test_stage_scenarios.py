"""The trials of a deployed policy: what is asked of the plant, and what comes back from it."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hqpipe.errors import UsageError
from hqpipe.plant import PlantConfig
from hqpipe.robots import RobotSpec, load_robot, robot_folder
from hqpipe.stages.walks import machine
from hqpipe.stages.walks.scenarios import (
    COURSE_M,
    SCENARIOS,
    SETTLING_S,
    _job,
    _measured_walk,
    _pooled,
    check_names,
    run_scenarios,
)

FOLDER = robot_folder("hydraulic_quadruped")


@pytest.fixture(scope="module")
def robot() -> RobotSpec:
    return load_robot(FOLDER)


def job(name: str, seed: int = 1500, longest: float | None = None, **plant):
    return _job(SCENARIOS[name], seed, longest, plant, FOLDER)


def test_the_table_asks_for_what_can_be_done():
    from hqpipe.rl.walk_measures import SETTLING_S as left_out
    from hqpipe.sim.mujoco_body import HFIELD_HALF_SIZE

    assert left_out == SETTLING_S
    for name, scenario in SCENARIOS.items():
        assert scenario.name == name and scenario.seconds > 2.0 * SETTLING_S
        if name.startswith("forward"):
            assert (scenario.seconds - SETTLING_S) * scenario.vx == pytest.approx(COURSE_M, rel=0.01)
        if scenario.bumps:
            assert scenario.seconds * scenario.vx < HFIELD_HALF_SIZE[0], "beyond that there is no ground"


@pytest.mark.parametrize("longest", [None, 5.0])
def test_a_push_acts_within_the_walk_and_after_it_has_settled(longest):
    pushed = {name for name in SCENARIOS if job(name, longest=longest).disturbances}
    assert pushed == {"push_side", "push_forward"}
    for name in pushed:
        one = job(name, longest=longest)
        assert all(0.4 * one.seconds <= push.start < one.seconds - 1.0 for push in one.disturbances)
        assert [np.linalg.norm(push.impulse) for push in one.disturbances] == [100.0, 100.0]


def test_every_seed_walks_over_bumps_of_its_own():
    grounds = [PlantConfig(job("uneven", seed).plant).body_changes().ground for seed in (1500, 1501)]
    assert [ground.roughness for ground in grounds] == [0.05, 0.05]
    assert grounds[0].roughness_seed != grounds[1].roughness_seed


def test_a_scenario_changes_the_machine_that_is_given(robot):
    assert job("low_supply").plant == {"supply": {"pressure": pytest.approx(0.9 * 21.0e6)}}
    weak = job("low_supply", supply={"pressure": 1.0e7, "pump_flow": 1.0e-3})
    assert weak.plant["supply"]["pressure"] == pytest.approx(0.9e7)
    first = PlantConfig({"body": {"payloads": [{"link": "trunk", "mass": 5.0}]}})
    loads = first.merged(PlantConfig(job("payload").plant)).body_changes().payloads
    assert [load.mass for load in loads] == [5.0, 30.0] and loads[1].link == robot.base_link


def test_names_are_checked_before_anything_runs():
    with pytest.raises(UsageError, match="no scenario 'payloads' – did you mean 'payload'"):
        run_scenarios(Path("nowhere"), FOLDER, ["stand", "payloads"], 1, 0, {}, 1, lambda *_: None)
    for wrong in ([], ["stand", "stand"]):
        with pytest.raises(UsageError, match="one scenario or more, each once"):
            check_names(wrong)


class Standing:
    """A stand-in for a policy: holds the nominal pose and believes in a robot that stands still."""

    def __init__(self, robot: RobotSpec) -> None:
        feet = robot.feet
        self.wiring = SimpleNamespace(control_mode="torque")
        self.period_s, self.phase, self.record, self._pose = 0.01, 0.0, None, robot.nominal_position
        self._names = (
            *(f"base_linear_velocity/{axis}" for axis in "xyz"),
            *(f"gravity/{axis}" for axis in "xyz"),
            "base_height/z",
            *(f"foot_contact/{foot}" for foot in feet),
            *(f"foot_height/{foot}" for foot in feet),
        )
        self._belief = np.array([0, 0, 0, 0, 0, -1.0, robot.nominal_height + 0.1, 1, 1, 1, 0, 0, 0, 0, 0])

    def __call__(self, frame, command):
        if self.record is not None:
            self.record.names, self.record.period_s = self._names, self.period_s
            self.record.rows.append(self._belief)
        return self._pose


@pytest.fixture(scope="module")
def stood(robot):
    """A short walk in torque mode, with its columns and without."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(machine, "_policy_controller", lambda policy, joints, hold: Standing(robot))
        short = job("stand", longest=0.8)
        return [_measured_walk(short, FOLDER, Path(), {}, kept) for kept in ((), (short.name,))]


def test_a_walk_comes_back_as_measures_and_with_its_columns_only_if_they_are_wanted(stood, robot):
    (row, nothing), (same, columns) = stood
    assert row == same and nothing is None
    assert len(columns["time"]) == 800
    assert not row["fell"] and row["seed"] == 1500
    assert row["foot_clearance"] is None, "no foot swings"
    assert row["drift"] < 0.05 and row["lean"] < 0.05
    assert 0.2 < row["peak_force"] < 0.6, "four feet carry one weight"
    assert 1.5e7 < row["lowest_supply"] < 2.2e7
    assert row["torque_rmse"] > 0.0 and row["tracking_rmse"] > 0.0
    assert "speed_error" not in row, "nothing was ordered"


def test_beliefs_are_held_against_the_plant(stood, robot):
    row, columns = stood[1]
    wrong = robot.nominal_height + 0.1 - columns["base/position/z"][400::10]  # of every call in the later half
    assert row["estimate_height"] == pytest.approx(np.sqrt(np.mean(wrong**2))), "it believed to be 10 cm higher"
    assert row["estimate_tilt"] < 0.03 and row["estimate_velocity"] < 0.1
    assert row["estimate_contact"] == 0.25, "it believed that one foot hangs"
    assert row["estimate_foot_height"] < 0.005, "the soles are on the ground"


def test_a_fall_is_counted_and_spoils_no_mean():
    rows = [
        {"seed": 1, "fell": False, "speed": 0.98, "speed_error": 0.02, "foot_clearance": 0.10},
        {"seed": 2, "fell": False, "speed": 0.94, "speed_error": 0.06, "foot_clearance": None},
        {"seed": 3, "fell": True, "speed": 0.10, "speed_error": 0.90, "foot_clearance": 0.01},
    ]
    one = _pooled(SCENARIOS["forward_10"], [job("forward_10")], [(row, None) for row in rows])
    assert (one["walks"], one["falls"]) == (3, 1)
    assert one["mean"] == {"speed": 0.96, "speed_error": pytest.approx(0.04), "foot_clearance": 0.10}
    assert one["worst"] == {"speed_error": 0.06, "foot_clearance": 0.10}
    all_fell = _pooled(SCENARIOS["forward_10"], [job("forward_10")], [(rows[2], None)])
    assert all_fell["worst"] == {"speed_error": None, "foot_clearance": None}


@pytest.fixture(scope="module")
def policy(robot, tmp_path_factory):
    """A policy that has learned nothing: its trot."""
    import torch

    from hqpipe.rl.config import TrainConfig, from_mapping
    from hqpipe.rl.networks import LocomotionNetworks
    from hqpipe.rl.policy_io import save_policy
    from hqpipe.rl.policy_spec import PolicySpec
    from hqpipe.rl.worlds import unmodelled_actuator

    config = from_mapping(TrainConfig(num_envs=400), {"policy": {"hidden": [8]}})
    spec, folder = PolicySpec.build(robot, unmodelled_actuator(robot, "position"), config), tmp_path_factory.mktemp("p")
    torch.manual_seed(0)
    save_policy(folder, spec, LocomotionNetworks(spec, 0.01))
    return folder


def test_scenarios_come_back_in_order_whoever_walks_them(policy):
    notes = []
    rows = run_scenarios(
        policy,
        FOLDER,
        ["uneven", "forward_10"],
        2,
        1500,
        {},
        1,
        lambda done, total, note: notes.append((done, total)),
        seconds=0.3,
        shown=("forward_10",),
    )
    assert notes == [(i, 4) for i in range(1, 5)]
    assert [row["scenario"] for row in rows] == ["uneven", "forward_10"]
    assert rows[1].pop("columns")["command/vx"].shape == (300,) and "columns" not in rows[0]
    assert json.loads(json.dumps(rows, allow_nan=False)) == rows
    first, second = rows[1]["seeds"]
    assert (first["seed"], second["seed"]) == (1500, 1501) and first["tracking_rmse"] != second["tracking_rmse"]
    here, _ = _measured_walk(job("forward_10", 1501, 0.3), FOLDER, policy, {}, ())
    assert here == second, "the same walk in another process"
