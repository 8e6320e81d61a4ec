"""NumPy arrays as a pickle describes them, put together without calling anything that the file names.

An array is pickled as a call of `_reconstruct`, whose result is then given its state: version, shape, type, order and bytes
(numpy/_core/src/multiarray/methods.c, array_reduce). Protocols up to 2 write the bytes as text in Latin-1.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

_CODE = re.compile(r"[fiu][1248]|b1")  # numbers and truths; no objects, no text, no records
_MOST = 2**20  # elements; arrays of samples are tensors in such files, these are settings


@dataclass(eq=False)
class PickledType:
    """A type of numbers; `order` is "<", ">" or "|"."""

    code: str
    order: str = "|"

    def set_state(self, state: Any) -> bool:
        """Take what the pickle states of it; False where that is of another form."""
        match state:
            case (int(), "<" | ">" | "|" as order, None, None, None, int(), int(), int()):
                self.order = order
                return True
        return False


@dataclass(eq=False)
class PickledArray:
    """An array, without values until its state is known."""

    values: np.ndarray | None = None

    def set_state(self, state: Any) -> bool:
        """Take shape, type and bytes; False where they are of another form or do not fit each other."""
        match state:
            case (int(), tuple() as shape, PickledType() as kind, bool() as by_columns, bytes() as content):
                if not all(type(n) is int and n >= 0 for n in shape) or len(shape) > 2:
                    return False
                dtype = np.dtype(f"{kind.order}{kind.code}")
                count = math.prod(shape)
                if count > _MOST or len(content) != count * dtype.itemsize:
                    return False
                values = np.frombuffer(content, dtype).reshape(shape, order="F" if by_columns else "C")
                self.values = values.astype(np.float64)
                return True
        return False


def type_of(arguments: Any) -> PickledType | None:
    """The type that `numpy.dtype(code, align, copy)` makes; None for anything but numbers."""
    match arguments:
        case (str() as code, bool() | int(), bool() | int()) if _CODE.fullmatch(code):
            return PickledType(code)
    return None


def bytes_of(arguments: Any) -> bytes | None:
    """What `_codecs.encode(text, "latin1")` makes; None for anything else."""
    match arguments:
        case (str() as text, "latin1"):
            try:
                return text.encode("latin-1")
            except UnicodeEncodeError:
                return None
    return None
