"""The trials that a deployed policy must stand on the reference plant before it goes on the machine.

Every scenario is walked under several seeds. A seed decides how the robot is set down and steered (`hqpipe.plant.repeat`), the
noise of its sensors and the bumps of uneven ground; the same seed is the same walk for every policy, so that policies can
be compared walk by walk.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from hqpipe.errors import UsageError, near_match
from hqpipe.stages.walks.machine import Job, Progress, run_each, run_job

COURSE_M = 30.0  # length of the straight courses
SETTLING_S = 2.0  # of `hqpipe.rl.walk_measures`, on top of that
BUMPS = 0.05  # m from peak to valley, on a grid of 0.25 m
PAYLOAD = (30.0, (0.0, 0.0, 0.2))  # kg on the trunk, and where: on top of it (assumption)
LOW_SUPPLY = 0.9  # share of the supply pressure
IMPULSE = 100.0  # N·s; 317 kg move at 0.32 m/s after it

_LOWEST_IS_WORST = ("foot_clearance", "lowest_supply")  # of all other measures the highest is
_NO_WORST = ("distance", "seconds", "speed", "yaw_rate")  # what is wrong with these is another measure


@dataclass(frozen=True)
class Scenario:
    """One kind of trial; `SCENARIOS` holds them by name.

    Attributes:
        name, title: as it is asked for, and in words.
        vx, vy: m/s. wz: rad/s; None holds the heading, as an operator steers a robot straight.
        seconds: length.
        pushes: (share of the trial, impulse in N·s forwards, to the left and upwards).
        bumps: height of the ground's bumps, m. payload: kg on the trunk. supply: share of the supply pressure.
        speed_slack, drift_slack: what is granted here, over what is granted elsewhere.
    """

    name: str
    title: str
    vx: float = 0.0
    vy: float = 0.0
    wz: float | None = None
    seconds: float = 20.0
    pushes: tuple[tuple[float, tuple[float, float, float]], ...] = ()
    bumps: float = 0.0
    payload: float = 0.0
    supply: float = 1.0
    speed_slack: float = 1.0
    drift_slack: float = 1.0

    @property
    def order(self) -> tuple[float, float, float]:
        """vx, vy (m/s) and wz (rad/s); a held heading is no turn."""
        return self.vx, self.vy, self.wz or 0.0


def _course_time(speed: float) -> float:
    """s for the course at `speed` (m/s)."""
    return round(COURSE_M / speed + SETTLING_S, 1)


_TABLE = (
    Scenario("forward_04", "0.4 m/s forward, 30 m", vx=0.4, seconds=_course_time(0.4)),
    Scenario("forward_10", "1.0 m/s forward, 30 m", vx=1.0, seconds=_course_time(1.0)),
    # Beyond the paper's 1.0 m/s and the speeds seen in training: twice the error is granted.
    Scenario("forward_13", "1.3 m/s forward, 30 m", vx=1.3, seconds=_course_time(1.3), speed_slack=2.0),
    Scenario("lateral_03", "0.3 m/s to the left", vy=0.3),
    Scenario("turn_05", "turning at 0.5 rad/s", wz=0.5),
    Scenario(
        "push_side",
        "100 N·s from either side at 1.0 m/s",
        vx=1.0,
        pushes=((0.4, (0.0, IMPULSE, 0.0)), (0.7, (0.0, -IMPULSE, 0.0))),
    ),
    Scenario(
        "push_forward",
        "100 N·s from behind and from ahead at 1.0 m/s",
        vx=1.0,
        pushes=((0.4, (IMPULSE, 0.0, 0.0)), (0.7, (-IMPULSE, 0.0, 0.0))),
    ),
    # The policy does not see the ground: a foot that meets a bump early holds the robot up, so twice the error is granted.
    Scenario("uneven", "0.4 m/s over bumps of 5 cm", vx=0.4, bumps=BUMPS, speed_slack=2.0),
    Scenario("payload", "1.0 m/s with 30 kg on the trunk", vx=1.0, payload=PAYLOAD[0]),
    Scenario("low_supply", "1.0 m/s at 90 % of the supply pressure", vx=1.0, supply=LOW_SUPPLY),
    # Nothing moves it once it stands, so a tenth of a walk's drift is granted.
    Scenario("stand", "standing still", wz=0.0, drift_slack=0.1),
)
SCENARIOS: dict[str, Scenario] = {scenario.name: scenario for scenario in _TABLE}


def check_names(names: Sequence[str]) -> None:
    """Refuse what is no scenario.

    Raises:
        UsageError: an unknown name, or one twice, or none at all.
    """
    for name in names:
        if name not in SCENARIOS:
            raise UsageError(
                f"no scenario '{str(name)[:80]}'{near_match(str(name)[:80], SCENARIOS)} (known: {', '.join(SCENARIOS)})",
                field="scenarios",
                fix="name these",
            )
    if not names or len(set(names)) < len(names):
        text = f"expected one scenario or more, each once, got {', '.join(names) or 'none'}"
        raise UsageError(text, field="scenarios", fix="name each once")


def known_scenarios(names: list[str]) -> list[str]:
    """The names, for the ``Params`` of a stage; ValueError where `check_names` refuses them."""
    try:
        check_names(names)
    except UsageError as error:
        raise ValueError(error.message) from None
    return names


def run_scenarios(
    policy: Path,
    robot_folder: Path,
    names: Sequence[str],
    seeds: int,
    first_seed: int,
    plant: Mapping[str, Any],
    workers: int,
    progress: Progress,
    *,
    seconds: float | None = None,
    shown: Collection[str] = (),
) -> list[dict[str, Any]]:
    """Walk scenarios on the plant; the result depends neither on `workers` nor on which other scenarios are asked for.

    Args:
        policy: folder with policy.onnx and deploy.yaml, or with policy.safetensors.
        names: of `SCENARIOS`. seeds: walks of each. first_seed: of its first walk; the others follow.
        plant: overrides of `hqpipe.plant.PlantConfig`, the machine on which all of it happens.
        seconds: longest walk, s; shortens the scenarios.
        shown: scenarios of which the first walk's log columns are wanted.

    Returns:
        Per scenario: scenario (name), title, order (vx, vy, wz), seconds; walks, falls (counts); mean and worst (measure →
        value over the walks that did not fall, None where there is none); seeds: a row per walk with seed, fell and every
        measure, see `walk_measures` and `estimate_measures` in `hqpipe.rl.walk_columns`. For `shown` ones columns, name →
        (T,), which are no JSON.

    Raises:
        UsageError: see `check_names`.
    """
    check_names(names)
    jobs = {
        name: [_job(SCENARIOS[name], first_seed + i, seconds, plant, robot_folder) for i in range(seeds)]
        for name in names
    }
    kept = {jobs[name][0].name for name in shown}
    task = partial(_measured_walk, robot_folder=robot_folder, policy=policy, overrides=plant, kept=kept)
    results = iter(run_each(task, [job for name in names for job in jobs[name]], workers, progress))
    return [_pooled(SCENARIOS[name], jobs[name], [next(results) for _ in jobs[name]]) for name in names]


def _job(scenario: Scenario, seed: int, longest: float | None, plant: Mapping[str, Any], robot_folder: Path) -> Job:
    from hqpipe.plant import Push

    seconds = scenario.seconds if longest is None else min(scenario.seconds, longest)
    return Job(
        f"{scenario.name} {seed}",
        seconds,
        seed,
        vx=scenario.vx,
        vy=scenario.vy,
        wz=scenario.wz,
        repeat=True,
        disturbances=tuple(Push(share * seconds, impulse) for share, impulse in scenario.pushes),
        plant=_machine(scenario, seed, plant, robot_folder),
    )


def _machine(scenario: Scenario, seed: int, plant: Mapping[str, Any], robot_folder: Path) -> dict[str, Any]:
    """Overrides of `PlantConfig` that the scenario adds to those of the machine, `plant`."""
    from hqpipe.robots import load_robot

    robot = load_robot(robot_folder)
    changes: dict[str, Any] = {}
    if scenario.supply != 1.0:
        pressure = plant.get("supply", {}).get("pressure", robot.hydraulics["supply"]["pressure"])
        changes["supply"] = {"pressure": scenario.supply * pressure}
    if scenario.bumps:
        changes["body"] = {"ground": {"roughness": scenario.bumps, "roughness_seed": seed}}
    if scenario.payload:
        changes["body"] = {"payloads": [{"link": robot.base_link, "mass": scenario.payload, "com": PAYLOAD[1]}]}
    return changes


def _measured_walk(
    job: Job, robot_folder: Path, policy: Path, overrides: Mapping[str, Any], kept: Collection[str]
) -> tuple[dict[str, Any], Any]:
    """One walk as its measures, and its columns if it is to be kept: half a minute of 1 kHz columns is 60 MB."""
    from hqpipe.plant.trial import ORIENTATION
    from hqpipe.rl.controller import EstimateLog
    from hqpipe.rl.walk_columns import estimate_measures, walk_measures
    from hqpipe.robots import load_robot

    robot, record = load_robot(robot_folder), EstimateLog()
    trial = run_job(job, robot_folder, policy, overrides, record)
    # Base position and speed are logged as motion capture has them; so is, here, the attitude.
    columns = {name: trial.truth[name] if name in ORIENTATION else column for name, column in trial.columns.items()}
    measures = {
        **walk_measures(columns, robot, (job.vx, job.vy, job.wz or 0.0)),
        **estimate_measures(trial.columns, trial.truth, robot, record),
    }
    row = {"seed": job.seed, "fell": trial.fell, **measures}
    return row, trial.columns if job.name in kept else None


def _pooled(scenario: Scenario, jobs: Sequence[Job], results: Sequence[tuple[dict[str, Any], Any]]) -> dict[str, Any]:
    rows, columns = [row for row, _ in results], results[0][1]
    finished = [row for row in rows if not row["fell"]]
    measures = [name for name in rows[0] if name not in ("seed", "fell")]
    pooled = {
        "scenario": scenario.name,
        "title": scenario.title,
        "order": list(scenario.order),
        "seconds": jobs[0].seconds,
        "walks": len(rows),
        "falls": len(rows) - len(finished),
        "mean": {name: _mean([row[name] for row in finished]) for name in measures},
        "worst": {name: _worst(name, [row[name] for row in finished]) for name in measures if name not in _NO_WORST},
        "seeds": rows,
    }
    return pooled if columns is None else {**pooled, "columns": columns}


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def _worst(name: str, values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    if not known:
        return None
    return min(known) if name in _LOWEST_IS_WORST else max(known)
