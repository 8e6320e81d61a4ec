"""Tensors of a safetensors file, checked against the shapes that are expected before any of them is read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hqpipe.errors import ConfigError, near_match
from hqpipe.files.documents import check_file

LARGEST = 2**30  # bytes; nets of hqpipe have some hundred kB
_TYPES = {"F64": np.float64, "F32": np.float32}


def read_tensors(path: Path, shapes: Mapping[str, tuple[int, ...]], dtype: str, fix: str) -> dict[str, np.ndarray]:
    """The tensors named in `shapes`, in that order; the file must hold these and no others.

    Args:
        dtype: of all of them as safetensors spells it, F64 or F32. fix: what the user does about a wrong file.

    Raises:
        ConfigError: the file is missing or broken, or a tensor is missing, unknown, of another shape or type, or not finite.
    """
    from safetensors import SafetensorError, safe_open

    def error(problem: str, field: str | None = None) -> ConfigError:
        return ConfigError(f"{path}: {problem}", file=path, field=field, fix=fix)

    check_file(path, fix, LARGEST)
    try:
        with safe_open(path, framework="numpy") as file:
            found = list(file.keys())
            for name in found:
                if name not in shapes:
                    raise error(f"unknown tensor '{name[:80]}'{near_match(name[:80], shapes)}", name[:80])
            for name, shape in shapes.items():
                if name not in found:
                    raise error(f"missing tensor '{name}' (needs {', '.join(shapes)})", name)
                head = file.get_slice(name)
                if head.get_dtype() != dtype:
                    raise error(f"{name} is of type {head.get_dtype()}, expected {dtype}", name)
                if tuple(head.get_shape()) != shape:
                    raise error(f"{name} has shape {tuple(head.get_shape())}, expected {shape}", name)
            tensors = {name: file.get_tensor(name) for name in shapes}
    except (SafetensorError, OSError, MemoryError) as cause:
        raise error(f"not a safetensors file ({str(cause)[:200]})") from cause
    for name, value in tensors.items():
        if not np.isfinite(value).all():
            raise error(f"{name} holds numbers that are not finite", name)
    return {name: value.astype(_TYPES[dtype], copy=False) for name, value in tensors.items()}
