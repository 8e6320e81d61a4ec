"""Log sets of the reference plant in its gantry, made once and broken by the tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from hqpipe.logs.assemble import assemble
from hqpipe.logs.columns import RawTable
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial
from hqpipe.plant import Plant, PlantConfig
from hqpipe.plant.excitation import excitation
from hqpipe.robots import load_robot

SECONDS = 3.0
DATA = Path(__file__).parents[4] / "shared" / "data"


@lru_cache
def recorded(seed: int, source: str = "pressure", changes: str = "{}", kind: str = "multisine") -> Trajectory:
    """One trial of the plant; `changes` are its overrides as the text of a dict."""
    import json

    robot = load_robot("hydraulic_quadruped")
    plant = Plant(robot, PlantConfig(json.loads(changes) | {"effort_source": source}), seed=seed, base="fixed")
    columns = plant.run(excitation(robot, kind, SECONDS, seed=seed), SECONDS).columns
    return assemble(RawTable(Path(f"{seed}.parquet"), columns))


def log_set(trials: Sequence[Trajectory], source: str = "pressure") -> LogSet:
    """Trials t0.parquet, t1.parquet, …, the last one held out."""
    last = len(trials) - 1
    return LogSet(
        path=Path("synthetic"),
        sha256="0" * 64,
        format="hqpipe-log/1",
        robot=None,
        base="fixed",
        control_mode="position",
        effort_source=source,
        rate_hz=1.0 / trials[0].dt,
        joints=trials[0].joints,
        trials=tuple(
            Trial(f"t{i}.parquet", "heldout" if i == last else "fit", None, t, "fixed") for i, t in enumerate(trials)
        ),
    )


def plant_logs(seeds: Sequence[int] = (0, 1), source: str = "pressure", changes: str = "{}", **kwargs) -> LogSet:
    return log_set([recorded(seed, source, changes, **kwargs) for seed in seeds], source)


def broken(logs: LogSet, change: Callable[[Trajectory], Trajectory], only: Sequence[int] | None = None) -> LogSet:
    """The log set with `change` applied to every trial, or to some."""
    trials = [
        replace(trial, trajectory=change(trial.trajectory)) if only is None or i in only else trial
        for i, trial in enumerate(logs.trials)
    ]
    return replace(logs, trials=tuple(trials))


def rows(index: Callable[[int], np.ndarray], *channels: str) -> Callable[[Trajectory], Trajectory]:
    """Take other rows of some channels (of all if none is named); the clock stays."""

    def change(t: Trajectory) -> Trajectory:
        chosen = index(t.samples)
        return replace(t, **{n: v[chosen] for n, v in t.channels().items() if not channels or n in channels})

    return change


def values(
    channel: str, change: Callable[[np.ndarray], np.ndarray], *joints: int
) -> Callable[[Trajectory], Trajectory]:
    """Change the values (T, n) of one channel, for some joints or all."""

    def apply(t: Trajectory) -> Trajectory:
        array = getattr(t, channel).copy()
        where = list(joints) or list(range(array.shape[1]))
        array[:, where] = change(array[:, where])
        return replace(t, **{channel: array})

    return apply


def without_pressures(t: Trajectory) -> Trajectory:
    return replace(t, pressure_a=None, pressure_b=None, valve_command=None)


def real(name: str) -> LogSet:
    """A log set of a real machine; the test is skipped where it is absent."""
    if not (DATA / name).is_dir():
        pytest.skip(f"no real logs: {DATA / name} is absent")
    return read_log_set(DATA / name)
