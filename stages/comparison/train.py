"""The trainings of compare, one after the other; a killed stage goes on at the controller and the checkpoint where it was."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hqpipe.stages.comparison.controllers import Controller
from hqpipe.stages.inputs.training import METRICS, write_rows, write_training
from hqpipe.system import durable

REPORT = "report.json"  # in scratch only: it holds the speed of the training
_DONE, _TRAINING = "trained", "training"
Progress = Callable[[float, float, str], None]


@dataclass(frozen=True, eq=False)
class Trained:
    """One controller under one seed.

    Attributes:
        controller: what was trained. seed: of the training.
        folder: with the files of `write_training`; metrics.csv alone where the training diverged.
        report: as of `write_training`, or {"diverged": why}. scratch: folder for what else is made of it.
    """

    controller: Controller
    seed: int
    folder: Path
    report: dict[str, Any]
    scratch: Path

    @property
    def diverged(self) -> str | None:
        return self.report.get("diverged")

    @property
    def name(self) -> str:
        """Relative folder among the results, e.g. fitted/seed_1."""
        return f"{self.controller.name}/seed_{self.seed}"


def train_all(
    context: Any, controllers: Sequence[Controller], seeds: Sequence[int], progress: Progress
) -> list[Trained]:
    """Every controller under every seed with the budget `context.params.training`; those found finished are not trained again.

    Args:
        progress: (done, total, text) in trainings.
    """
    jobs = [(controller, seed) for seed in seeds for controller in controllers]
    found = []
    for number, (controller, seed) in enumerate(jobs):

        def within(done: float, total: float, note: str, number: int = number, title: str = controller.title) -> None:
            progress(number + done / total, len(jobs), f"{title} {note}".strip())

        found.append(_trained(context, controller, seed, within))
    return found


def _trained(context: Any, controller: Controller, seed: int, progress: Progress) -> Trained:
    scratch = context.scratch / controller.name / f"seed_{seed}"
    folder = scratch / _DONE
    durable.remove_leftovers(scratch)
    if wrong := durable.damage(folder):
        if folder.exists():
            print(f"warning: {folder} is damaged ({wrong}): trained again", file=sys.stderr, flush=True)
        fresh = durable.new_folder(folder)
        report = _train(context, controller, seed, scratch / _TRAINING, fresh, progress)
        (fresh / REPORT).write_text(json.dumps(report), encoding="utf-8")
        durable.write_checksums(fresh)
        durable.move_into_place(fresh, folder)
        durable.remove(scratch / _TRAINING)
    report = json.loads((folder / REPORT).read_text(encoding="utf-8"))
    return Trained(controller, seed, folder, report, scratch)


def _train(
    context: Any, controller: Controller, seed: int, checkpoints: Path, folder: Path, progress: Progress
) -> dict[str, Any]:
    from hqpipe.errors import DivergedError
    from hqpipe.rl.config import TrainConfig, from_mapping
    from hqpipe.rl.train import train
    from hqpipe.robots import load_robot

    config = from_mapping(TrainConfig(), {**context.params.training, "seed": seed})
    try:
        result = train(
            load_robot(context.robot),
            controller.actuator,
            config,
            control_mode=controller.control_mode,
            scratch=checkpoints,
            progress=progress,
            workers=context.workers,
            posterior=controller.posterior,
            stiffness=controller.stiffness,
        )
    except DivergedError as error:  # an outcome of the comparison, not the end of it
        write_rows(folder / METRICS, error.rows)
        return {"diverged": str(error), "iterations": len(error.rows)}
    report = write_training(folder, result)
    steps = config.iterations * config.rollout_size
    return {**report, "training_s": steps / result.steps_per_second}


def keep(trained: Trained, output: Path) -> None:
    """Copy what belongs into the artifact to `output`/<name>."""
    shutil.copytree(trained.folder, output / trained.name, ignore=shutil.ignore_patterns(REPORT, durable.CHECKSUMS))
