"""A value of a document together with the place where it stands, so that every check of it can name file and field."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hqpipe.errors import ConfigError, HqpipeError, near_match

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_.-]{0,63}")
"""Names of robots, joints, legs and links: they become file names, table columns, labels of figures and HTML."""


@dataclass(frozen=True)
class Entry:
    """One value.

    Attributes:
        value: plain data, as of `hqpipe.files.documents`.
        file: where it was read. fix: what the user does about a wrong one.
        place: path of the field within the file, e.g. ``groups[0].mean``; empty for the whole file.
        kind: of the errors.
    """

    value: Any
    file: Path
    fix: str
    place: str = ""
    kind: type[HqpipeError] = ConfigError

    def error(self, problem: str, fix: str | None = None) -> HqpipeError:
        """An error that says "file: place: problem"."""
        where = f"{self.file}: {self.place}: " if self.place else f"{self.file}: "
        return self.kind(f"{where}{problem}", file=self.file, field=self.place or None, fix=fix or self.fix)

    def wrong(self, expected: str) -> HqpipeError:
        """An error that says what was expected and what was found."""
        return self.error(f"expected {expected}, got {_shown(self.value)}")

    def mapping(self, required: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Entry]:
        """Its fields: all of `required`, any of `optional`, no other.

        Raises:
            HqpipeError: of `kind`, as all methods here.
        """
        known = (*required, *optional)
        if not isinstance(self.value, dict):
            raise self.wrong(f"an object with {', '.join(known)}")
        for name in self.value:
            if name not in known:
                raise self._about(name, f"unknown field '{name[:80]}'{near_match(name[:80], known)}")
        for name in required:
            if name not in self.value:
                raise self._about(name, f"missing field '{name}'")
        return self.table()

    def _about(self, name: str, problem: str) -> HqpipeError:
        """An error of this object about the presence of one of its fields, which it names as the field."""
        found = self.error(problem)
        found.field = f"{self.place}.{name}" if self.place else name
        return found

    def table(self) -> dict[str, Entry]:
        """Its fields, whatever their names."""
        if not isinstance(self.value, dict):
            raise self.wrong("an object")
        return {name: self.inner(name) for name in self.value}

    def inner(self, name: str) -> Entry:
        """A field of an object."""
        place = f"{self.place}.{name}" if self.place else name
        return replace(self, value=self.value.get(name), place=place)

    def items(self, least: int = 0, most: int | None = None) -> list[Entry]:
        """The elements of a list."""
        if not isinstance(self.value, list):
            raise self.wrong("a list")
        if len(self.value) < least or (most is not None and len(self.value) > most):
            count = f"{least}" if most == least else f"at least {least}" if most is None else f"{least} to {most}"
            raise self.error(f"expected {count} elements, got {len(self.value)}")
        return [replace(self, value=item, place=f"{self.place}[{i}]") for i, item in enumerate(self.value)]

    def text(self, choices: Collection[str] = ()) -> str:
        """Text, one of `choices` where there are any."""
        if not isinstance(self.value, str):
            raise self.wrong(" or ".join(choices) or "text")
        if choices and self.value not in choices:
            hint = near_match(self.value, choices) if len(choices) > 1 else ""
            raise self.error(f"{_shown(self.value)}{hint}, expected {' or '.join(choices)}")
        return self.value

    def name(self) -> str:
        """A name: a letter, then up to 63 letters, digits, dots, dashes and underscores."""
        if not isinstance(self.value, str) or not NAME.fullmatch(self.value):
            raise self.wrong("a name: a letter, then letters, digits, '.', '-' or '_', at most 64")
        return self.value

    def names(self, most: int = 1000) -> tuple[str, ...]:
        """Names, at least one, each once."""
        found = [item.name() for item in self.items(1, most)]
        for index, name in enumerate(found):
            if name in found[:index]:
                raise self.error(f"'{name}' stands twice, expected distinct names")
        return tuple(found)

    def flag(self) -> bool:
        """true or false."""
        if not isinstance(self.value, bool):
            raise self.wrong("true or false")
        return self.value

    def number(self, lower: float = -math.inf, upper: float = math.inf, *, unit: str = "") -> float:
        """A number from `lower` to `upper`."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float) or not math.isfinite(self.value):
            raise self.wrong(f"a number{f' in {unit}' if unit else ''}")
        if not lower <= self.value <= upper:
            raise self.error(f"is {self.value:g}, expected {lower:g} to {upper:g}{f' {unit}' if unit else ''}")
        return float(self.value)

    def whole(self, lower: int, upper: int, reason: str = "") -> int:
        """A whole number from `lower` to `upper`; `reason` says why no more."""
        if type(self.value) is not int:
            raise self.wrong("a whole number")
        if not lower <= self.value <= upper:
            raise self.error(f"is {self.value}, expected {lower} to {upper}{f' ({reason})' if reason else ''}")
        return self.value

    def numbers(self, *shape: int | None, lower: float = -math.inf, upper: float = math.inf) -> list:
        """Nested lists of numbers, of the lengths in `shape`; None for any length."""
        first, *rest = shape
        least, most = (0, None) if first is None else (first, first)
        if not rest:
            return [item.number(lower, upper) for item in self.items(least, most)]
        return [item.numbers(*rest, lower=lower, upper=upper) for item in self.items(least, most)]

    def or_none(self, read: Callable[[Entry], Any]) -> Any:
        """`read` of it, None for null."""
        return None if self.value is None else read(self)


def _shown(value: Any) -> str:
    """A value as a message shows it, shortened."""
    if isinstance(value, dict):
        return "an object"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if value is None:
        return "null"
    shown = repr(value)
    return shown if len(shown) <= 60 else f"{shown[:57]}…"
