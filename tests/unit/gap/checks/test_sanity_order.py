"""Rows out of order and repeated samples are found; sound logs of the plant and of real machines are not accused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken, log_set, plant_logs, real, recorded, rows, values

from hqpipe.gap.checks.sanity_order import held_share, order_defects
from hqpipe.logs.differentiate import differentiate
from hqpipe.logs.trajectory import Trajectory

RNG = np.random.default_rng(0)


def permuted(samples):
    return np.random.default_rng(1).permutation(samples)


def jumbled(width):
    return lambda samples: np.argsort(np.arange(samples) + np.random.default_rng(2).uniform(0, width, samples))


def in_blocks(samples):
    blocks = np.array_split(np.arange(samples), 8)
    return np.concatenate([blocks[i] for i in (3, 0, 6, 1, 7, 2, 5, 4)])


def every(step):
    return lambda samples: np.arange(samples) // step * step


@pytest.mark.parametrize("source", ["pressure", "load_cell"])
def test_sound_logs_are_in_order(source):
    assert order_defects(plant_logs((0, 1), source)) == []


@pytest.mark.parametrize("name", ["emps", "so101"])
def test_real_logs_are_in_order(name):
    assert order_defects(real(name)) == []


@pytest.mark.parametrize("index", [permuted, in_blocks, jumbled(3), jumbled(10)], ids=["all", "blocks", "3", "10"])
@pytest.mark.parametrize("only", [None, [1]], ids=["every trial", "one trial"])
def test_rows_out_of_order(index, only):
    (found,) = order_defects(broken(plant_logs(), rows(index), only))
    assert (found.kind, found.channel, found.fatal) == ("rows_out_of_order", None, True)
    assert found.trials == (("t0.parquet", "t1.parquet") if only is None else ("t1.parquet",))


@pytest.mark.parametrize("channel", ["position", "velocity", "effort", "position_command"])
def test_one_channel_out_of_order(channel):
    (found,) = order_defects(broken(plant_logs(), rows(permuted, channel)))
    assert (found.kind, found.channel, len(found.joints)) == ("rows_out_of_order", channel, 12)


@pytest.mark.parametrize("channel", ["position", "effort", "position_command"])
def test_real_log_put_out_of_order(channel):
    logs = real("emps")
    assert any(d.channel is None for d in order_defects(broken(logs, rows(permuted))))
    assert [d.channel for d in order_defects(broken(logs, rows(permuted, channel)))] == [channel]


def test_a_joint_at_rest_shows_noise_and_no_disorder():
    t = recorded(0)
    noise = 1e-5 * RNG.standard_normal((t.samples, 12))
    still = replace(
        t,
        position=t.position[:1] + noise,
        velocity=np.gradient(noise, t.dt, axis=0),
        position_command=np.repeat(t.position_command[:1], t.samples, axis=0),
        effort=t.effort[:1] + RNG.standard_normal((t.samples, 12)),
        pressure_a=None,
        pressure_b=None,
        valve_command=None,
    )
    assert order_defects(log_set([still, still])) == []


def test_commanded_noise_is_no_disorder():
    """A random command that the joint follows, one value a sample."""
    t = recorded(0)
    noise = 0.3 * np.random.default_rng(3).standard_normal((t.samples, 1))
    position = np.cumsum(noise, axis=0) * 0.02
    driven = replace(
        t.for_joints(("LFR",)),
        position=position,
        velocity=np.gradient(position, t.dt, axis=0),
        position_command=noise,
        effort=100.0 * position,
        pressure_a=None,
        pressure_b=None,
        valve_command=None,
    )
    assert not any(d.channel == "position_command" for d in order_defects(log_set([driven, driven])))


def test_repeated_samples_are_told_with_their_share():
    found = order_defects(broken(plant_logs(), rows(every(5), "effort")))
    assert [(d.kind, d.channel, d.fatal) for d in found] == [("held_samples", "effort", True)]
    share = float(found[0].message.split("%")[0].split()[-1])
    assert 70.0 < share < 81.0  # of 80: turning points are left out


def test_few_lost_frames_are_no_reason_to_stop():
    def one_in_fifty(samples):
        lost = np.random.default_rng(4).random(samples) < 0.02
        lost[0] = False
        return np.maximum.accumulate(np.where(lost, 0, np.arange(samples)))

    found = order_defects(broken(plant_logs(), rows(one_in_fifty)))
    assert found and {d.kind for d in found} == {"held_samples"}
    assert not any(d.fatal for d in found)


def test_a_sticking_joint_does_not_hold_samples():
    time = np.arange(4000) * 1e-3
    position = np.maximum(np.sin(2 * np.pi * time), 0.0)[:, None]
    assert held_share(np.round(position / 1e-4) * 1e-4) == 0.0


def test_wrong_velocity_is_not_taken_for_disorder():
    logs = plant_logs()
    for change in (np.abs, lambda v: 0.0 * v, lambda v: 57.3 * v, lambda v: -v):
        assert order_defects(broken(logs, values("velocity", change))) == []


def test_a_torque_that_changes_faster_than_it_is_logged_is_in_order():
    """It resembles no sample before it, but follows the motion of its own joint; shuffled, it follows nothing."""
    t = recorded(0)
    size = t.effort.std(axis=0)
    noisy = size * np.random.default_rng(5).standard_normal(t.effort.shape)
    speed = np.gradient(t.position, t.dt, axis=0)
    alone = replace(t, pressure_a=None, pressure_b=None, valve_command=None)
    follows = replace(alone, effort=noisy + 0.2 * size * speed / speed.std(axis=0))
    assert order_defects(log_set([follows])) == []
    assert {d.kind for d in order_defects(log_set([replace(alone, effort=noisy)]))} == {"rows_out_of_order"}


def test_too_few_rows_say_nothing_about_their_order():
    t = replace(recorded(0), pressure_a=None, pressure_b=None)
    assert order_defects(log_set([rows(permuted, "effort")(t)])) != []
    assert order_defects(log_set([rows(permuted, "effort")(t.section(0, 200))])) == []


@pytest.mark.parametrize("rate", [20, 50])
def test_a_slow_log_of_few_moving_joints_does_not_step_backwards(rate):
    """Three joints of which one moves at a time, the speed taken from their positions, as slow machines are logged."""
    time = np.arange(0.0, 120.0, 1.0 / rate)
    turn = np.floor(time / 4.0) % 3
    speed = np.stack([(turn == j) * 0.01 * np.sin(2 * np.pi * (0.1 + 0.02 * j) * time) for j in range(3)], axis=1)
    noise = 2e-4 * np.random.default_rng(5).standard_normal(speed.shape)
    position = np.cumsum(speed, axis=0) / rate + (speed != 0) * noise
    velocity = differentiate(position, 1.0 / rate)
    slow = Trajectory(time, ("a", "b", "c"), position, velocity, velocity_source="differentiated")
    assert order_defects(log_set([slow, slow])) == []
