"""Lazy registries: a literal table of name → ``"module:Attribute"``, imported on first use."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any

from hqpipe.errors import UsageError, near_match


def load(target: str) -> Any:
    """Import ``"module:Attribute"`` and return the attribute."""
    module, _, attribute = target.partition(":")
    return getattr(import_module(module), attribute)


class Registry(Mapping[str, Any]):
    """A read-only table whose values are imported when they are looked up.

    Args:
        kind: what one entry is called in error messages, e.g. ``"actuator model"``.
        table: name → ``"module:Attribute"``.
    """

    def __init__(self, kind: str, table: dict[str, str]) -> None:
        self.kind = kind
        self._table = dict(table)

    def __getitem__(self, name: str) -> Any:
        if name not in self._table:
            known = ", ".join(self._table)
            raise UsageError(f"unknown {self.kind} '{name}'{near_match(name, self._table)} (known: {known})")
        return load(self._table[name])

    def __contains__(self, name: object) -> bool:
        return name in self._table

    def __iter__(self) -> Iterator[str]:
        return iter(self._table)

    def __len__(self) -> int:
        return len(self._table)
