from __future__ import annotations

import numpy as np
import pytest
import torch

from hqpipe.rl.config import GaitConfig
from hqpipe.rl.gait import Trot, advance, clock, leg_offsets, scheduled_stance
from hqpipe.rl.leg import read_leg_geometry

WEIGHT = 3114.0
PHASES = np.arange(200) / 200.0


@pytest.fixture(scope="module")
def trot(robot) -> Trot:
    config = GaitConfig(lead_s=0.0)
    return Trot.build(
        config,
        read_leg_geometry(robot),
        robot.feet,
        robot.nominal_position,
        stiffness=np.full(12, 5000.0),
        weight=WEIGHT,
    )


def cycle(trot: Trot, command: list[float]) -> np.ndarray:
    """(200, 4, 3) foot targets over one cycle."""
    phases = (PHASES[:, None] + trot.offsets) % 1.0
    return trot.foot_targets(phases, np.tile(command, (len(PHASES), 1)))


def stance_rows(trot: Trot) -> list[slice]:
    """For each leg, rows of `cycle` well inside its stance."""
    starts = [0 if offset == 0.0 else 100 for offset in trot.offsets]
    return [slice(start + 10, start + 80) for start in starts]


def test_clock_runs_once_per_period():
    phase = np.zeros(2)
    for _ in range(50):
        phase = advance(phase, 2.0, 0.01)
    np.testing.assert_allclose(np.minimum(phase, 1.0 - phase), 0.0, atol=1e-9)
    np.testing.assert_allclose(clock(np.array(0.25)), [1.0, 0.0], atol=1e-12)


def test_diagonal_legs_move_together(robot):
    offsets = dict(zip(robot.feet, leg_offsets(robot.feet), strict=True))
    assert offsets["LF"] == offsets["RH"] and offsets["RF"] == offsets["LH"]
    assert abs(offsets["LF"] - offsets["RF"]) == 0.5


def test_duty_is_the_share_on_the_ground(robot):
    stance = scheduled_stance(PHASES, leg_offsets(robot.feet), 0.6)
    np.testing.assert_allclose(stance.mean(axis=0), 0.6, atol=0.01)


def test_stance_feet_move_back_at_the_commanded_speed(trot):
    feet = cycle(trot, [0.8, 0.0, 0.0])
    dt = (PHASES[1] - PHASES[0]) / trot.config.frequency_hz
    speed = np.diff(feet[:, 0, 0]) / dt
    inside = PHASES[1:] < trot.config.duty
    np.testing.assert_allclose(speed[inside], -0.8, atol=1e-6)
    assert feet[PHASES < trot.config.duty, 0, 2].max() == pytest.approx(trot.nominal_foot[0, 2])


def test_foot_path_is_closed_and_smooth(trot):
    feet = cycle(trot, [1.0, 0.2, 0.3])
    jumps = np.abs(np.diff(np.concatenate([feet, feet[:1]]), axis=0))
    assert jumps.max() < 0.02
    assert (feet[:, :, 2].max(axis=0) - trot.nominal_foot[:, 2]).min() == pytest.approx(0.14, abs=1e-3)


def test_turning_left_moves_the_right_feet_back(trot):
    feet = cycle(trot, [0.0, 0.0, 0.5])
    stroke = np.ptp(feet[..., 0], axis=0)
    np.testing.assert_allclose(stroke, stroke[0])
    in_stance = np.array([np.diff(feet[phase_rows, i, 0]).mean() for i, phase_rows in enumerate(stance_rows(trot))])
    assert (np.sign(in_stance) == [1, -1, 1, -1]).all()  # left feet go forward, right feet back: the body turns left


def test_standing_command_stands(trot, robot):
    for phase in (0.0, 0.3, 0.8):
        targets = trot.joint_targets(clock(np.array([phase])), np.zeros((1, 3)))[0].reshape(4, 3)
        sag = WEIGHT / 4 / 5000.0 * trot.geometry.support(robot.nominal_position.reshape(4, 3))
        np.testing.assert_allclose(targets - sag, robot.nominal_position.reshape(4, 3), atol=1e-5)


def test_loads_sum_to_the_weight_and_leave_swinging_legs(trot):
    phases = (PHASES[:, None] + trot.offsets) % 1.0
    share = trot.load_share(phases, np.tile([1.0, 0.0, 0.0], (len(PHASES), 1)))
    np.testing.assert_allclose(share.sum(axis=1), 1.0)
    assert share[phases > trot.config.duty].max() < 0.05
    assert share[(phases > 0.2) & (phases < 0.4)].min() > 0.4


def test_lead_shifts_the_cycle(trot, robot):
    from dataclasses import replace

    lead = 0.05
    ahead = replace(trot, config=replace(trot.config, lead_s=lead))
    command = np.array([[0.6, 0.1, 0.0]])
    shifted = clock(np.array([0.2 + lead * trot.config.frequency_hz]))
    np.testing.assert_allclose(
        ahead.joint_targets(clock(np.array([0.2])), command), trot.joint_targets(shifted, command), atol=1e-9
    )


def test_torch_agrees_with_numpy(trot):
    rng = np.random.default_rng(1)
    command = rng.uniform(-0.5, 1.0, (200, 3)).astype(np.float32)
    seen = clock(PHASES).astype(np.float32)
    in_torch = trot.joint_targets(torch.as_tensor(seen), torch.as_tensor(command), torch).numpy()
    np.testing.assert_allclose(in_torch, trot.joint_targets(seen, command), atol=5e-5)
