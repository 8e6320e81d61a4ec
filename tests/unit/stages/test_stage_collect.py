"""The stress trials of collect, without a plant: what is asked of it, and where its answers go."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from hqpipe.errors import LogError
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.writer import LogSetWriter
from hqpipe.plant import Grip, Push
from hqpipe.stages.collect import Params, _jobs, _stress_jobs
from hqpipe.stages.walks.stress import stress_jobs, write_stress


def context(**params) -> SimpleNamespace:
    return SimpleNamespace(params=Params(**params), seed=1)


def test_stress_has_names_and_seeds_of_its_own():
    walks, stress = _jobs(context()), _stress_jobs(context())
    seeds = [job.seed for job in (*walks, *stress)]
    assert len(set(seeds)) == len(seeds) and max(seeds) < 1500, "validate begins there"
    assert len({job.name for job in stress}) == len(stress)
    assert all(job.stop_at_fall and not job.disturbances for job in walks)
    assert all(job.repeat == (job.excitation is None) for job in walks), "no two walks start alike"
    assert not any(job.repeat for job in stress)


def test_a_walk_starts_as_its_seed_says(monkeypatch, tmp_path):
    """Posture, heading, clock and order of the plant's walk; without `repeat` the nominal ones."""
    from hqpipe.plant.repeat import repeat
    from hqpipe.robots import load_robot, robot_folder
    from hqpipe.stages.walks import machine

    folder = robot_folder("hydraulic_quadruped")
    robot = load_robot(folder)
    walkers = []

    def standing(policy, joints, hold):
        def walker(frame, command):
            return robot.nominal_position

        walker.wiring, walker.period_s, walker.phase, walker.hold = (
            SimpleNamespace(control_mode="position"),
            0.01,
            0.0,
            hold,
        )
        walkers.append(walker)
        return walker

    monkeypatch.setattr(machine, "_policy_controller", standing)
    trials = [
        machine.run_job(machine.Job("walk", 0.75, seed, vx=1.0, repeat=again), folder, tmp_path, {})
        for seed, again in ((5, True), (6, True), (5, True), (5, False))
    ]
    first, other, same, plain = (np.stack(list(trial.columns.values())) for trial in trials)
    assert first.tobytes() == same.tobytes()
    knee = "joint/LFK/position"
    assert np.abs(trials[0].columns[knee][0] - trials[1].columns[knee][0]) > 1e-3
    assert [walker.phase for walker in walkers] == [repeat(robot, seed).phase for seed in (5, 6, 5)] + [0.0]
    assert [walker.hold.heading for walker in walkers] == [0.0, 0.0, 0.0, None]
    speeds = [trial.columns["command/vx"] for trial in trials]
    assert speeds[0][0] == 0.0 and (speeds[0] != speeds[1]).any() and (speeds[3] == 1.0).all()


def test_no_seconds_no_stress():
    assert _stress_jobs(context(stress_seconds=0.0)) == []


def test_what_happens_happens_within_the_trial_whatever_its_length():
    for seconds in (2.0, 6.0):
        for job in stress_jobs(seconds, 1):
            assert job.seconds == seconds and not job.stop_at_fall
            assert all(0.0 <= each.start < each.start + each.duration <= seconds for each in job.disturbances)


def test_the_robot_is_dropped_pushed_felled_and_forced():
    jobs = {job.name: job for job in stress_jobs(5.0, 1)}
    assert 0.2 <= jobs["drop"].clearance <= 0.3
    sizes = [np.linalg.norm(push.impulse) for push in jobs["push"].disturbances]
    assert (
        all(isinstance(push, Push) for push in jobs["push"].disturbances)
        and min(sizes) >= 100.0
        and max(sizes) <= 300.0
    )
    assert {np.sign(grip.stiffness) for grip in jobs["against"].disturbances if isinstance(grip, Grip)} == {-1.0, 1.0}
    assert jobs["against"].excitation and jobs["jumps"].postures == "jumps"


def test_stress_lies_beside_the_walks_and_is_held_out(tmp_path):
    time = np.arange(50) * 1e-3
    columns = {"time": time, "joint/LFK/position": np.sin(time), "joint/LFK/effort": np.cos(time)}
    trial = SimpleNamespace(columns=columns, base="floating")
    with LogSetWriter(tmp_path, robot="r") as writer:
        writer.add("walk.parquet", columns)
    jobs = stress_jobs(1.0, 1)[:2]
    write_stress(tmp_path, jobs, [trial, trial], robot="r")
    assert [t.file for t in read_log_set(tmp_path).trials] == ["walk.parquet"]
    inner = read_log_set(tmp_path / "stress", all_heldout=True)
    assert [(t.file, t.split) for t in inner.trials] == [(f"{job.name}.parquet", "heldout") for job in jobs]
    with pytest.raises(LogError, match="none has split: fit"):
        read_log_set(tmp_path / "stress")
