"""What a stage's ``run(context)`` is given."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hqpipe.pipeline.tasks import Tasks

Progress = Callable[[float, float, str], None]
"""Called as ``progress(done, total, note)``; `done` and `total` in any unit, `note` may be empty."""


@dataclass(frozen=True)
class StageContext:
    """Everything that a stage may read, and where it writes.

    Args:
        params: the stage's validated ``Params``.
        seed: seed of all random numbers of the stage.
        workers: number of processes it may use; must not change the result.
        robot: folder of the robot.
        inputs: input name → folder, verified just before.
        output: empty folder; every file in it becomes the artifact when the stage returns.
        scratch: folder that survives a kill, for checkpoints; removed after the artifact is committed.
        tasks: parts of the work that other runs of the stage may need as well; they outlive the run.
        progress: reports how far the stage is.
    """

    params: Any
    seed: int
    workers: int
    robot: Path
    inputs: Mapping[str, Path]
    output: Path
    scratch: Path
    tasks: Tasks
    progress: Progress
