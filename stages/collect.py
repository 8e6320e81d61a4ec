"""collect: 1 kHz logs of the machine – walks of a policy, and the gantry trial that needs none."""

from __future__ import annotations

from typing import Any

from pydantic import PositiveFloat

from hqpipe.errors import HqpipeError
from hqpipe.pipeline.config import StageParams

# The paper: 20 s at 0.4 m/s to fit; one trial at 0.4 m/s and four at 1.0 m/s to judge (section IV-A).
_WALKS = (
    ("walk_04_fit", 0.4, "fit"),
    ("walk_04", 0.4, "heldout"),
    *((f"walk_10_{letter}", 1.0, "heldout") for letter in "abcd"),
)
_GANTRY = (("gantry_multisine", "multisine", "fit"), ("gantry_chirp", "chirp", "heldout"))
_SHOWN = "walk_10_a"  # in walk.png


class Params(StageParams):
    """Attributes:
    walk_seconds, gantry_seconds: length of a trial, s.
    shortest_seconds: a walk that falls sooner is of no use, s.
    plant: what is different on this machine, see `hqpipe.plant.PlantConfig`.
    """

    walk_seconds: PositiveFloat = 20.0
    gantry_seconds: PositiveFloat = 20.0
    shortest_seconds: PositiveFloat = 2.0
    plant: dict[str, Any] = {}


def run(context: Any) -> dict[str, Any]:
    from hqpipe.logs.writer import LogSetWriter
    from hqpipe.robots import load_robot
    from hqpipe.stages.figures import draw_walk
    from hqpipe.stages.machine import run_jobs, walked

    policy = context.inputs["policy"]
    policy = policy / "position" if (policy / "position").is_dir() else policy
    jobs = _jobs(context)
    trials = run_jobs(jobs, context.robot, policy, context.params.plant, context.workers, context.progress)
    splits = {name: split for name, _, split in (*_WALKS, *_GANTRY)}
    robot, walks = load_robot(context.robot), {}
    with LogSetWriter(
        context.output,
        robot=robot.name,
        base="floating",
        control_mode=trials[0].control_mode,
        effort_source=trials[0].effort_source,
        rate_hz=trials[0].rate_hz,
        clock_source="firmware tick",
        urdf_sha256=robot.hash,
    ) as writer:
        for job, trial in zip(jobs, trials, strict=True):
            command = None
            if job.excitation is None:
                walks[job.name] = _checked(job, walked(trial, job.vx), context.params.shortest_seconds)
                command = {"vx": job.vx, "vy": 0.0, "wz": 0.0}
            writer.add(f"{job.name}.parquet", trial.columns, split=splits[job.name], command=command, base=trial.base)
    draw_walk(context.output, _SHOWN, trials[[job.name for job in jobs].index(_SHOWN)].columns, context.robot)
    falls = sum(walk["fell"] for walk in walks.values())
    seconds = sum(len(trial.time) / trial.rate_hz for trial in trials)
    speeds = ", ".join(f"{walks[name]['speed']:.2f}" for name in ("walk_04", "walk_10_a"))
    return {
        "headline": (
            f"{seconds:.0f} s in {len(trials)} trials, {speeds} m/s at 0.4, 1.0; {falls} of {len(walks)} walks fell"
        ),
        "seconds": seconds,
        "walks": walks,
    }


def _jobs(context: Any) -> list[Any]:
    from hqpipe.stages.machine import Job

    base = 1000 * context.seed  # every trial has noise of its own
    jobs = [Job(name, context.params.walk_seconds, base + i, vx=vx) for i, (name, vx, _) in enumerate(_WALKS)]
    for i, (name, kind, _) in enumerate(_GANTRY, start=len(jobs)):
        jobs.append(Job(name, context.params.gantry_seconds, base + i, excitation=kind))
    return jobs


def _checked(job: Any, walk: dict[str, Any], shortest: float) -> dict[str, Any]:
    if walk["seconds"] < shortest and walk["fell"]:
        raise HqpipeError(
            f"the policy fell after {walk['seconds']:.1f} s of {job.name}, expected at least {shortest:g} s: train it "
            "longer (--set bootstrap.position.total_steps=…), or pass another with --policy"
        )
    return walk
