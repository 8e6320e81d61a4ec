"""Worker processes: failures are told, and nobody stays behind."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hqpipe.errors import ConfigError, HqpipeError
from hqpipe.sim.world import BatchedWorld

PARENT = """
import os, sys, time
from hqpipe.actuators.stiff_pd import StiffPD
from hqpipe.robots import load_robot
from hqpipe.sim.world import BatchedWorld
robot = load_robot("hydraulic_quadruped")
actuator = StiffPD.build(robot.joints, kp=100.0, kd=1.0, effort_limit=900.0)
world = BatchedWorld(robot, actuator, 16, workers=2)
print(*(process.pid for process in world._team._processes), flush=True)
time.sleep(60)
"""


def alive(pid: int) -> bool:
    """Whether a process runs; a zombie that its new parent has not collected yet is gone."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] != "Z"


def wait_until_gone(pids: list[int]) -> None:
    deadline = time.monotonic() + 20.0
    while any(alive(pid) for pid in pids):
        assert time.monotonic() < deadline, "a worker stayed behind"
        time.sleep(0.05)


def pids_of(world: BatchedWorld) -> list[int]:
    return [process.pid for process in world._team._processes]


def test_close_ends_the_workers(make_world):
    world = make_world(16, workers=2)
    pids = pids_of(world)
    assert len(pids) == 2 and all(alive(pid) for pid in pids)
    world.close()
    assert not any(alive(pid) for pid in pids)


def test_a_forgotten_world_ends_its_workers(robot, stiff):
    world = BatchedWorld(robot, stiff, 16, workers=2)
    pids = pids_of(world)
    del world
    wait_until_gone(pids)


def test_a_killed_worker_is_reported_and_the_world_stays_unusable(make_world, robot):
    world = make_world(16, workers=2)
    targets = np.tile(robot.nominal_position, (16, 1))
    world.step(targets)
    os.kill(pids_of(world)[1], signal.SIGKILL)
    with pytest.raises(HqpipeError, match="worker 2 of 2 failed: it ended with exit code -9"):
        world.step(targets)
    with pytest.raises(HqpipeError, match="make a new BatchedWorld"):
        world.step(targets)


def test_workers_do_not_outlive_a_killed_parent():
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True) as parent:
        pids = [int(pid) for pid in parent.stdout.readline().split()]
        assert len(pids) == 2 and all(alive(pid) for pid in pids)
        parent.kill()
    wait_until_gone(pids)


def test_workers_leave_ctrl_c_to_the_parent(make_world, robot):
    world = make_world(16, workers=2)
    for pid in pids_of(world):
        os.kill(pid, signal.SIGINT)
    state = world.step(np.tile(robot.nominal_position, (16, 1)))
    assert np.isfinite(state.base_position).all()


def test_an_error_in_a_worker_carries_its_message(robot, stiff):
    wrong = replace(robot, feet=("LF", "RF", "LH", "XX"))
    with pytest.raises(HqpipeError, match="no link 'XX_foot'"):
        BatchedWorld(wrong, stiff, 16, workers=2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"feet": ("LF", "RF", "LH", "XX")}, "no link 'XX_foot'"),
        ({"base_link": "body"}, "'body'"),
    ],
)
def test_a_robot_that_does_not_fit_its_urdf_is_refused(engine, robot, stiff, change, message):
    with pytest.raises(ConfigError, match=message):
        BatchedWorld(replace(robot, **change), stiff, 1, engine=engine, workers=1)


def test_a_starting_worker_ends_with_its_parent_though_its_socket_is_open():
    ours, theirs = socket.socketpair()
    pipe, end = os.pipe()
    inherited = (theirs.fileno(), theirs.fileno(), pipe)
    command = [sys.executable, "-m", "hqpipe.sim", *map(str, inherited)]
    with ours, theirs, subprocess.Popen(command, pass_fds=inherited) as worker:
        os.close(pipe)
        os.close(end)
        assert worker.wait(60) in (1, -signal.SIGIO)
