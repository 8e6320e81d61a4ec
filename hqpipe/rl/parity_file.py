"""parity.npz: observations, and the actions that torch gave for them, by which an exported graph is judged."""

from __future__ import annotations

import io
import math
import zipfile
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from hqpipe.errors import ConfigError
from hqpipe.files.documents import read_bytes

FILE = "parity.npz"
LARGEST = 2**28  # bytes; that of 512 observations has 0.1 MB, and of a million 240 MB
_NAMES = ("observations", "actions")
_FIX = "run hqpipe export again"


def save_parity(folder: Path, observations: np.ndarray, actions: np.ndarray) -> Path:
    """Write both arrays, (B, n) and (B, J), rad, float32."""
    path = folder / FILE
    np.savez(path, observations=observations, actions=actions)
    return path


def read_parity(folder: Path, joints: int) -> tuple[np.ndarray, np.ndarray]:
    """Observations (B, n) and actions (B, J) of `folder`/parity.npz, B at least 1.

    Args:
        joints: J.

    Raises:
        ConfigError: the file is missing or broken, or an array is missing, unknown, of another shape or type, or not finite.
            Sizes are compared with what the file holds before any array is made; pickled objects are refused.
    """
    path = folder / FILE
    content = read_bytes(path, _FIX, LARGEST)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            _check_members(archive, path)
            arrays = [_array(archive, name, path) for name in _NAMES]
    # What zipfile and numpy raise for broken archives, broken heads and unknown compressions.
    except (zipfile.BadZipFile, ValueError, OSError, EOFError, SyntaxError, TypeError, KeyError) as error:
        raise _wrong(path, None, f"not an NPZ file of hqpipe ({str(error)[:200]})") from error
    except (NotImplementedError, RuntimeError, OverflowError, MemoryError, RecursionError, zipfile.zlib.error) as error:
        raise _wrong(path, None, f"not an NPZ file of hqpipe ({str(error)[:200]})") from error
    observations, actions = arrays
    if not len(observations) or len(actions) != len(observations) or actions.shape[1] != joints:
        raise _wrong(
            path,
            "actions",
            f"actions have shape {actions.shape}, expected ({len(observations) or 'at least 1'}, {joints})",
        )
    return observations, actions


def _check_members(archive: zipfile.ZipFile, path: Path) -> None:
    found = archive.namelist()
    if sorted(found) != sorted(f"{name}.npy" for name in _NAMES):
        shown = ", ".join(found[:5])[:200] or "nothing"
        raise _wrong(path, None, f"holds {shown}, expected {' and '.join(_NAMES)}")
    if (size := sum(member.file_size for member in archive.infolist())) > LARGEST:
        raise _wrong(
            path, None, f"its arrays have {size} bytes, expected at most {LARGEST}, by far more than hqpipe writes"
        )


def _array(archive: zipfile.ZipFile, name: str, path: Path) -> np.ndarray:
    """(B, n) float32, made only where the declared shape is what the file holds."""
    member = archive.getinfo(f"{name}.npy")
    with archive.open(member) as stream:
        version = npy.read_magic(stream)
        if version != (1, 0):
            raise _wrong(path, name, f"{name} is in version {version} of the NPY format, expected (1, 0)")
        shape, fortran, dtype = npy.read_array_header_1_0(stream)
        if dtype != np.float32 or fortran or len(shape) != 2:
            raise _wrong(path, name, f"{name} is {dtype} of shape {shape}, expected a float32 table")
        held = member.file_size - stream.tell()
        if math.prod(shape) * dtype.itemsize != held:
            raise _wrong(path, name, f"{name} declares shape {shape}, but holds {held} bytes")
        values = np.frombuffer(stream.read(held), dtype=np.float32).reshape(shape)
    if not np.isfinite(values).all():
        raise _wrong(path, name, f"{name} holds numbers that are not finite")
    return values


def _wrong(path: Path, field: str | None, problem: str) -> ConfigError:
    return ConfigError(f"{path}: {problem}", file=path, field=field, fix=_FIX)
