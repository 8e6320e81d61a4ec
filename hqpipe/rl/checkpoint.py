"""Checkpoints of a training: everything that decides how it goes on, in safetensors and JSON."""

from __future__ import annotations

import json
import os
import shutil
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from hqpipe.rl.ppo import ConcurrentPPO
from hqpipe.rl.task import LocomotionTask

_FOLDER = "checkpoint"
_OPTIMIZERS = ("optimizer", "critic_optimizer", "estimator_optimizer")


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
    """Replace the checkpoint in `folder` in one step; a kill leaves the old or the new one."""
    tensors = {f"policy/{k}": v for k, v in model.policy.state_dict().items()}
    for name in _OPTIMIZERS:
        tensors |= _optimizer_tensors(name, getattr(model.policy, name))
    tensors |= {f"best/{k}": v for k, v in progress.best.items()}
    tensors["torch_rng"] = torch.get_rng_state()
    numbers = {
        "fingerprint": fingerprint,
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
    new, old = folder / f".{_FOLDER}.new", folder / f".{_FOLDER}.old"
    for leftover in (new, old):
        shutil.rmtree(leftover, ignore_errors=True)
    new.mkdir(parents=True)
    save_file({k: v.clone().contiguous() for k, v in tensors.items()}, new / "tensors.safetensors")
    (new / "numbers.json").write_text(json.dumps(numbers), encoding="utf-8")
    if (folder / _FOLDER).exists():
        os.replace(folder / _FOLDER, old)
    os.replace(new, folder / _FOLDER)
    shutil.rmtree(old, ignore_errors=True)


def load_checkpoint(folder: Path, fingerprint: str, model: ConcurrentPPO, task: LocomotionTask) -> Progress | None:
    """Bring model and task to the last checkpoint; None if there is none of this very training."""
    for name in (_FOLDER, f".{_FOLDER}.old"):
        path = folder / name / "numbers.json"
        if path.is_file():
            numbers = json.loads(path.read_text(encoding="utf-8"))
            if numbers["fingerprint"] == fingerprint:
                return _restore(folder / name, numbers, model, task)
    return None


def _restore(folder: Path, numbers: dict[str, Any], model: ConcurrentPPO, task: LocomotionTask) -> Progress:
    tensors = load_file(folder / "tensors.safetensors")
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
