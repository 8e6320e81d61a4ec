"""weights.safetensors: the tensors of a neural actuator model on disk."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hqpipe.actuators.net import check_tensors
from hqpipe.errors import ConfigError, UsageError

FILE = "weights.safetensors"
_DTYPE = "F64"  # safetensors' name of float64


def save_weights(tensors: Mapping[str, np.ndarray], path: Path) -> None:
    """Write float64 tensors; the same tensors give the same bytes."""
    from safetensors.numpy import save

    path.write_bytes(save({name: np.ascontiguousarray(value) for name, value in tensors.items()}))


def load_weights(path: Path, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, np.ndarray]:
    """Read the tensors named in `shapes`, and check that the file holds these and no others.

    Raises:
        ConfigError: the file is missing or broken, or a tensor is missing, unknown, of another shape or type, or not finite.
    """
    from safetensors import SafetensorError, safe_open

    if not path.is_file():
        raise ConfigError(f"{path}: no such file; a net needs its weights beside actuator.json")
    try:
        with safe_open(path, framework="numpy") as file:
            types = {name: file.get_slice(name).get_dtype() for name in file.keys()}
            if wrong := [name for name in types if types[name] != _DTYPE]:
                raise ConfigError(f"{path}: {wrong[0]} is of type {types[wrong[0]]}, expected {_DTYPE}")
            tensors = {name: file.get_tensor(name) for name in types}
    except SafetensorError as error:
        raise ConfigError(f"{path}: not a safetensors file ({error}); train the net again") from error
    try:
        check_tensors(tensors, shapes, str(path))
    except UsageError as error:
        raise ConfigError(str(error)) from error
    return tensors
