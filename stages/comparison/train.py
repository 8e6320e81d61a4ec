"""The trainings of compare: each a task of its own, several at a time in processes of their own."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hqpipe.stages.comparison.controllers import Controller
from hqpipe.stages.inputs.training import METRICS, write_rows, write_training
from hqpipe.system import durable
from hqpipe.system.processes import in_processes, tell

REPORT = "report.json"  # among the files of the task only: it holds the speed of the training
# Bytes of a training: libraries and networks, and each simulated robot. Measured: PyBullet 0.29 GB and 5.3 MB, MuJoCo 1.3 MB.
_OWN, _PER_ROBOT = 0.5e9, 6e6
_SHARE = 0.7  # of the memory that trainings side by side may take; assumption
Progress = Callable[[float, float, str], None]


@dataclass(frozen=True, eq=False)
class Trained:
    """One controller under one seed.

    Attributes:
        controller: what was trained. seed: of the training. content: all that decided the result, plain data.
        folder: with the files of `write_training`; metrics.csv alone where the training diverged.
        report: as of `write_training`, with training_s, s; or {"diverged": why}.
    """

    controller: Controller
    seed: int
    content: dict[str, Any]
    folder: Path
    report: dict[str, Any]

    @property
    def diverged(self) -> str | None:
        return self.report.get("diverged")

    @property
    def name(self) -> str:
        """Relative folder among the results, e.g. fitted/seed_1."""
        return f"{self.controller.name}/seed_{self.seed}"


@dataclass(frozen=True, eq=False)
class _Job:
    """One training, and the `hqpipe.pipeline.tasks.Task` that keeps it; robot: its folder; training: a `Training`."""

    controller: Controller
    seed: int
    task: Any
    robot: Path
    training: Mapping[str, Any]

    @property
    def name(self) -> str:
        return f"{self.controller.title}, seed {self.seed}"


def train_all(
    context: Any, controllers: Sequence[Controller], seeds: Sequence[int], progress: Progress
) -> list[Trained]:
    """Every controller under every seed with the budget `context.params.training`; what is there is not trained again.

    With W workers and n trainings to do, min(W, n) run at a time, or as many as fit into memory, and share the workers
    evenly. A result depends neither on that nor on what else is trained.

    Args:
        progress: (done, total, text) in trainings.
    """
    found, jobs, done = [], {}, {}
    for seed in seeds:
        for controller in controllers:
            training = controller.training(context.params.training)
            content = {**controller.content, "training": training, "seed": seed}
            task = context.tasks.find(**content)
            found.append((controller, seed, content, task))
            if task.key not in done:
                done[task.key] = task.is_done()
            if not done[task.key]:
                jobs.setdefault(task.key, _Job(controller, seed, task, context.robot, training))
    _carry_out(list(jobs.values()), len(done), context.workers, progress)
    return [
        Trained(controller, seed, content, task.files, json.loads((task.files / REPORT).read_text(encoding="utf-8")))
        for controller, seed, content, task in found
    ]


def _carry_out(jobs: Sequence[_Job], count: int, workers: int, progress: Progress) -> None:
    """Train what is to be done of `count` trainings."""
    at_once = min(workers, len(jobs), *(fit_into_memory(job.training) for job in jobs[:1]))
    reached = dict.fromkeys((job.name for job in jobs), 0.0)

    def told(name: str, message: tuple[float, str]) -> None:
        reached[name], note = message
        progress(count - len(jobs) + sum(reached.values()), count, f"{name} {note}".strip())

    if at_once > 1:
        calls = {job.name: (job, workers // at_once) for job in jobs}
        in_processes(_train_elsewhere, calls, at_once, told=told)
        return
    for job in jobs:
        _train(job, workers, lambda message, name=job.name: told(name, message))


def fit_into_memory(training: Mapping[str, Any]) -> int:
    """How many trainings with these settings may run at a time, at least 1."""
    from hqpipe.logs.size import memory_bytes

    robots = training["num_envs"] + training["evaluation"]["num_envs"]
    return max(1, int(_SHARE * memory_bytes() / (_OWN + _PER_ROBOT * robots)))


def _train_elsewhere(job: _Job, workers: int) -> None:
    """`_train` in a worker process."""
    _train(job, workers, tell)


def _train(job: _Job, workers: int, told: Callable[[tuple[float, str]], None]) -> None:
    """Train and keep the result; told: called with the share that is done and a note."""
    folder = job.task.begin()
    report = _trained(job, workers, folder, lambda done, total, note: told((done / total, note)))
    (folder / REPORT).write_text(json.dumps(report), encoding="utf-8")
    job.task.finish(folder)
    told((1.0, ""))


def _trained(job: _Job, workers: int, folder: Path, progress: Progress) -> dict[str, Any]:
    from hqpipe.errors import DivergedError
    from hqpipe.rl.config import TrainConfig, from_mapping
    from hqpipe.rl.train import train
    from hqpipe.robots import load_robot

    config = from_mapping(TrainConfig(), {**job.training, "seed": job.seed})
    try:
        result = train(
            load_robot(job.robot),
            job.controller.actuator,
            config,
            control_mode=job.controller.control_mode,
            scratch=job.task.scratch,
            progress=progress,
            workers=workers,
            posterior=job.controller.posterior,
            stiffness=job.controller.stiffness,
        )
    except DivergedError as error:  # an outcome of the comparison, not the end of it
        write_rows(folder / METRICS, error.rows)
        return {"diverged": str(error), "iterations": len(error.rows)}
    report = write_training(folder, result)
    steps = config.iterations * config.rollout_size  # all of it, also where the end alone was timed
    return {**report, "training_s": steps / result.steps_per_second}


def keep(trained: Trained, output: Path) -> None:
    """Copy what belongs into the artifact to `output`/<name>."""
    shutil.copytree(trained.folder, output / trained.name, ignore=shutil.ignore_patterns(REPORT, durable.CHECKSUMS))
