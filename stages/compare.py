"""compare: controllers trained with one budget and different models of the actuators, then driven on the reference plant."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import AfterValidator

from hqpipe.pipeline.config import StageParams
from hqpipe.stages.comparison.controllers import (
    DIAGNOSIS,
    ORACLE,
    STIFF,
    TITLES,
    NetKind,
    checked_names,
    read_controllers,
)
from hqpipe.stages.comparison.intervals import REWARD, differences, measures, over_seeds
from hqpipe.stages.comparison.model_check import free_run_errors
from hqpipe.stages.comparison.plant import POLICY, walk_all
from hqpipe.stages.comparison.results import by_controller, loop_closed, walks
from hqpipe.stages.comparison.seeds import Seeds, training_seeds
from hqpipe.stages.comparison.summary import draw, headline, tables
from hqpipe.stages.comparison.train import Trained, keep, train_all
from hqpipe.stages.inputs.bounds import TrialSeconds, Walks
from hqpipe.stages.inputs.plant_overrides import Plant
from hqpipe.stages.inputs.training import METRICS, Training, write_rows
from hqpipe.stages.walks.scenarios import SCENARIOS, known_scenarios

FORMAT = "hqpipe-comparison/2"
_REWARD = "rollout/reward_mean"
_LAST = 0.1  # share of the iterations at the end that a reward is the mean of
_TRAINING_SHARE = 0.8  # of the progress bar


class Params(StageParams):
    """Attributes:
    training: of every controller, see `hqpipe.rl.config.TrainConfig`.
    controllers: torque and stiff_pd, trained without an actuator model; fitted and diagnosed; oracle, the plant's own numbers;
        mlp, lstm and gru.
    seeds: trainings of each, with the stage's seed and those after it; or their seeds as text "A:B", without B.
    nets: strong, those with every advantage, or paper, those as in the paper; see fit-actuator.
    scenarios: walked on the plant, see validate. walk_seeds: walks of each. walk_seconds: longest walk, s; null for the whole
        course.
    plant: as in collect.
    """

    training: Training = {}
    controllers: Annotated[list[str], AfterValidator(checked_names)] = list(TITLES)
    seeds: Seeds = 1
    nets: NetKind = "strong"
    scenarios: Annotated[list[str], AfterValidator(known_scenarios)] = list(SCENARIOS)
    walk_seeds: Walks = 4
    walk_seconds: TrialSeconds | None = None
    plant: Plant = {}


def run(context: Any) -> dict[str, Any]:
    from hqpipe.stages.output.terminal import show

    p = context.params
    controllers, left_out = read_controllers(context, p.controllers, p.nets)
    show(*(f"warning: {text}" for text in left_out))
    seeds = training_seeds(p.seeds, context.seed)
    trained = train_all(context, controllers, seeds, _part(context.progress, 0.0, _TRAINING_SHARE))
    for each in trained:
        keep(each, context.output)
    trials = walk_all(context, trained, _part(context.progress, _TRAINING_SHARE, 1.0))
    check = free_run_errors(context, controllers) if any(each.name == ORACLE for each in controllers) else None
    report = _report(context, trained, trials, check, left_out)
    text = json.dumps(report, indent=2, ensure_ascii=False, allow_nan=False)
    (context.output / "comparison.json").write_text(text + "\n", encoding="utf-8")
    write_rows(context.output / "comparison.csv", list(walks(trials)))
    draw(context.output, report)
    speeds = {each.name: _speed(each) for each in trained if each.diverged is None}
    show(*tables(report, speeds))
    return {
        "headline": headline(report),
        "controllers": {each["controller"]: each["plant"] for each in report["controllers"]},
        "loop": report["loop"],
        "speeds": speeds,
        "left_out": left_out,
    }


def _part(progress: Any, first: float, last: float) -> Any:
    return lambda done, total, text: progress(first + (last - first) * done / total, 1.0, text)


def _report(
    context: Any,
    trained: Sequence[Trained],
    trials: list[dict[str, Any]],
    check: dict[str, Any] | None,
    left_out: list[str],
) -> dict[str, Any]:
    """comparison.json: no time in it, so that the bytes can be made again."""
    p, flat = context.params, list(walks(trials))
    plant = by_controller(flat)
    controllers = {each.controller.name: each.controller for each in trained}
    return {
        "format": FORMAT,
        "environment_steps": p.training["total_steps"],
        "nets": p.nets,
        "controllers": [
            {
                "controller": name,
                "title": controller.title,
                "control_mode": controller.control_mode,
                "actuator": controller.actuator.NAME,
                "effects": controller.effects,
                "trainings": [_training(each) for each in trained if each.controller.name == name],
                "plant": plant.get(name),
                **_spread(name, trained, flat),
            }
            for name, controller in controllers.items()
        ],
        "left_out": left_out,
        "model_check": check,
        "trials": trials,
        "loop": loop_closed(flat, context.inputs.get(DIAGNOSIS)),
    }


def _spread(name: str, trained: Sequence[Trained], flat: list[dict[str, Any]]) -> dict[str, Any]:
    """over_seeds: reward, falls and measures of a controller, with intervals; against_stiff_pd: its differences from that."""
    own, other = (
        [row for row in flat if row["actor"] == POLICY and row["controller"] == which] for which in (name, STIFF)
    )
    rewards = {each.seed: last_reward(each) for each in trained if each.controller.name == name}
    return {
        "over_seeds": {REWARD: over_seeds(rewards), **measures(own)},
        f"against_{STIFF}": differences(own, other) if name != STIFF and other else None,
    }


def _training(trained: Trained) -> dict[str, Any]:
    """What one training gave."""
    head = {"seed": trained.seed, "folder": trained.name, "reward": last_reward(trained)}
    if trained.diverged is not None:
        return {**head, "diverged": trained.diverged, "iterations": trained.report["iterations"]}
    kept = ("policy", "zero_action_baseline", "best_iteration", "actuator_randomisation")
    return {**head, "diverged": None, **{key: trained.report[key] for key in kept}}


def last_reward(trained: Trained) -> float | None:
    """Mean reward per step over the last iterations; None where there was none."""
    from hqpipe.report.training_figures import read_metrics

    if not _has_metrics(trained):
        return None
    reward = read_metrics(trained.folder / METRICS)[_REWARD]
    return float(reward[-max(1, round(_LAST * len(reward))) :].mean())


def _has_metrics(trained: Trained) -> bool:
    return trained.diverged is None or trained.report["iterations"] > 0


def _speed(trained: Trained) -> dict[str, float]:
    """Time of a training, and of a step of an environment in it, s."""
    told = {key: trained.report[key] for key in ("training_s", "steps_per_second", "resumed_from")}
    return {**told, "step_s": 1.0 / told["steps_per_second"]}
