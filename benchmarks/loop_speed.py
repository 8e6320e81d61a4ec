"""What the loops of the chain of effects cost: windows of a log, one robot, many robots, and compiling them from nothing.

    python benchmarks/loop_speed.py [--cold]

A log of 68 s at 1 kHz in windows of 0.4 s, a robot of 12 joints, and 400 of them in one call, on one core; the best of several
rounds. `--cold` compiles everything in a fresh cache instead and says how long each part takes.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable

SECONDS, DT, STEPS, JOINTS, ROBOTS = 68.0, 1e-3, 400, 12, 400
BASE = {"k1": 540.0, "k2": 0.05, "k3": 21.6, "k4": 0.36}
LAG_ORIFICE = {("valve_lag", "time_constant_s"): 0.012, ("orifice_flow", "effort_max_nm"): 1.0 / 900.0}
COMMAND_SIDE = LAG_ORIFICE | {
    ("valve_deadband", "half_width"): 0.02,
    ("valve_deadband", "rounding"): 0.2,
    ("command_delay", "delay_s"): 0.0064,
}
MACHINE = COMMAND_SIDE | {
    ("position_bias", "rad"): 0.02,
    ("integral_action", "ki"): 2.0,
    ("integral_action", "limit"): 1.0 / 0.03,
    ("valve_delay", "delay_s"): 0.0047,
    ("flow_saturation", "limit"): 1.0 / 0.06,
    ("direction_asymmetry", "ratio"): 0.2,
    ("gain_drift", "rate_per_s"): 0.003,
    ("leakage_drift", "rate_per_s"): 0.008,
    ("supply_droop", "droop"): 0.03,
    ("supply_droop", "recovery_s"): 0.15,
    ("position_dependent_stiffness", "slope_per_rad"): 1.5,
    ("position_dependent_stiffness", "length_rad"): 0.5,
    ("backlash", "gap"): 0.008,
    ("coulomb_friction", "friction_nm"): 25.0,
    ("coulomb_friction", "asymmetry_nm"): 5.0,
    ("coulomb_friction", "presliding_rad"): 0.002,
    ("stribeck_friction", "static_nm"): 30.0,
    ("stribeck_friction", "velocity_rad_s"): 0.3,
    ("stribeck_friction", "exponent"): 1.5,
    ("viscous_friction", "nm_s_per_rad"): 20.0,
    ("load_dependent_friction", "coefficient"): 0.15,
}
EVERYTHING = MACHINE | {("torque_bias", "nm"): 30.0, ("channel_skew", "skew_s"): 0.0052}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cold", action="store_true", help="compile everything in a fresh cache instead")
    if parser.parse_args().cold:
        with tempfile.TemporaryDirectory() as folder:
            os.environ["NUMBA_CACHE_DIR"] = folder
            measure(rounds=1, first=True)
    else:
        measure(rounds=7, first=False)


def measure(rounds: int, first: bool) -> None:
    """Print a line for each case; first: of the first call, compiling included, of one case each."""
    import numpy as np

    from hqpipe.machine.chain import Signals, loops
    from hqpipe.machine.layout import neutral_row, slot

    def row(effects):
        p = neutral_row()
        for key, value in {**{("base", k): v for k, v in BASE.items()}, **effects, ("setting", "clear"): 50.0}.items():
            p[slot(*key)] = value
        return p

    rng, time_s = np.random.default_rng(0), np.arange(round(SECONDS / DT)) * DT

    def waves(size, fastest):
        rates, phases = rng.uniform(0.3, fastest, (5, 1)), rng.uniform(0.0, 6.0, (5, 1))
        return size * np.sin(2.0 * np.pi * rates * time_s + phases).sum(axis=0) / 2.0

    q, effort = waves(0.3, 3.0), waves(150.0, 5.0)
    command, speed = q + waves(0.04, 6.0), np.gradient(q, DT)
    start, bounds = np.arange(0, len(q) - STEPS, STEPS), np.array([0, len(q)])
    target = np.ascontiguousarray(effort[start[None, :] + np.arange(STEPS + 1)[:, None]])
    signals = Signals(command, q, speed, effort, time_s, 3.0 * np.abs(speed), bounds, start, STEPS, target)
    work, out = loops().make_work(signals), np.empty((STEPS, len(start)))
    cases = {
        "no effect": {},
        "lag, orifice": LAG_ORIFICE,
        "lag, orifice, deadband, delay": COMMAND_SIDE,
        "everything": EVERYTHING,
    }
    for name, effects in list(cases.items())[: 1 if first else None]:
        p = row(effects)

        def anew(p=p):
            work.kept.version[:] = 0
            loops().fill_errors(p, signals, work, out)

        report(f"free run, {name}", anew, rounds, 5)
        columns = [slot(*key) for key in (*((("base", k)) for k in BASE), *effects)]

        def gradient(p=p, columns=columns):
            for column in columns:
                moved = p.copy()
                moved[column] *= 1.001
                loops().fill_errors(moved, signals, work, out)

        if not first:
            gradient()
            report(f"run after a changed number, {name}", gradient, rounds, 2, len(columns))
    for name, effects in list({"no effect": {}, "lag, orifice": LAG_ORIFICE, "everything": MACHINE}.items())[
        : 1 if first else None
    ]:
        table = np.array([row(effects)] * JOINTS)
        given = [rng.normal(0.0, size, ROBOTS * JOINTS) for size in (0.05, 0.05, 1.0)]
        tau, memory = np.zeros(ROBOTS * JOINTS), np.zeros((JOINTS, loops().memory))
        small, one = [x[:JOINTS].copy() for x in given], np.zeros(JOINTS)
        report(
            f"one robot, {name}",
            lambda t=table, m=memory, x=small, y=one: loops().step_row(t, y, m, *x),
            rounds,
            2000,
        )
        planes = np.zeros((loops().memory, ROBOTS * JOINTS))
        prepared = loops().prepare(table)
        report(
            f"{ROBOTS} robots, {name}",
            lambda p=prepared, m=planes, x=given, y=tau: loops().step_batch(*p, y, m, *x, JOINTS),
            rounds,
            100,
        )


def report(name: str, run: Callable[[], None], rounds: int, repeats: int, parts: int = 1) -> None:
    """Print the least time of a run over some rounds; of the first call where there is one round."""
    best = float("inf")
    if rounds > 1:
        run()
    for _ in range(rounds):
        begun = time.perf_counter()
        for _ in range(repeats if rounds > 1 else 1):
            run()
        best = min(best, (time.perf_counter() - begun) / ((repeats if rounds > 1 else 1) * parts))
    print(f"{name:45s} {best:8.2f} s" if rounds == 1 else f"{name:45s} {1e6 * best:10.1f} µs", flush=True)


if __name__ == "__main__":
    main()
