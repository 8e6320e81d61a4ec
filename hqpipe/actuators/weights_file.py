"""weights.safetensors: the tensors of a neural actuator model on disk."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hqpipe.actuators.net import check_tensors
from hqpipe.errors import ConfigError, UsageError
from hqpipe.files.tensors import read_tensors

FILE = "weights.safetensors"
_DTYPE = "F64"  # safetensors' name of float64
_FIX = "run hqpipe fit-actuator again; a net needs its own weights beside actuator.json"


def save_weights(tensors: Mapping[str, np.ndarray], path: Path) -> None:
    """Write float64 tensors; the same tensors give the same bytes."""
    from safetensors.numpy import save

    path.write_bytes(save({name: np.ascontiguousarray(value) for name, value in tensors.items()}))


def load_weights(path: Path, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, np.ndarray]:
    """Read the tensors named in `shapes`, and check that the file holds these and no others.

    Raises:
        ConfigError: as of `read_tensors`, or a spread is not positive.
    """
    tensors = read_tensors(path, shapes, _DTYPE, _FIX)
    try:
        check_tensors(tensors, shapes, str(path))
    except UsageError as error:
        raise ConfigError(error.message, file=path, field=error.field, fix=_FIX) from error
    return tensors
