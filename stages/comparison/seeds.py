"""The seeds of trainings: so many from the stage's own on, or those of a range."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import BeforeValidator

MOST = 1000  # trainings of each controller; each takes minutes
LARGEST = 2**32 - 1  # seed that NumPy and PyTorch take
_RANGE = re.compile(r"(-?\d{1,20}):(-?\d{1,20})")


def _checked(value: Any) -> int | str:
    """The value itself.

    Raises:
        ValueError: it is neither a number of trainings nor a range of seeds.
    """
    if isinstance(value, int) and not isinstance(value, bool):
        if not 1 <= value <= MOST:
            raise ValueError(f"expected 1 to {MOST} trainings (each takes minutes), got {str(value)[:80]}")
        return value
    found = _RANGE.fullmatch(value) if isinstance(value, str) else None
    if not found:
        given = "nothing" if value in (None, "") else repr(str(value)[:80])
        raise ValueError(
            f"expected a number of trainings, or a range of seeds A:B from A to B − 1, e.g. 0:3, got {given}"
        )
    first, end = map(int, found.groups())
    if first < 0 or end - 1 > LARGEST:
        raise ValueError(f"expected seeds from 0 to {LARGEST}, got {value}")
    if not 1 <= end - first <= MOST:
        count = max(end - first, 0)
        raise ValueError(f"expected 1 to {MOST} seeds (each training takes minutes), got {count} with {value}")
    return value


Seeds = Annotated[int | str, BeforeValidator(_checked)]
"""A number of trainings, or a range "A:B" of seeds without B."""


def training_seeds(seeds: int | str, first: int) -> list[int]:
    """The seeds that a `Seeds` means; a number counts from `first` on."""
    if isinstance(seeds, int):
        return [(first + i) % (LARGEST + 1) for i in range(seeds)]
    start, end = map(int, seeds.split(":"))
    return list(range(start, end))
