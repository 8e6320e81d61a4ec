"""The fields of an object in one of the files of an actuator model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hqpipe.errors import UsageError, near_match


def check_keys(raw: Any, keys: Sequence[str], where: str = "") -> None:
    """Refuse what is no object with exactly these fields.

    Args:
        raw: as read from JSON. where: path of the object within its file, empty for the whole.

    Raises:
        UsageError: names the object and the first field that is missing or unknown.
    """
    place = f"{where}: " if where else ""
    if not isinstance(raw, Mapping):
        raise UsageError(f"{place}expected an object with {', '.join(keys)}, got {type(raw).__name__}")
    for key in raw:
        if key not in keys:
            raise UsageError(f"{place}unknown field '{key}'{near_match(key, keys)}")
    if missing := [key for key in keys if key not in raw]:
        raise UsageError(f"{place}missing field '{missing[0]}'")
