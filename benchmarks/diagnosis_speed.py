"""How long a diagnosis takes: 20 s of 12 joints at 1 kHz, every single effect and every pair.

    python benchmarks/diagnosis_speed.py

The logs are the reference plant's in the gantry. The compiled code is warmed up before the clock starts.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

from hqpipe.gap.diagnosis import diagnose
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial
from hqpipe.plant import Plant, PlantConfig
from hqpipe.plant.excitation import excitation
from hqpipe.robots import RobotSpec, load_robot

ROBOT = Path(__file__).parents[1] / "robot" / "hydraulic_quadruped"
FIT_S, HELDOUT_S = 12.0, 8.0


def record(robot: RobotSpec, seconds: float, seed: int) -> Trajectory:
    """One gantry trial."""
    trial = Plant(robot, PlantConfig({}), seed=seed, base="fixed").run(
        excitation(robot, "multisine", seconds, seed), seconds
    )
    signals = {name: trial.joint(name, robot.joints) for name in ("position", "velocity", "effort", "position_command")}
    position, velocity = signals.pop("position"), signals.pop("velocity")
    return Trajectory(trial.time, robot.joints, position, velocity, **signals)


def log_set(fit: Trajectory, heldout: Trajectory) -> LogSet:
    """Both trials as the logs of one machine."""
    trials = (Trial("fit.parquet", "fit", None, fit), Trial("heldout.parquet", "heldout", None, heldout))
    return LogSet(
        Path("benchmark"), "0" * 64, "hqpipe-log/1", None, "fixed", "position", "load_cell", 1e3, fit.joints, trials
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    options = parser.parse_args()
    robot = load_robot(ROBOT)
    fit, heldout = record(robot, FIT_S, 1), record(robot, HELDOUT_S, 2)
    diagnose(log_set(fit, heldout), workers=options.workers)
    tried: list[str] = []
    started = time.perf_counter()
    found = diagnose(
        log_set(fit, heldout), workers=options.workers, progress=lambda done, total, text: tried.append(text)
    )
    seconds = time.perf_counter() - started
    sets = sum(int(text.split(": ")[1].split()[0]) for text in tried)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{fit.duration + heldout.duration:.0f} s × {len(robot.joints)} joints × 1 kHz, {options.workers} threads")
    print(f"{seconds:.1f} s, {sets} sets of effects fitted, {memory:.0f} MiB at most, verdict {found.verdict}")


if __name__ == "__main__":
    main()
