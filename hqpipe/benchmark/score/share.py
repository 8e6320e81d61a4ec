"""Shares of right answers with their intervals."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from hqpipe.identify.uncertainty import NORMAL


def wilson(right: int, of: int) -> list[float]:
    """95 % interval of a share; Wilson, JASA 22, 1927. [0, 1] if nothing was tried."""
    if of == 0:
        return [0.0, 1.0]
    share, weight = right / of, NORMAL**2 / of
    middle = (share + weight / 2) / (1 + weight)
    half = NORMAL * math.sqrt(share * (1 - share) / of + weight / (4 * of)) / (1 + weight)
    return [max(middle - half, 0.0), min(middle + half, 1.0)]


def tally(outcomes: Iterable[bool]) -> dict[str, Any]:
    """How many were right: right, of, share, ci95."""
    listed = list(outcomes)
    right, of = sum(listed), len(listed)
    return {"right": right, "of": of, "share": right / of if of else None, "ci95": wilson(right, of)}
