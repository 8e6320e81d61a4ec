"""The paper's actuator model beside neural rivals, on held-out trials: errors, and the time that fit and step take.

    python benchmarks/rival_nets.py [--logs DIR] [--seed 0] [--kinds mlp lstm gru]

Without logs it takes 20 s of the reference plant in the gantry, and 8 s held out.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from diagnosis_speed import ROBOT, log_set, record

from hqpipe.actuators.base import ActuatorModel
from hqpipe.identify.paper_model.fit_actuator import fit_actuator
from hqpipe.identify.rivals.compare import ALL, PERSISTENCE, compare_models
from hqpipe.identify.rivals.nets.fit_net import KINDS, fit_paper_net, fit_strong_net
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.trajectory import LogSet
from hqpipe.robots import load_robot

FIT_S, HELDOUT_S = 20.0, 8.0
ROBOTS = 100  # in the batch that is timed
SHOWN = (PERSISTENCE, "stiff PD (fitted gains)")


def plant_logs() -> LogSet:
    robot = load_robot(ROBOT)
    return log_set(record(robot, FIT_S, 1), record(robot, HELDOUT_S, 2))


def step_time(model: ActuatorModel) -> float:
    """Time of one sample of one robot, µs: the best of ten batches of 100 robots."""
    rng = np.random.default_rng(0)
    shape = (ROBOTS, len(model.joints))
    tau, q_des, q, qd = (spread * rng.normal(size=shape) for spread in (100.0, 0.2, 0.2, 1.0))
    memory, best = model.fresh_memory(ROBOTS), np.inf
    for _ in range(11):  # the first one compiles
        started = time.perf_counter()
        model.step(tau, memory, q_des, q, qd, model.dt)
        best = min(best, time.perf_counter() - started)
    return 1e6 * best / ROBOTS


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    options = parser.parse_args()
    logs = read_log_set(options.logs) if options.logs else plant_logs()
    fits: dict[str, Callable[[], ActuatorModel]] = {"paper's model": lambda: fit_actuator(logs).model}
    for kind in options.kinds:
        fits[f"{kind}, as the paper"] = lambda kind=kind: fit_paper_net(logs, kind, seed=options.seed).model
        fits[f"{kind}, every advantage"] = lambda kind=kind: fit_strong_net(logs, kind, seed=options.seed).model
    models, seconds = {}, {}
    for name, fit in fits.items():
        started = time.process_time()
        models[name] = fit()
        seconds[name] = time.process_time() - started
        print(f"{name}: {seconds[name]:.1f} s of one core, {step_time(models[name]):.2f} µs a step", flush=True)
    print(f"{'N·m, held out':<28}{'one step':>10}{'100 ms':>10}")
    for row in compare_models(logs, models):
        if (row.joint, row.trial) == (ALL, ALL) and row.model in (*models, *SHOWN):
            print(f"{row.model:<28}{row.one_step.rmse:>10.2f}{row.free_run.rmse:>10.2f}")


if __name__ == "__main__":
    main()
