"""What a diagnosis of an hour of logs takes: time and memory of `hqpipe diagnose` in a process of its own.

    python benchmarks/diagnosis_hour.py [--seconds 3600] [--layout lone|minutes|both] [--keep DIR]

Twelve joints at 1 kHz in position control, by the equations of the base model with a dead band in one valve; the load is
an inertia that is knocked about. `lone` is one fit trial of five sixths of the time and one held-out trial of the rest,
`minutes` is trials of a minute, every sixth held out. Only the diagnosing process is measured.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from numba import njit

from hqpipe.logs.columns import joint_column
from hqpipe.logs.writer import LogSetWriter

JOINTS = tuple(leg + kind for leg in ("LF", "RF", "LH", "RH") for kind in "RPK")
DT = 1e-3
K1, K2, K3, K4 = 540.0, 0.05, 21.6, 0.36  # joint space, per sample: the size of the paper's machine
INERTIA, DAMPING, LOAD = 6.0, 15.0, 120.0  # kg·m², N·m·s/rad, N·m
DEADBAND = (2, 0.02)  # joint, half width in rad
NOISE = 3.0  # N·m
MOTION, KNOCKS = 0.4, 500.0  # rad, N·m
MINUTE = 60.0
HELDOUT_OF = 6  # one trial in so many, or one part of the time, is held out


@njit(cache=True)
def _closed_loop(target: np.ndarray, knock: np.ndarray, half: np.ndarray, log: np.ndarray) -> None:
    for j in range(target.shape[1]):
        q, qd, torque = target[0, j], 0.0, 0.0
        for k in range(target.shape[0]):
            log[0, k, j], log[1, k, j], log[2, k, j] = q, qd, torque
            error = target[k, j] - q
            flow = np.sign(error) * max(abs(error) - half[j], 0.0)
            braked = K4 * abs(torque) * flow if torque * flow < 0.0 else 0.0
            passed = torque
            torque = torque + K1 * flow - K2 * torque - K3 * qd + braked
            q, qd = q + DT * qd, qd + DT * (passed - DAMPING * qd - LOAD + knock[k, j]) / INERTIA


def record(seconds: float, seed: int) -> dict[str, np.ndarray]:
    """One trial as columns of the format, float32."""
    rng = np.random.default_rng(seed)
    samples, joints = round(seconds / DT), len(JOINTS)
    held = np.arange(samples) // 10 * 10 * DT  # a policy sends targets at 100 Hz
    target = np.zeros((samples, joints))
    for rate, phase in zip(rng.uniform(0.4, 4.0, (5, joints)), rng.uniform(0.0, 2 * np.pi, (5, joints)), strict=True):
        for j in range(joints):
            target[:, j] += MOTION / 5.0 * np.sin(2.0 * np.pi * rate[j] * held + phase[j])
    knock = np.zeros((samples, joints))
    for start in rng.integers(0, samples - 80, int(2 * seconds)):
        knock[start : start + rng.integers(20, 80)] += KNOCKS * rng.normal(size=joints)
    half = np.zeros(joints)
    half[DEADBAND[0]] = DEADBAND[1]
    log = np.empty((3, samples, joints))
    _closed_loop(target, knock, half, log)
    columns = {"time": np.arange(samples) * DT}
    for j, joint in enumerate(JOINTS):
        columns[joint_column(joint, "position")] = log[0, :, j].astype(np.float32)
        columns[joint_column(joint, "velocity")] = log[1, :, j].astype(np.float32)
        effort = log[2, :, j] + NOISE * rng.standard_normal(samples)
        columns[joint_column(joint, "effort")] = effort.astype(np.float32)
        columns[joint_column(joint, "position_command")] = target[:, j].astype(np.float32)
    return columns


def write(folder: Path, seconds: float, layout: str) -> None:
    """A log set of `seconds` in all, either in two long trials or in trials of a minute."""
    if layout == "lone":
        parts = [("fit", seconds * (1.0 - 1.0 / HELDOUT_OF)), ("heldout", seconds / HELDOUT_OF)]
    else:
        count = round(seconds / MINUTE)
        parts = [("heldout" if i % HELDOUT_OF == HELDOUT_OF - 1 else "fit", MINUTE) for i in range(count)]
    settings = {"base": "fixed", "control_mode": "position", "effort_source": "load_cell", "rate_hz": 1.0 / DT}
    with LogSetWriter(folder, **settings) as writer:
        for index, (split, duration) in enumerate(parts):
            writer.add(f"trial_{index:02d}.parquet", record(duration, index + 1), split=split)


def measure(project: Path, logs: Path) -> tuple[float, float, dict]:
    """Seconds and MiB at most of `hqpipe diagnose` on a log set, and its answer."""
    command = [sys.executable, "-m", "hqpipe.cli", "diagnose", "--logs", str(logs), "--force"]
    started = time.perf_counter()
    child = subprocess.Popen(command, cwd=project, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    seconds = time.perf_counter() - started
    if status != 0:
        raise SystemExit(f"{' '.join(command)}: status {status}")
    answer = json.loads((project / "artifacts" / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))
    return seconds, usage.ru_maxrss / 1024, answer


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--layout", choices=("lone", "minutes", "both"), default="both")
    parser.add_argument(
        "--keep", type=Path, help="where the logs are written and kept, or taken from if they are there"
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        project = Path(scratch) / "project"
        subprocess.run(
            [sys.executable, "-m", "hqpipe.cli", "init", str(project)], check=True, stdout=subprocess.DEVNULL
        )
        for layout in ("lone", "minutes") if options.layout == "both" else (options.layout,):
            logs = (options.keep or Path(scratch)) / f"{layout}_{options.seconds:.0f}"
            if not logs.exists():
                write(logs, options.seconds, layout)
            seconds, memory, answer = measure(project, logs)
            causes = ", ".join(f"{cause['effect']} in {', '.join(cause['joints'])}" for cause in answer["causes"])
            print(
                f"{layout}: {options.seconds:.0f} s × {len(JOINTS)} joints × 1 kHz: {seconds:.0f} s, {memory:.0f} MiB"
            )
            print(f"  {answer['verdict']}: {causes}; warnings: {answer['warnings']}")


if __name__ == "__main__":
    main()
