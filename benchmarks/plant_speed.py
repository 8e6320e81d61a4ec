"""How much faster than real time the plant runs on one core, logging included.

Run: python benchmarks/plant_speed.py [--seconds 10]
"""

from __future__ import annotations

import argparse
import os
import platform
import time

import numpy as np

from hqpipe.plant import Plant
from hqpipe.plant.excitation import excitation
from hqpipe.robots import load_robot


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    robot = load_robot("hydraulic_quadruped")
    lift = np.tile([0.0, 0.2, -0.4], 4) * np.repeat([1.0, 0.0, 0.0, 1.0], 3)

    def steps_on_the_spot(frame, command) -> np.ndarray:
        sway = np.sin(2.0 * np.pi * 1.8 * frame.time)
        return robot.nominal_position + lift * max(sway, 0.0) + np.roll(lift, 3) * max(-sway, 0.0)

    cases = {
        "floating, steps on the spot": ("floating", steps_on_the_spot),
        "gantry, multisine": ("fixed", excitation(robot, "multisine", seconds)),
    }
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    for name, (base, controller) in cases.items():
        plant = Plant(robot, base=base)
        started = time.perf_counter()
        trial = plant.run(controller, seconds)
        elapsed = time.perf_counter() - started
        print(f"{name:30s} {trial.time[-1] / elapsed:5.1f} x real time, fell {trial.fell}")


if __name__ == "__main__":
    main()
