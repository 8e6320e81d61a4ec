"""The closed loop with a scripted trot as the policy and the simulator, with a known actuator, as the machine."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.stiff_pd import StiffPD
from hqpipe.errors import UsageError
from hqpipe.rl import gait
from hqpipe.rl.closed_loop import LoggedWalk, body_velocity, closed_loop, policy_walker
from hqpipe.rl.networks import LocomotionNetworks
from hqpipe.rl.policy_io import save_policy
from hqpipe.rl.walk_statistics import Walk
from hqpipe.sim.world import BatchedWorld

SECONDS, SETTLING_S = 5.0, 1.0
SPEEDS = (0.4, 0.8)


class ScriptedTrot:
    """Open-loop trot of the policy's prior."""

    period_s = 0.01

    def __init__(self, spec, hold) -> None:
        self.rule, self.phase, self.hold = spec.target_rule(), 0.0, hold

    def __call__(self, frame, command):
        wanted = np.array([[command[name] for name in ("vx", "vy", "wz")]])
        targets = self.rule.unclipped(np.zeros((1, 12)), gait.clock(np.array([self.phase])), wanted)
        self.phase = float(gait.advance(np.array(self.phase), 1.7, self.period_s))
        return self.rule.clipped(targets)[0]


def record(robot, actuator, spec, speed: float) -> Walk:
    """A log: an own loop of the simulator at 1 kHz from its nominal pose."""
    trot = ScriptedTrot(spec, None)
    rows = {name: [] for name in ("position_command", "position", "velocity", "effort", "body_velocity")}
    with BatchedWorld(robot, actuator, 1, engine="mujoco", workers=1, decimation=1) as world:
        s = world.state
        for tick in range(round(1000 * SECONDS)):
            if tick % 10 == 0:
                targets = trot(None, {"vx": speed, "vy": 0.0, "wz": 0.0})
            seen = (targets, s.joint_position[0], s.joint_velocity[0], s.joint_effort[0])
            body = body_velocity(s.base_orientation, s.base_linear_velocity, s.base_angular_velocity)[0]
            for values, value in zip(rows.values(), (*seen, body), strict=True):
                values.append(np.array(value))
            world.step(targets[None])
    return Walk(1000.0, **{name: np.array(values) for name, values in rows.items()})


@pytest.fixture(scope="module")
def soft(robot):
    return StiffPD.build(robot.joints, kp=3000.0, kd=120.0, effort_limit=900.0)


@pytest.fixture(scope="module")
def logged(robot, actuator, spec):
    walks = {f"walk {speed}": record(robot, actuator, spec, speed) for speed in SPEEDS}
    return [LoggedWalk(name, walk, vx) for (name, walk), vx in zip(walks.items(), SPEEDS, strict=True)]


@pytest.fixture(scope="module")
def result(robot, actuator, soft, spec, logged):
    models = {"before": soft, "after": actuator}
    return closed_loop(lambda hold: ScriptedTrot(spec, hold), robot, models, logged, settling_s=SETTLING_S)


def test_the_machine_s_own_model_comes_as_near_as_the_machine_itself(result):
    """The soft one does not: it follows its targets worse and with other torques."""
    before, after = (result.pooled(name) for name in ("before", "after"))
    for key in ("tracking_gap", "torque_distance", "spectral_distance", "speed_gap"):
        assert after[key] < 0.2 * before[key], key
    assert after["torque_distance"] < result.log.torque_distance.mean()
    assert before["tracking_rmse"] > 1.3 * after["tracking_rmse"]


def test_figures_are_those_of_the_arrays(result, logged):
    steady = [trial.walk.section(SETTLING_S, SECONDS) for trial in logged]
    error = np.concatenate([walk.position_command - walk.position for walk in steady])
    np.testing.assert_allclose(result.log.tracking_rmse, np.sqrt((error**2).mean(axis=0)), rtol=1e-12)
    effort = np.sort(np.concatenate([walk.effort for walk in steady]), axis=0)
    np.testing.assert_allclose(result.log.torque_quantiles[2], np.median(effort, axis=0))
    assert result.log.seconds == pytest.approx(len(SPEEDS) * (SECONDS - SETTLING_S))
    np.testing.assert_allclose(result.log.body_velocity[:, 0], SPEEDS, atol=0.15)
    assert (result.log.walks, result.log.falls, result.models["after"].falls) == (2, 0, 0)


def test_it_goes_into_a_file(result):
    raw = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert raw["trials"] == ["walk 0.4", "walk 0.8"] and len(raw["joints"]) == 12
    assert np.shape(raw["models"]["before"]["torque_quantiles"]) == (5, 12)
    assert np.shape(raw["log"]["band_power"]) == (6, 12)
    assert raw["models"]["after"]["pooled"] == result.pooled("after")


def test_a_model_that_cannot_stand_falls_and_has_no_figures(robot, spec, logged):
    limp = StiffPD.build(robot.joints, kp=[1.0, 6000.0, 6000.0] * 4, kd=20.0, effort_limit=900.0)
    outcome = closed_loop(
        lambda hold: ScriptedTrot(spec, hold), robot, {"limp": limp}, logged[:1], settling_s=SETTLING_S
    )
    figures = outcome.models["limp"]
    assert figures.falls == figures.walks == 1 and figures.seconds == 0.0
    assert set(outcome.pooled("limp").values()) == {None}
    json.dumps(outcome.to_dict(), allow_nan=False)


def test_neither_workers_nor_the_other_walks_matter(robot, actuator, soft, spec, logged):
    def run(trials, workers):
        return closed_loop(
            lambda hold: ScriptedTrot(spec, hold), robot, {"soft": soft}, trials, workers=workers, settling_s=SETTLING_S
        ).models["soft"]

    both, alone = run(logged, 2), run(logged[1:], 1)
    np.testing.assert_array_equal(both.body_velocity[1], alone.body_velocity[0])


def test_the_heading_is_held_where_the_log_s_operator_held_it(robot, actuator, spec, logged):
    holds = []

    def make(hold):
        holds.append(hold)
        return ScriptedTrot(spec, hold)

    turning = LoggedWalk("turn", logged[0].walk, 0.4, wz=0.0)
    closed_loop(make, robot, {"m": actuator}, [logged[0], turning], settling_s=SETTLING_S)
    assert holds[0] is not None and holds[1] is None


def test_a_policy_folder_walks(robot, spec, actuator, logged, tmp_path):
    import torch

    torch.manual_seed(0)
    save_policy(tmp_path, spec, LocomotionNetworks(spec))
    walker = policy_walker(tmp_path, robot.joints)(None)
    position = np.array(robot.nominal_position)
    frame = SimpleNamespace(q=position, qd=np.zeros(12), gyro=np.zeros(3), orientation=np.array([0.0, 0.0, 0.0, 1.0]))
    targets = walker(frame, {"vx": 0.0, "vy": 0.0, "wz": 0.0})
    assert targets.shape == (12,) and walker.period_s == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda walk: walk.section(0.0, 2.0), "lasts 2.0 s, expected at least 5 s"),
        (lambda walk: Walk(1000.0, *(getattr(walk, n)[:, :3] for n in CHANNELS)), "3 joints, expected those of"),
    ],
)
def test_useless_walks_are_named(robot, actuator, spec, logged, change, words):
    wrong = LoggedWalk("short", change(logged[0].walk), 0.4)
    with pytest.raises(UsageError, match=f"short.*{words}"):
        closed_loop(lambda hold: ScriptedTrot(spec, hold), robot, {"m": actuator}, [wrong], settling_s=SETTLING_S)


CHANNELS = ("position_command", "position", "velocity", "effort")


def test_a_model_of_another_rate_is_refused(robot, spec, logged):
    model = Hydraulic.build(
        robot.joints, dt=0.0025, k1=1e5, k2=0.1, k3=4e3, k4=0.0, sprocket_radius=0.06, effort_limit=900.0
    )
    with pytest.raises(UsageError, match=r"per sample of 0\.0025 s"):
        closed_loop(lambda hold: ScriptedTrot(spec, hold), robot, {"m": model}, logged, settling_s=SETTLING_S)
