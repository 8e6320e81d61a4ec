"""Files of torch.save, as the tests write them: the zip archive of torch, with a pickle of their own making."""

from __future__ import annotations

import io
import pickle
import zipfile
from pathlib import Path

import numpy as np


def write_torch(path: Path, tensors: dict[str, np.ndarray]) -> None:
    """The same bytes that torch.save writes."""
    import torch

    torch.save({name: torch.from_numpy(np.ascontiguousarray(values)) for name, values in tensors.items()}, path)


def write_program(path: Path, program: bytes, storages: dict[str, bytes] | None = None) -> None:
    """An archive as torch makes it, around any pickle."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("log/data.pkl", program)
        archive.writestr("log/byteorder", "little")
        archive.writestr("log/version", "3\n")
        for key, content in (storages or {}).items():
            archive.writestr(f"log/data/{key}", content)


class Call:
    """Pickles to a call of `function(*arguments)` while it is loaded."""

    def __init__(self, function: object, *arguments: object) -> None:
        self.function, self.arguments = function, arguments

    def __reduce__(self) -> tuple:
        return self.function, self.arguments


def dumped(content: object, protocol: int = 2) -> bytes:
    stream = io.BytesIO()
    pickle.Pickler(stream, protocol).dump(content)
    return stream.getvalue()
