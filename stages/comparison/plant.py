"""The trained controllers of compare on the reference plant, each beside its gait prior alone, walk by walk the same."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hqpipe.stages.comparison.train import Trained
from hqpipe.system import durable

POLICY, ZERO = "policy", "zero_action"
_ZERO_FOLDER = "zero_action"
_RESULTS = "results.json"
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
    """Results of `run_scenarios`, kept in scratch so that a killed stage does not walk again."""
    from hqpipe.stages.walks.scenarios import run_scenarios

    kept, p = trained.scratch / f"walked_{actor}", context.params
    if wrong := durable.damage(kept):
        if kept.exists():
            print(f"warning: {kept} is damaged ({wrong}): walked again", file=sys.stderr, flush=True)
        folder = trained.folder if actor == POLICY else _zero_action(trained)
        # Seeds apart from those of collect and validate, so that no walk repeats one that was fitted to or judged by.
        results = run_scenarios(
            folder,
            context.robot,
            p.scenarios,
            p.walk_seeds,
            1000 * context.seed + 700,
            p.plant,
            context.workers,
            progress,
            seconds=p.walk_seconds,
        )
        if actor == ZERO:
            results = _without_beliefs(results)
        fresh = durable.new_folder(kept)
        (fresh / _RESULTS).write_text(json.dumps(results, allow_nan=False), encoding="utf-8")
        durable.write_checksums(fresh)
        durable.move_into_place(fresh, kept)
    return json.loads((kept / _RESULTS).read_text(encoding="utf-8"))


def _zero_action(trained: Trained) -> Path:
    """A policy that never corrects the gait prior of `trained`."""
    from hqpipe.rl.networks import LocomotionNetworks
    from hqpipe.rl.policy_io import load_policy, save_policy

    spec, _ = load_policy(trained.folder)
    folder = trained.scratch / _ZERO_FOLDER
    save_policy(folder, spec, LocomotionNetworks(spec, output_gain=0.0))
    return folder
