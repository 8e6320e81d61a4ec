"""collect: 1 kHz logs of the machine – walks of a policy, gantry trials that need none, and stress trials beside them."""

from __future__ import annotations

from typing import Any

from hqpipe.errors import HqpipeError
from hqpipe.pipeline.config import StageParams
from hqpipe.stages.inputs.bounds import StressSeconds, TrialSeconds
from hqpipe.stages.inputs.logs import STRESS
from hqpipe.stages.inputs.plant_overrides import Plant
from hqpipe.stages.walks.stress import stress_jobs, write_stress

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
    stress_seconds: length of a stress trial, s; 0 records none.
    shortest_seconds: a walk that falls sooner is of no use, s.
    plant: what is different on this machine, see `hqpipe.plant.PlantConfig`.
    """

    walk_seconds: TrialSeconds = 20.0
    gantry_seconds: TrialSeconds = 20.0
    stress_seconds: StressSeconds = 5.0
    shortest_seconds: TrialSeconds = 2.0
    plant: Plant = {}


def run(context: Any) -> dict[str, Any]:
    from hqpipe.robots import load_robot
    from hqpipe.stages.output.figures import draw_distribution, draw_walk
    from hqpipe.stages.walks.machine import run_jobs

    policy = context.inputs["policy"]
    policy = policy / "position" if (policy / "position").is_dir() else policy
    jobs, stress = _jobs(context), _stress_jobs(context)
    everything = run_jobs(
        [*jobs, *stress], context.robot, policy, context.params.plant, context.workers, context.progress
    )
    trials, stressed = everything[: len(jobs)], everything[len(jobs) :]
    robot = load_robot(context.robot)
    header = {
        "robot": robot.name,
        "base": "floating",
        "control_mode": trials[0].control_mode,
        "effort_source": trials[0].effort_source,
        "rate_hz": trials[0].rate_hz,
        "clock_source": "firmware tick",
        "urdf_sha256": robot.hash,
    }
    walks = _write(context, jobs, trials, header)
    draw_walk(context.output, _SHOWN, trials[[job.name for job in jobs].index(_SHOWN)].columns, context.robot)
    if stress:
        write_stress(context.output, stress, stressed, **header)
        logs = {"walking": [t for t in trials if t.base == "floating"], STRESS: stressed}
        draw_distribution(context.output, {name: [t.columns for t in each] for name, each in logs.items()}, robot)
    falls = sum(walk["fell"] for walk in walks.values())
    seconds = sum(len(trial.time) / trial.rate_hz for trial in trials)
    speeds = ", ".join(f"{walks[name]['speed']:.2f}" for name in ("walk_04", "walk_10_a"))
    return {
        "headline": (
            f"{seconds:.0f} s in {len(trials)} trials, {speeds} m/s at 0.4, 1.0; {falls} of {len(walks)} walks fell"
        ),
        "seconds": seconds,
        "walks": walks,
        STRESS: {
            job.name: {"seconds": len(t.time) / t.rate_hz, "fell": t.fell}
            for job, t in zip(stress, stressed, strict=True)
        },
    }


def _write(context: Any, jobs: list[Any], trials: list[Any], header: dict[str, Any]) -> dict[str, Any]:
    """Write the log set that models are fitted to and judged on; returns name → what became of each walk."""
    from hqpipe.logs.writer import LogSetWriter
    from hqpipe.rl.walk_columns import walk_course

    splits = {name: split for name, _, split in (*_WALKS, *_GANTRY)}
    walks = {}
    with LogSetWriter(context.output, **header) as writer:
        for job, trial in zip(jobs, trials, strict=True):
            command = None
            if job.excitation is None:
                walk = {**walk_course(trial.columns, (job.vx, job.vy, 0.0)), "fell": trial.fell}
                walks[job.name] = _checked(job, walk, context.params.shortest_seconds)
                command = {"vx": job.vx, "vy": 0.0, "wz": 0.0}
            writer.add(f"{job.name}.parquet", trial.columns, split=splits[job.name], command=command, base=trial.base)
    return walks


def _jobs(context: Any) -> list[Any]:
    from hqpipe.stages.walks.machine import Job

    base = 1000 * context.seed  # every trial has noise, and every walk a start, of its own
    seconds = context.params.walk_seconds
    jobs = [Job(name, seconds, base + i, vx=vx, repeat=True) for i, (name, vx, _) in enumerate(_WALKS)]
    for i, (name, kind, _) in enumerate(_GANTRY, start=len(jobs)):
        jobs.append(Job(name, context.params.gantry_seconds, base + i, excitation=kind))
    return jobs


def _stress_jobs(context: Any) -> list[Any]:
    if context.params.stress_seconds == 0.0:
        return []
    # Seeds apart from those of the walks, and below those of validate.
    return stress_jobs(context.params.stress_seconds, 1000 * context.seed + 100)


def _checked(job: Any, walk: dict[str, Any], shortest: float) -> dict[str, Any]:
    if walk["seconds"] < shortest and walk["fell"]:
        raise HqpipeError(
            f"the policy fell after {walk['seconds']:.1f} s of {job.name}, expected at least {shortest:g} s: train it "
            "longer (--set bootstrap.position.total_steps=…), or pass another with --policy"
        )
    return walk
