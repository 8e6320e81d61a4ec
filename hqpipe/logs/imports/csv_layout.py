"""How a text table is laid out: delimiter, decimal sign, header, units, first row of numbers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from hqpipe.logs.imports.units import UNITS

DELIMITERS = (",", ";", "\t", "|")
BLANKS = " "  # columns that any number of blanks separates
MISSING = ("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "?")
_TRUTHS = ("true", "false")
_UNIT_LABELS = ("unit", "units")  # what a row of units may begin with
COMMENT = re.compile(r"^\s*(#+|%+|//)\s*")
_POINT = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?inf(inity)?", re.IGNORECASE)
_COMMA = re.compile(r"[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?|[+-]?inf(inity)?", re.IGNORECASE)
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|[+-]\d\d:?\d\d)?")
_BRACKETS = re.compile(r"^[\[(<{]\s*(.*?)\s*[\])>}]$")
_IN_NAME = re.compile(r"[\[(]\s*([^\[\]()\d][^\[\]()]*?|1)\s*[\])]\s*$")  # not the index of q[3]
_ALIKE = 3  # rows of as many cells that make a table; fewer may be there in all


@dataclass(frozen=True)
class Layout:
    """Where in a text table is what.

    Attributes:
        delimiter: one character, " " for any number of blanks. decimal: "." or ",".
        names: one per column of the rows. units: column → unit as stated, "" where it is not.
        first: index of the first line with numbers. kinds: per column "number", "date", "truth" or "text".
        notes: on what was skipped or lacks. unclear: how header and rows differ in length, "" if they do not.
    """

    delimiter: str
    decimal: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    first: int
    kinds: tuple[str, ...]
    notes: tuple[str, ...] = ()
    unclear: str = ""


def find_layout(lines: Sequence[str]) -> Layout | None:
    """The layout of a table, or None if no line holds numbers.

    Args:
        lines: the first ones of the file, without line ends.
    """
    best: tuple[int, int, str, str, int] | None = None
    for rank, (delimiter, decimal) in enumerate(_candidates()):
        found = _first_row(lines, delimiter, decimal)
        if found is None:
            continue
        row, cells, numbers = found
        score = (numbers, -rank)
        if best is None or score > best[:2]:
            best = (*score, delimiter, decimal, row)
    if best is None:
        return None
    return _described(lines, *best[2:])


def _candidates() -> list[tuple[str, str]]:
    """Pairs of delimiter and decimal sign, the likelier first."""
    return [(d, ".") for d in (*DELIMITERS, BLANKS)] + [(d, ",") for d in (";", "\t", "|", BLANKS)]


def cells_of(line: str, delimiter: str) -> list[str]:
    """The cells of a line; quotes are honoured, blanks around cells dropped."""
    if delimiter == BLANKS:
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    found, cell, quoted = [], [], False
    for sign in line:
        if sign == '"':
            quoted = not quoted
        elif sign == delimiter and not quoted:
            found.append("".join(cell).strip())
            cell = []
        else:
            cell.append(sign)
    return [*found, "".join(cell).strip()]


def _kind(cell: str, decimal: str) -> str:
    """ "number", "missing", "date", "truth" or "text"."""
    if cell.casefold() in MISSING:
        return "missing"
    if (_POINT if decimal == "." else _COMMA).fullmatch(cell):
        return "number"
    if _DATE.fullmatch(cell):
        return "date"
    return "truth" if cell.casefold() in _TRUTHS else "text"


def _first_row(lines: Sequence[str], delimiter: str, decimal: str) -> tuple[int, int, int] | None:
    """Index of the first line of the table, its cells, and the numbers in the first rows."""
    rows = [
        (i, [_kind(c, decimal) for c in cells_of(line, delimiter)])
        for i, line in enumerate(lines)
        if line.strip() and not COMMENT.match(line)
    ]
    for at, (index, kinds) in enumerate(rows):
        numbers = sum(kind in ("number", "date") for kind in kinds)
        if not numbers or 2 * kinds.count("text") > len(kinds):
            continue
        following = rows[at : at + _ALIKE]
        if any(2 * each.count("text") > len(each) for _, each in following):
            continue  # settings above the header
        if all(len(each) == len(kinds) for _, each in following[:-1]):  # the last line may be cut
            return index, len(kinds), sum(k in ("number", "date") for _, each in following for k in each)
    return None


def _described(lines: Sequence[str], delimiter: str, decimal: str, first: int) -> Layout:
    rows = [cells_of(line, delimiter) for line in lines[first:] if line.strip() and not COMMENT.match(line)]
    width = Counter(map(len, rows)).most_common(1)[0][0]
    rows = [row for row in rows if len(row) == width]
    kinds = tuple(_column_kind([_kind(row[c], decimal) for row in rows]) for c in range(width))
    header, units, above = _header(lines, delimiter, decimal, first, width)
    notes = [f"{above} lines above the header skipped"] if above else []
    if header is None:
        header = [f"column{c}" for c in range(width)]
        notes.append("no header: the columns are called column0, column1, …")
    while len(header) > width and not header[-1]:
        header.pop()  # a delimiter at the end of the header alone
    unclear = ""
    if len(header) != width and not (len(header) == width - 1 and all(not row[-1] for row in rows)):
        unclear = f"the header has {len(header)} names, the rows have {width} cells"
    names = _distinct([*header[:width], *[""] * (width - len(header))])
    units = [*units[:width], *[""] * (width - len(units))]
    stated = tuple(unit or _unit_in(name) for name, unit in zip(names, units, strict=True))
    return Layout(delimiter, decimal, tuple(names), stated, first, kinds, tuple(notes), unclear)


def _column_kind(kinds: list[str]) -> str:
    present = Counter(kind for kind in kinds if kind != "missing")
    if not present:
        return "number"
    most, count = present.most_common(1)[0]
    return most if 2 * count > sum(present.values()) else "text"


def _header(
    lines: Sequence[str], delimiter: str, decimal: str, first: int, width: int
) -> tuple[list[str] | None, list[str], int]:
    """Names, units as a row of their own states them, and how many lines stand above the names."""
    above = [i for i in range(first) if lines[i].strip()]
    units: list[str] = []
    for place, i in enumerate(reversed(above)):
        cells = cells_of(COMMENT.sub("", lines[i]), delimiter)
        if len(cells) < min(width, 2) or abs(len(cells) - width) > max(1, width // 2):
            continue
        kinds = [_kind(cell, decimal) for cell in cells]
        if "text" not in kinds or "number" in kinds:
            continue
        bare = [m[1] if (m := _BRACKETS.match(cell)) else cell for cell in cells]
        bare = ["" if cell.casefold() in _UNIT_LABELS else cell for cell in bare]
        named = sum(cell in UNITS for cell in bare)
        more_above = place + 1 < len(above)
        if not units and more_above and 2 * named > sum(bool(cell) for cell in bare):
            units = bare
            continue
        return cells, units, above.index(i)
    return (units, [], 0) if units else (None, [], 0)


def _unit_in(name: str) -> str:
    """The unit in a name such as `pos [deg]`, or ""."""
    match = _IN_NAME.search(name)
    return match[1] if match else ""


def _distinct(names: Sequence[str]) -> list[str]:
    """Names of columns, each once: `q`, `q (2)`; a blank one becomes `column3`."""
    found: list[str] = []
    for index, name in enumerate(names):
        first = free = name.strip() or f"column{index}"
        count = 1
        while free in found:
            count += 1
            free = f"{first} ({count})"
        found.append(free)
    return found
