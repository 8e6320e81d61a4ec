"""A process that trains two controllers side by side: ``python compare_parent.py FOLDER`` says when both are training."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

from hqpipe.actuators.stiff_pd import StiffPD
from hqpipe.errors import DivergedError
from hqpipe.pipeline.tasks import Tasks
from hqpipe.robots import load_robot, robot_folder
from hqpipe.stages.compare import Params
from hqpipe.stages.comparison.controllers import Controller
from hqpipe.stages.comparison.train import train_all

TRAINING = {
    "total_steps": 80,
    "num_envs": 4,
    "engine": "mujoco",
    "checkpoint_interval": 1,
    "episode_s": 0.2,
    "policy": {"hidden": [8]},
    "ppo": {"n_steps": 10, "batch_size": 20, "n_epochs": 1, "critic_warmup": 1},
    "evaluation": {"num_envs": 2, "seconds": 0.1, "interval": 1, "commands": [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]},
}
ROBOT = "hydraulic_quadruped"


class Diverging(StiffPD):
    """A model in which every training diverges."""

    NAME = "diverging"

    @classmethod
    def of(cls, model: StiffPD) -> Diverging:
        return cls(model.joints, model.parameters)

    def for_joints(self, joints: tuple[str, ...]) -> StiffPD:
        error = DivergedError("the training diverged")
        error.rows = [{"step": 1}]
        raise error


def context(folder: Path, workers: int, progress, **training) -> SimpleNamespace:
    """What `train_all` needs of a stage's context."""
    params = Params(training={**TRAINING, **training})
    tasks = Tasks(folder, {})
    return SimpleNamespace(params=params, tasks=tasks, robot=robot_folder(ROBOT), workers=workers, progress=progress)


def controllers() -> list[Controller]:
    from hqpipe.rl.worlds import unmodelled_actuator

    robot = load_robot(ROBOT)
    modes = {"torque": "torque", "stiff_pd": "position"}
    return [Controller(name, mode, unmodelled_actuator(robot, mode)) for name, mode in modes.items()]


def main() -> None:
    seen = set()

    def progress(done: float, total: float, note: str) -> None:
        seen.add(note.split(",")[0])
        if len(seen) == 2:
            print("training", flush=True)

    long = context(Path(sys.argv[1]), 2, progress, total_steps=40_000_000)
    train_all(long, controllers(), [1], long.progress)


if __name__ == "__main__":
    main()
