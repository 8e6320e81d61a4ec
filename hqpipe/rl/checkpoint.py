"""Checkpoints of a training: everything that decides how it goes on, in safetensors and JSON, with checksums.

Each is a folder of its own, ``checkpoint_<iteration>``; the last two are kept, so that there is one to fall back on.
"""

from __future__ import annotations

import json
import math
import sys
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from hqpipe.rl.evaluate import Evaluation
from hqpipe.rl.ppo import ConcurrentPPO
from hqpipe.rl.task import LocomotionTask
from hqpipe.system import durable

_PREFIX = "checkpoint_"
_KEPT = 2
_TENSORS, _NUMBERS = "tensors.safetensors", "numbers.json"
_OPTIMIZERS = ("optimizer", "critic_optimizer", "estimator_optimizer")
# What reading and restoring a checkpoint of wrong content raises.
_DAMAGE = (
    AttributeError,
    IndexError,
    KeyError,
    OSError,
    OverflowError,
    RecursionError,
    RuntimeError,
    SafetensorError,
    TypeError,
    ValueError,
)


@dataclass
class Progress:
    """Where a training is, besides what the model and the task hold.

    Attributes:
        iteration: finished iterations.
        rows: of the metrics table. best: networks with the best score; best_evaluation and best_iteration belong to
            them.
        baseline: evaluation of the prior alone.
    """

    iteration: int = 0
    rows: list[dict[str, Any]] = field(default_factory=list)
    best: dict[str, Tensor] = field(default_factory=dict)
    best_evaluation: dict[str, Any] = field(default_factory=dict)
    best_iteration: int = 0
    baseline: dict[str, Any] = field(default_factory=dict)


def save_checkpoint(
    folder: Path, fingerprint: str, model: ConcurrentPPO, task: LocomotionTask, progress: Progress
) -> None:
    """Add a checkpoint to `folder`; the one before goes only when two newer ones are on the disk."""
    tensors, numbers = _state(model, task, progress)
    path = folder / f"{_PREFIX}{progress.iteration:08d}"
    new = durable.new_folder(path)
    (new / _TENSORS).write_bytes(save(tensors))
    (new / _NUMBERS).write_text(json.dumps({"fingerprint": fingerprint, **numbers}), encoding="utf-8")
    durable.write_checksums(new)
    durable.move_into_place(new, path)
    later = [other for other in _checkpoints(folder) if other.name > path.name]
    earlier = [other for other in _checkpoints(folder) if other.name <= path.name]
    for other in (*later, *earlier[_KEPT:]):
        durable.remove(other)


def load_checkpoint(folder: Path, fingerprint: str, model: ConcurrentPPO, task: LocomotionTask) -> Progress | None:
    """Bring model and task to the last intact checkpoint; None if there is none of this very training.

    A damaged one is passed over, in favour of the one before, with a line on standard error.
    """
    durable.remove_leftovers(folder)
    fresh = _state(model, task, Progress())
    damaged = []
    for path in _checkpoints(folder):
        try:
            progress = _load(path, fingerprint, model, task)
        except _DAMAGE as error:
            damaged.append(f"{path} is damaged ({_one_line(error)})")
            _restore(*fresh, model, task)
            continue
        if progress is not None:
            _say(damaged, f"the training goes on from the one before, iteration {progress.iteration}")
            return progress
    _say(damaged, "the training starts anew")
    return None


def _say(damaged: list[str], what_follows: str) -> None:
    if damaged:
        print(f"warning: checkpoint {', '.join(damaged)}: {what_follows}", file=sys.stderr, flush=True)


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split())[:120]
    return text if isinstance(error, ValueError) else f"{type(error).__name__}: {text}"


def _checkpoints(folder: Path) -> list[Path]:
    """The newest first."""
    return sorted(folder.glob(f"{_PREFIX}*"), reverse=True)


def _load(path: Path, fingerprint: str, model: ConcurrentPPO, task: LocomotionTask) -> Progress | None:
    """Restore one checkpoint; None if it belongs to another training. Raises one of `_DAMAGE`."""
    if wrong := durable.damage(path):
        raise ValueError(wrong)
    numbers = json.loads((path / _NUMBERS).read_text(encoding="utf-8"))
    if numbers["fingerprint"] != fingerprint:
        return None
    tensors = load_file(path / _TENSORS)
    _check(tensors, numbers, model)
    return _restore(tensors, numbers, model, task)


def _check(tensors: dict[str, Tensor], numbers: dict[str, Any], model: ConcurrentPPO) -> None:
    """Raise ValueError for values that the model would take and that make no sense."""
    iteration, rows, rate = numbers["iteration"], numbers["rows"], numbers["learning_rate"]
    if type(iteration) is not int or iteration < 1 or not isinstance(rows, list) or len(rows) != iteration:
        raise ValueError(f"iteration {iteration!r} does not fit the metrics table")
    if not isinstance(rate, float) or not (math.isfinite(rate) and rate > 0):
        raise ValueError(f"learning_rate is {rate!r}, expected a positive number")
    for name in ("updates", "num_timesteps", "best_iteration"):
        if type(numbers[name]) is not int or numbers[name] < 0:
            raise ValueError(f"{name} is {numbers[name]!r}, expected a count")
    if not all(isinstance(row, dict) for row in rows) or not all({"r", "l"} <= e.keys() for e in numbers["episodes"]):
        raise ValueError("the metrics table or the episodes are not mappings")
    Evaluation.from_dict(numbers["baseline"])
    best, wanted = _under("best/", tensors), model.policy.networks.state_dict()
    if best and (best.keys() != wanted.keys() or any(best[k].shape != wanted[k].shape for k in wanted)):
        raise ValueError("the best networks are not of this policy")
    if best and not math.isfinite(Evaluation.from_dict(numbers["best_evaluation"]).score):
        raise ValueError("the evaluation of the best networks has no score")
    for name in _OPTIMIZERS:
        _check_optimizer(name, getattr(model.policy, name), tensors)


def _check_optimizer(name: str, optimizer: torch.optim.Optimizer, tensors: dict[str, Tensor]) -> None:
    """Every moment has the shape of its parameter; a step is a number."""
    shapes = [parameter.shape for group in optimizer.param_groups for parameter in group["params"]]
    for key, value in _under(f"{name}/", tensors).items():
        index, _, entry = key.partition("/")
        if value.shape != (torch.Size() if entry == "step" else shapes[int(index)]):
            raise ValueError(f"{name}/{key} has shape {tuple(value.shape)}")


def _state(model: ConcurrentPPO, task: LocomotionTask, progress: Progress) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Tensors and numbers of a training, as `_restore` takes them."""
    tensors = {f"policy/{k}": v for k, v in model.policy.state_dict().items()}
    for name in _OPTIMIZERS:
        tensors |= _optimizer_tensors(name, getattr(model.policy, name))
    tensors |= {f"best/{k}": v for k, v in progress.best.items()}
    tensors["torch_rng"] = torch.get_rng_state()
    numbers = {
        "iteration": progress.iteration,
        "rows": progress.rows,
        "best_evaluation": progress.best_evaluation,
        "best_iteration": progress.best_iteration,
        "baseline": progress.baseline,
        "learning_rate": model.adaptive_learning_rate,
        "updates": model._n_updates,
        "num_timesteps": model.num_timesteps,
        "episodes": list(model.ep_info_buffer),
        "task_rng": task.rng.bit_generator.state,
    }
    return {k: v.clone().contiguous() for k, v in tensors.items()}, numbers


def _restore(
    tensors: dict[str, Tensor], numbers: dict[str, Any], model: ConcurrentPPO, task: LocomotionTask
) -> Progress:
    model.policy.load_state_dict(_under("policy/", tensors))
    for name in _OPTIMIZERS:
        _restore_optimizer(name, getattr(model.policy, name), tensors)
    model.adaptive_learning_rate = numbers["learning_rate"]
    model._n_updates = numbers["updates"]
    model.num_timesteps = numbers["num_timesteps"]
    model.ep_info_buffer = deque(numbers["episodes"], maxlen=model.ep_info_buffer.maxlen)
    task.rng.bit_generator.state = numbers["task_rng"]
    torch.set_rng_state(tensors["torch_rng"])
    return Progress(
        iteration=numbers["iteration"],
        rows=numbers["rows"],
        best=_under("best/", tensors),
        best_evaluation=numbers["best_evaluation"],
        best_iteration=numbers["best_iteration"],
        baseline=numbers["baseline"],
    )


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}


def _optimizer_tensors(name: str, optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    state = optimizer.state_dict()["state"]
    return {f"{name}/{i}/{key}": value for i, entry in state.items() for key, value in entry.items()}


def _restore_optimizer(name: str, optimizer: torch.optim.Optimizer, tensors: dict[str, Tensor]) -> None:
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in _under(f"{name}/", tensors).items():
        index, _, entry = key.partition("/")
        state.setdefault(int(index), {})[entry] = value
    groups = optimizer.state_dict()["param_groups"]
    optimizer.load_state_dict({"state": state, "param_groups": groups})
