"""A policy as a folder: policy.safetensors (weights) and policy.json (everything else)."""

from __future__ import annotations

import json
from pathlib import Path

from safetensors.torch import load_file, save_file

from hqpipe.errors import ConfigError
from hqpipe.rl.networks import LocomotionNetworks
from hqpipe.rl.policy_spec import PolicySpec

WEIGHTS, SPEC = "policy.safetensors", "policy.json"


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
        ConfigError: a file is missing, or weights and spec do not fit together.
    """
    for name in (SPEC, WEIGHTS):
        if not (folder / name).is_file():
            raise ConfigError(f"{folder / name}: no such file; expected the folder of a trained policy")
    try:
        raw = json.loads((folder / SPEC).read_text(encoding="utf-8"))
    except ValueError as error:
        raise ConfigError(f"{folder / SPEC}: not JSON ({error})") from error
    spec = PolicySpec.from_dict(raw, str(folder / SPEC))
    networks = LocomotionNetworks(spec)
    try:
        networks.load_state_dict(load_file(folder / WEIGHTS))
    except RuntimeError as error:
        raise ConfigError(f"{folder / WEIGHTS}: does not fit {SPEC}: {error}") from error
    return spec, networks.eval()
