"""The trained controllers of compare on the reference plant, each beside its gait prior alone, walk by walk the same."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hqpipe.stages.comparison.train import Trained

POLICY, ZERO = "policy", "zero_action"
_ZERO_FOLDER = "zero_action"
_RESULT = "result.json"
_BELIEF = "estimate_"  # begins the names of measures of the estimator
Progress = Callable[[float, float, str], None]


def walk_all(context: Any, trained: Sequence[Trained], progress: Progress) -> list[dict[str, Any]]:
    """Every scenario under every seed of a walk, by every policy and by the prior that it corrects.

    Args:
        progress: (done, total, text) in controllers.

    Returns:
        The results of `run_scenarios`, each with controller, training_seed and actor (policy or zero_action). A prior is
        walked once for all seeds of a training, which do not change it, and has training_seed None.
    """
    alive = [each for each in trained if each.diverged is None]
    first: dict[str, Trained] = {}
    for each in alive:
        first.setdefault(each.controller.name, each)
    jobs = [*((each, POLICY) for each in alive), *((each, ZERO) for each in first.values())]
    rows = []
    for number, (each, actor) in enumerate(jobs):

        def within(
            done: float, total: float, note: str, number: int = number, title: str = each.controller.title
        ) -> None:
            progress(number + done / total, len(jobs), f"{title}: {note}")

        head = {
            "controller": each.controller.name,
            "training_seed": each.seed if actor == POLICY else None,
            "actor": actor,
        }
        rows += [{**head, **result} for result in _walked(context, each, actor, within)]
    return rows


def _without_beliefs(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A policy that does nothing has an estimator that means nothing."""

    def told(measures: dict[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in measures.items() if not name.startswith(_BELIEF)}

    return [
        {**r, "mean": told(r["mean"]), "worst": told(r["worst"]), "seeds": [told(row) for row in r["seeds"]]}
        for r in results
    ]


def _walked(context: Any, trained: Trained, actor: str, progress: Progress) -> list[dict[str, Any]]:
    """Results of `run_scenarios`; each scenario is a task, so that those which are there are not walked again."""
    from hqpipe.stages.walks.scenarios import run_scenarios

    p = context.params
    # Seeds apart from those of collect and validate, so that no walk repeats one that was fitted to or judged by.
    first_seed = 1000 * context.seed + 700
    tasks = {
        name: context.tasks.find(
            scenario=name,
            actor=actor,
            policy=_decides(trained, actor),
            walks=p.walk_seeds,
            first_seed=first_seed,
            seconds=p.walk_seconds,
            plant=p.plant,
        )
        for name in p.scenarios
    }
    if missing := [name for name, task in tasks.items() if not task.is_done()]:
        folder = trained.folder if actor == POLICY else _zero_action(trained, context.scratch)
        results = run_scenarios(
            folder,
            context.robot,
            missing,
            p.walk_seeds,
            first_seed,
            p.plant,
            context.workers,
            progress,
            seconds=p.walk_seconds,
        )
        if actor == ZERO:
            results = _without_beliefs(results)
        for result in results:
            task = tasks[result["scenario"]]
            fresh = task.begin()
            (fresh / _RESULT).write_text(json.dumps(result, allow_nan=False), encoding="utf-8")
            task.finish(fresh)
    return [json.loads((task.files / _RESULT).read_text(encoding="utf-8")) for task in tasks.values()]


def _decides(trained: Trained, actor: str) -> dict[str, Any]:
    """All that decides the policy which walks; the seed of a training does not change its prior."""
    return {key: value for key, value in trained.content.items() if actor == POLICY or key != "seed"}


def _zero_action(trained: Trained, scratch: Path) -> Path:
    """A policy that never corrects the gait prior of `trained`."""
    from hqpipe.rl.networks import LocomotionNetworks
    from hqpipe.rl.policy_io import load_policy, save_policy

    spec, _ = load_policy(trained.folder)
    folder = scratch / trained.controller.name / _ZERO_FOLDER
    save_policy(folder, spec, LocomotionNetworks(spec, output_gain=0.0))
    return folder
