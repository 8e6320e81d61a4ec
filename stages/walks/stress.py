"""The stress trials of collect: what the actuators meet in training and careful logs of walking do not hold.

The paper's Fig. 5 shows that in training, with its falls and impacts, torque and command oppose each other far more widely
than in logs of the machine. These trials record such moments on the plant. They lie in a log set of their own, `stress/`
beside the walks, all of it held out: models are judged on it and nothing is fitted to it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hqpipe.stages.inputs.logs import STRESS
from hqpipe.stages.walks.machine import Job

DROP = 0.25  # m above the ground; the feet meet it at 2.2 m/s
PUSHES = (
    (0.3, (0.0, 150.0, 0.0)),
    (0.65, (250.0, 0.0, 0.0)),
)  # share of the trial; N·s, which the robot mostly withstands
FALLING_PUSH = (0.25, (0.0, 900.0, 0.0))  # 317 kg move sideways at 2.8 m/s after it: no step catches that
DRAG = (3000.0, 400.0)  # N·m/rad, N·m: dragged to the command ahead of the actuators; assumption: below their 950 N·m
FORCE = (-3000.0, 500.0)  # N·m/rad, N·m: forced away from the command; assumption likewise
DRAGGED = 0.7  # share of the trial in which they are dragged; then they are forced away
WALKING = 0.4  # m/s


def stress_jobs(seconds: float, seed: int) -> list[Job]:
    """The stress trials, each `seconds` long; `seed` is that of the first."""
    from hqpipe.plant import Grip, Push

    switch = DRAGGED * seconds
    pushes = tuple(Push(share * seconds, impulse) for share, impulse in PUSHES)
    fall = (Push(FALLING_PUSH[0] * seconds, FALLING_PUSH[1]),)
    grips = (Grip(0.0, switch, *DRAG), Grip(switch, seconds - switch, *FORCE))
    how: list[dict[str, Any]] = [
        {"name": "drop", "clearance": DROP},
        {"name": "push", "vx": WALKING, "disturbances": pushes},
        {"name": "fall", "vx": WALKING, "disturbances": fall},
        {"name": "collapse", "postures": "collapse"},
        {"name": "against", "excitation": "multisine", "disturbances": grips},
        {"name": "jumps", "postures": "jumps"},
    ]
    return [Job(seconds=seconds, seed=seed + i, stop_at_fall=False, **fields) for i, fields in enumerate(how)]


def write_stress(folder: Path, jobs: list[Job], trials: list[Any], **header: Any) -> None:
    """Write the trials into `folder`/stress; `header` as in `LogSetWriter`."""
    from hqpipe.logs.writer import LogSetWriter

    with LogSetWriter(folder / STRESS, **header) as writer:
        for job, trial in zip(jobs, trials, strict=True):
            writer.add(f"{job.name}.parquet", trial.columns, split="heldout", base=trial.base)
