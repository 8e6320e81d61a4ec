"""How long the fit of k1 … k4 takes: 20 s of 12 joints at 1 kHz, joint by joint and shared, intervals and posterior included.

    python benchmarks/fit_speed.py [--seconds 20] [--repeats 5]

One thread. The logs are those of tests/recovery/closed_loop_truth.py, or the reference plant's in the gantry with `--plant`,
where the model's form is not the machine's. The compiled code is warmed up before the clock starts.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "recovery"))
from closed_loop_truth import trot
from diagnosis_speed import ROBOT, record
from diagnosis_speed import log_set as two_trials
from hydraulic_truth import log_set

from hqpipe.identify.paper_model.fit_actuator import fit_actuator
from hqpipe.logs.trajectory import LogSet
from hqpipe.robots import load_robot

JOINTS = 12


def plant_logs(seconds: float) -> LogSet:
    """The reference plant in the gantry; its held-out trial plays no part."""
    robot = load_robot(ROBOT)
    return two_trials(record(robot, seconds, 1), record(robot, 1.0, 2))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--plant", action="store_true")
    options = parser.parse_args()
    logs = plant_logs(options.seconds) if options.plant else log_set([trot(options.seconds, JOINTS, 1)], ["fit"])
    fit_actuator(log_set([trot(4.0, 2, 1)], ["fit"]), scope="shared")
    for scope in ("per_joint", "shared"):
        wall, cpu = [], []
        for _ in range(options.repeats):
            started = time.perf_counter(), time.process_time()
            fit_actuator(logs, scope=scope)
            wall.append(time.perf_counter() - started[0])
            cpu.append(time.process_time() - started[1])
        print(
            f"{options.seconds:g} s × {len(logs.joints)} joints × 1 kHz, {scope}: {np.median(wall):.2f} s "
            f"({min(wall):.2f} … {max(wall):.2f}), {np.median(cpu):.2f} s of one core",
            flush=True,
        )


if __name__ == "__main__":
    main()
