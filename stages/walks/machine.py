"""The machine under a policy, as collect and validate drive it: trials of the reference plant, in parallel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from hqpipe.system.processes import in_processes

Progress = Callable[[float, float, str], None]
Result = TypeVar("Result")


@dataclass(frozen=True)
class Job:
    """One trial.

    Attributes:
        name: of the trial. seconds: length. seed: of sensor noise and excitation.
        vx, vy: m/s; wz: rad/s; None holds the heading, as an operator steers a robot straight.
        excitation: "multisine" or "chirp" on the gantry, or None for a walk of the policy.
        postures: "jumps" or "collapse" on the floor, instead of a walk.
        clearance: m above the ground that the robot is let go from.
        repeat: whether it is one of several walks under the same order, which start and are steered each in their own way.
        disturbances: `hqpipe.plant.Push` and `hqpipe.plant.Grip`.
        stop_at_fall: whether the trial ends with a fall.
        plant: overrides of `hqpipe.plant.PlantConfig` for this trial alone.
    """

    name: str
    seconds: float
    seed: int
    vx: float = 0.0
    vy: float = 0.0
    wz: float | None = None
    excitation: str | None = None
    postures: str | None = None
    clearance: float = 0.0
    repeat: bool = False
    disturbances: tuple[Any, ...] = ()
    stop_at_fall: bool = True
    plant: Mapping[str, Any] = field(default_factory=dict)


def run_jobs(
    jobs: Sequence[Job],
    robot_folder: Path,
    policy: Path,
    overrides: Mapping[str, Any],
    workers: int,
    progress: Progress,
) -> list[Any]:
    """Run trials in `workers` processes; the result does not depend on their number.

    Args:
        policy: folder with policy.onnx or policy.safetensors. overrides: of `hqpipe.plant.PlantConfig`.

    Returns:
        A `PlantTrial` per job, in order.
    """
    trial = partial(run_job, robot_folder=robot_folder, policy=policy, overrides=overrides)
    return run_each(trial, jobs, workers, progress)


def run_each(task: Callable[[Job], Result], jobs: Sequence[Job], workers: int, progress: Progress) -> list[Result]:
    """`task` of every job, in order; it must be a function of a module, and what it returns is copied between processes."""
    calls = {job.name: (job,) for job in jobs}
    return in_processes(task, calls, workers, lambda done, name: progress(done, len(jobs), name))


def run_job(job: Job, robot_folder: Path, policy: Path, overrides: Mapping[str, Any], record: Any | None = None) -> Any:
    """Run one trial from standing; see `run_jobs`. `record` is an `hqpipe.rl.controller.EstimateLog` to be filled."""
    from hqpipe.plant import Plant, PlantConfig
    from hqpipe.plant.excitation import excitation
    from hqpipe.plant.postures import postures
    from hqpipe.plant.repeat import repeat
    from hqpipe.rl.controller import HeadingHold
    from hqpipe.robots import load_robot

    robot = load_robot(robot_folder)
    base = "floating" if job.excitation is None else "fixed"
    config = PlantConfig(overrides).merged(PlantConfig(job.plant))
    plant = Plant(robot, config, seed=job.seed, base=base)
    hold = HeadingHold(heading=0.0 if job.repeat else None) if job.wz is None else None
    walker = _policy_controller(policy, robot.joints, hold)
    walker.record = record
    if job.clearance > 0.0:
        plant.reset(clearance=job.clearance)
    how: dict[str, Any] = {
        "mode": walker.wiring.control_mode,  # the gantry trial too: a log set has one control mode
        "disturbances": job.disturbances,
        "stop_at_fall": job.stop_at_fall,
    }
    if job.excitation is not None:
        return plant.run(excitation(robot, job.excitation, job.seconds, job.seed), job.seconds, **how)
    if job.postures is not None:
        return plant.run(postures(robot, job.postures, job.seconds), job.seconds, **how)
    order = (job.vx, job.vy, job.wz or 0.0)
    command: Any = dict(zip(("vx", "vy", "wz"), order, strict=True))
    if job.repeat:
        own = repeat(robot, job.seed)
        plant.reset(own.posture, own.heading)
        walker.phase, command = own.phase, own.command(*order)
    return plant.run(walker, job.seconds, command=command, control_period_s=walker.period_s, **how)


def _policy_controller(folder: Path, joints: tuple[str, ...], hold: Any) -> Any:
    from hqpipe.rl.controller import onnx_controller, torch_controller

    load = onnx_controller if (folder / "policy.onnx").is_file() else torch_controller
    return load(folder, joints=joints, heading_hold=hold)
