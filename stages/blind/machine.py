"""The machine of a case: its trials on the reference plant, written as a log set."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hqpipe.errors import HqpipeError

RATE_HZ = 1000.0
NEVER = 12  # gaits that may fall before the case counts as impossible; assumption


def simulate(
    case: Any, robot_folder: Path, folder: Path, leave_out: Sequence[str] = (), gait: int | None = None
) -> int:
    """Write the log set of a case.

    Args:
        case: a `hqpipe.plant.cases.Case`. robot_folder: with robot.yaml. folder: made; must hold no log set.
        leave_out: names of the effects that this machine does not have.
        gait: number of the trots, so that the machine without an effect walks like the one with it; None takes the
            first with which no trial ends in a fall.

    Returns:
        The number of the trots.

    Raises:
        HqpipeError: the machine falls whatever the gait.
    """
    for attempt in range(NEVER) if gait is None else (gait,):
        trials = _trials(case, robot_folder, leave_out, attempt)
        if trials is not None:
            _write(case, robot_folder, folder, trials)
            return attempt
    raise HqpipeError(f"{case.name}: the machine falls with every gait that was tried; choose another --seed")


def _trials(case: Any, robot_folder: Path, leave_out: Sequence[str], gait: int) -> list[Any] | None:
    """One `PlantTrial` per motion, or None if the machine fell."""
    from hqpipe.plant import Plant, PlantConfig
    from hqpipe.plant.case_motion import Trot
    from hqpipe.plant.excitation import excitation
    from hqpipe.robots import load_robot

    robot, found = load_robot(robot_folder), []
    for motion in case.trials():
        config = PlantConfig(case.machine(motion.seconds, leave_out))
        if motion.motion == "trot":
            base, controller = "floating", Trot(robot, motion.seed + 1000 * gait)
        else:
            base, controller = "fixed", excitation(robot, "multisine", motion.seconds, motion.seed)
        trial = Plant(robot, config, seed=motion.seed, base=base).run(controller, motion.seconds)
        if trial.fell:
            return None
        found.append(trial)
    return found


def _write(case: Any, robot_folder: Path, folder: Path, trials: Sequence[Any]) -> None:
    from hqpipe.logs.writer import LogSetWriter
    from hqpipe.plant.case_machine import logged
    from hqpipe.robots import load_robot

    robot = load_robot(robot_folder)
    bases = [trial.base for trial in trials]
    with LogSetWriter(
        folder,
        robot=robot.name,
        base=bases[0],
        control_mode="position",
        effort_source=case.effort_source,
        rate_hz=RATE_HZ,
        clock_source="firmware tick",
        urdf_sha256=robot.hash,
    ) as writer:
        for motion, trial in zip(case.trials(), trials, strict=True):
            columns = logged(trial.columns, robot.joints, case.pressures, RATE_HZ)
            writer.add(motion.file, columns, split=motion.split, base=trial.base)
