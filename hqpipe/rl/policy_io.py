"""A policy as a folder: policy.safetensors (weights) and policy.json (everything else)."""

from __future__ import annotations

import json
from pathlib import Path

import torch
from safetensors.torch import save_file

from hqpipe.files.documents import read_json
from hqpipe.files.entries import Entry
from hqpipe.files.tensors import read_tensors
from hqpipe.rl.networks import LocomotionNetworks
from hqpipe.rl.policy_fields import read_spec
from hqpipe.rl.policy_spec import PolicySpec

WEIGHTS, SPEC = "policy.safetensors", "policy.json"
_FIX = "give the folder of a trained policy, or train it again"


def save_policy(folder: Path, spec: PolicySpec, networks: LocomotionNetworks) -> None:
    """Write both files into `folder`; the same policy gives the same bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    tensors = {name: value.detach().contiguous() for name, value in networks.state_dict().items()}
    save_file(tensors, folder / WEIGHTS)
    text = json.dumps(spec.to_dict(), indent=2, ensure_ascii=False) + "\n"
    (folder / SPEC).write_text(text, encoding="utf-8")


def load_policy(folder: Path) -> tuple[PolicySpec, LocomotionNetworks]:
    """Read a folder of `save_policy`; the networks are in evaluation mode.

    Raises:
        ConfigError: a file is missing or broken, or weights and spec do not fit together.
    """
    path = folder / SPEC
    spec = read_spec(Entry(read_json(path, _FIX), path, _FIX))
    with torch.device("meta"):  # shapes alone: nothing is made before the weights are known to have them
        shapes = {name: tuple(value.shape) for name, value in LocomotionNetworks(spec).state_dict().items()}
    tensors = read_tensors(folder / WEIGHTS, shapes, "F32", f"{_FIX}; it does not fit {SPEC}")
    networks = LocomotionNetworks(spec)
    networks.load_state_dict({name: torch.from_numpy(value) for name, value in tensors.items()})
    return spec, networks.eval()
