"""How often the 95 % intervals of k1 … k4 hold the truth, and how far the estimates are from it.

    python benchmarks/interval_coverage.py [--seed 100] [--fits 200] [--joints 1] [--seconds 20] [--disturbed 0.03 0.3]
        [--inside] [--csv FILE]

Every fit has a command, impacts, disturbances and noise of its own (tests/recovery/closed_loop_truth.py): one joint, or
`--joints` of them that share their coefficients. Besides white noise of 4 N·m the measured torque has a disturbance of 8 N·m
that is correlated over the time in the first column, and none in the first row. With `--inside` it is 1 N·m a sample that the
actuator itself adds instead, which moves the joint. "independent" are intervals that take the
residuals for independent of each other, as is usual. `--csv` appends the rows to a file, which `claim_figures.py` draws.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "recovery"))
from closed_loop_truth import Sensors, trot
from hydraulic_truth import RADIUS, TRUTH, log_set

from hqpipe.benchmark.score.share import wilson
from hqpipe.identify.paper_model.fit_actuator import fit_actuator
from hqpipe.identify.paper_model.problem import COEFFICIENTS, Problem
from hqpipe.identify.paper_model.results import FitResult, JointFit
from hqpipe.identify.windows import cut_windows, joint_data
from hqpipe.logs.trajectory import LogSet

KNOWN = np.array([TRUTH[name] for name in COEFFICIENTS])
DRIFT, RIPPLE = 8.0, 1.0  # N·m, and N·m a sample
TIMES = (0.0, 0.005, 0.03, 0.1, 0.3, 1.0)  # s; 0 for no disturbance
TOGETHER = 60  # joints simulated at a time, for memory
Z95 = 1.959964
CLOSE = 2.0  # %


def logs_of(seed: int, fits: int, joints: int, seconds: float, correlated_s: float, inside: bool) -> Iterator[LogSet]:
    """Logs of `joints` joints each, `fits` of them."""
    sizes = {"drift": 0.0, "ripple": RIPPLE} if inside else {"drift": DRIFT}
    sensors = Sensors(**sizes, drift_s=correlated_s) if correlated_s else Sensors(drift=0.0)
    per_batch = max(1, TOGETHER // joints)
    for batch, first in enumerate(range(0, fits, per_batch)):
        count = min(per_batch, fits - first)
        time, *signals = trot(seconds, count * joints, [seed, round(1e6 * correlated_s), batch], sensors)
        for i in range(count):
            own = slice(i * joints, (i + 1) * joints)
            yield log_set([(time, *(signal[:, own] for signal in signals))], ["fit"])


def independent(logs: LogSet, fit: JointFit) -> np.ndarray:
    """(4,) half-widths of the intervals for independent residuals."""
    joints = len(logs.joints)
    data = [joint_data(logs.fit, joint) for joint in logs.joints]
    windows = cut_windows(logs.fit, 0.1)
    problem = Problem(data, windows, np.full(joints, RADIUS), np.full(joints, np.inf))
    at, _ = problem.evaluate(np.array([c.value for c in fit.coefficients]), problem.measured_starts())
    return Z95 * fit.free_run_rmse * np.sqrt(np.diag(np.linalg.inv(at.hessian)))


def judge(fits: list[tuple[LogSet, FitResult]]) -> tuple[str, dict[str, float]]:
    """One row: coverage of each coefficient and of all, that of independent intervals, and errors of the estimates, %.

    Returns:
        For the terminal, and as columns of the CSV file.
    """
    found = [(logs, result.fits[0]) for logs, result in fits]
    value = np.array([[c.value for c in fit.coefficients] for _, fit in found])
    ends = np.array([[c.ci95 for c in fit.coefficients] for _, fit in found])
    inside = (ends[..., 0] <= KNOWN) & (KNOWN <= ends[..., 1])
    plain = np.abs(value - KNOWN) <= np.array([independent(*pair) for pair in found])
    low, high = wilson(int(inside.sum()), inside.size)
    error = 100.0 * (value / KNOWN - 1.0)
    covers = " ".join(f"{100 * share:5.1f}" for share in inside.mean(axis=0))
    rms = " ".join(f"{x:5.2f}" for x in np.sqrt((error**2).mean(axis=0)))
    worst = " ".join(f"{x:5.2f}" for x in np.abs(error).max(axis=0))
    pooled = f"{100 * inside.mean():5.1f} ({100 * low:.1f}–{100 * high:.1f})"
    close = 100.0 * (np.abs(error) <= CLOSE).all(axis=1).mean()
    columns = {f"covered_{name}": 100.0 * share for name, share in zip(COEFFICIENTS, inside.mean(axis=0), strict=True)}
    columns |= {"covered": 100.0 * inside.mean(), "independent": 100.0 * plain.mean(), "close": close}
    columns |= {f"error_{name}": x for name, x in zip(COEFFICIENTS, np.sqrt((error**2).mean(axis=0)), strict=True)}
    return f"{covers}  {pooled}  {100 * plain.mean():5.1f}  |{rms}  |{worst}  |{close:5.1f}", columns


def append(path: Path, row: dict[str, float]) -> None:
    """Add a row to a CSV file, with a head if the file is new."""
    path.parent.mkdir(parents=True, exist_ok=True)
    new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(row), lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow(row)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--fits", type=int, default=200)
    parser.add_argument("--joints", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--disturbed", type=float, nargs="+", default=TIMES, help="correlation times, s; 0 for none")
    parser.add_argument("--inside", action="store_true")
    parser.add_argument("--csv", type=Path, help="append the rows to this file")
    options = parser.parse_args()
    scope = "per_joint" if options.joints == 1 else "shared"
    print(f"{options.fits} fits of {options.seconds:g} s × {options.joints} joints, seed {options.seed}; %")
    head = f"{'s':>6}  covered: {' '.join(COEFFICIENTS)}, all (Wilson 95 %), independent"
    print(f"{head} | RMS error | worst | all within {CLOSE:g}")
    for time_s in options.disturbed:
        logs = logs_of(options.seed, options.fits, options.joints, options.seconds, time_s, options.inside)
        fits = [(one, fit_actuator(one, sprocket_radius=RADIUS, scope=scope)) for one in logs]
        text, columns = judge(fits)
        print(f"{time_s:6.3f}  {text}", flush=True)
        if options.csv:
            append(options.csv, {"correlated_s": time_s, "seed": options.seed, "fits": options.fits, **columns})


if __name__ == "__main__":
    main()
