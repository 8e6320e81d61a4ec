"""How long a diagnosis takes: 20 s of 12 joints at 1 kHz, on three machines whose model is right to a different degree.

    python benchmarks/diagnosis_speed.py [--machine sound|reference|worn ...]

    sound      the paper's four coefficients are nearly right
    reference  the plant as robot.yaml describes it: its own orifices, spools, supply
    worn       the same with valves that answer 8 ms late, overlap by 5 % and pass 20 Hz

The logs are the reference plant's in the gantry. The compiled code is warmed up before the clock starts.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

from hqpipe.gap.diagnosis import diagnose
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial
from hqpipe.plant import Plant, PlantConfig
from hqpipe.plant.case_machine import sound_machine
from hqpipe.plant.excitation import excitation
from hqpipe.robots import RobotSpec, load_robot

ROBOT = Path(__file__).parents[1] / "robot" / "hydraulic_quadruped"
FIT_S, HELDOUT_S = 6.0, 4.0  # of each of two trials
MACHINES: dict[str, dict[str, Any]] = {
    "sound": sound_machine(),
    "reference": {},
    "worn": {"valve": {"delay": 0.008, "overlap": 0.05, "bandwidth_hz": 20.0}},
}


def record(robot: RobotSpec, machine: dict[str, Any], seconds: float, seed: int) -> Trajectory:
    """One gantry trial."""
    trial = Plant(robot, PlantConfig(machine), seed=seed, base="fixed").run(
        excitation(robot, "multisine", seconds, seed), seconds
    )
    signals = {name: trial.joint(name, robot.joints) for name in ("position", "velocity", "effort", "position_command")}
    position, velocity = signals.pop("position"), signals.pop("velocity")
    return Trajectory(trial.time, robot.joints, position, velocity, **signals)


def log_set(robot: RobotSpec, machine: dict[str, Any]) -> LogSet:
    """20 s of one machine, 12 s of them to fit."""
    plan = (("fit", FIT_S, 1), ("fit", FIT_S, 2), ("heldout", HELDOUT_S, 3), ("heldout", HELDOUT_S, 4))
    trials = tuple(
        Trial(f"{split}_{seed}.parquet", split, None, record(robot, machine, seconds, seed))
        for split, seconds, seed in plan
    )
    return LogSet(
        Path("benchmark"),
        "0" * 64,
        "hqpipe-log/1",
        None,
        "fixed",
        "position",
        "pressure",
        1e3,
        trials[0].trajectory.joints,
        trials,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machine", choices=MACHINES, nargs="+", default=list(MACHINES))
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    options = parser.parse_args()
    robot = load_robot(ROBOT)
    logs = {name: log_set(robot, MACHINES[name]) for name in options.machine}
    diagnose(logs[options.machine[0]], workers=options.workers)
    print(f"20 s × {len(robot.joints)} joints × 1 kHz, {options.workers} threads")
    for name, one in logs.items():
        started = time.perf_counter()
        found = diagnose(one, workers=options.workers).content
        seconds = time.perf_counter() - started
        causes = [f"{cause['effect']} in {len(cause['joints'])}" for cause in found["causes"]]
        gap = found["gap"]
        print(
            f"{name}: {seconds:.1f} s, {gap['before']:.1f} → {gap['after']:.1f} {gap['unit']} "
            f"(floor {gap['noise_floor']:.1f}), {found['verdict']}: {', '.join(causes) or 'no cause'}"
        )
    print(f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB at most")


if __name__ == "__main__":
    main()
