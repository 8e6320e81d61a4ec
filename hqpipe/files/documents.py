"""JSON, YAML and CSV files as plain data; whatever can be wrong with such a file is an error that names it and the remedy.

What comes back holds text, finite numbers, true, false and null in lists and mappings with text keys, and nothing else, of
bounded size and depth; what the fields mean is for `hqpipe.files.entries` and the reader of the format.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

from hqpipe.errors import ConfigError, HqpipeError

LARGEST_JSON = 64 * 2**20  # bytes; the largest that hqpipe writes, traces.json of a long log set, has a few MB
LARGEST_YAML = 2**20  # bytes; files typed by hand have kilobytes, and PyYAML takes a second for 100 kB
DEEPEST = 64  # levels; hqpipe writes at most eight
MOST_VALUES = (
    8_000_000  # LARGEST_JSON holds no more numbers of eight characters; aliases of YAML could spell any number
)
LARGEST_INTEGER = 2**63 - 1  # what an int64 holds; longer ones overflow where they become array elements or floats
_DIGITS = 20  # of LARGEST_INTEGER, with sign

# What PyYAML raises for tagged values such as `!!int ""` or dates such as 2001-99-99.
_BAD_VALUE = (ValueError, KeyError, IndexError, AttributeError, TypeError, OverflowError)


class _Bad(Exception):
    """What is wrong with a document, and the field where it is."""

    def __init__(self, message: str, field: str | None = None) -> None:
        super().__init__(message)
        self.field = field


def check_file(path: Path, fix: str, largest: int, kind: type[HqpipeError] = ConfigError) -> None:
    """Refuse what is no regular file of at most `largest` bytes that this user may read.

    Raises:
        HqpipeError: of `kind`, with `fix` as the remedy.
    """
    try:
        size = path.stat().st_size
        if path.is_dir():
            raise _Bad("is a folder, expected a file")
        if not path.is_file():
            raise _Bad("is no regular file")  # a pipe would wait for a writer for ever
        if size == 0:
            raise _Bad("is empty")
        if size > largest:
            raise _Bad(f"has {size} bytes, expected at most {largest}, by far more than hqpipe writes")
    except FileNotFoundError as error:
        raise kind(f"{path}: no such file", file=path, fix=fix) from error
    except (OSError, ValueError) as error:  # a name that is too long, a link to itself, a NUL in the name
        raise kind(f"{path}: cannot be read ({_reason(error)})", file=path, fix=fix) from error
    except _Bad as error:
        raise kind(f"{path}: {error}", file=path, fix=fix) from error


def read_bytes(path: Path, fix: str, largest: int, kind: type[HqpipeError] = ConfigError) -> bytes:
    """The content of a file that `check_file` accepts; errors as there."""
    check_file(path, fix, largest, kind)
    try:
        return path.read_bytes()
    except (OSError, MemoryError) as error:
        raise kind(f"{path}: cannot be read ({_reason(error)})", file=path, fix=fix) from error


def read_text(path: Path, fix: str, largest: int, kind: type[HqpipeError] = ConfigError) -> str:
    """The same as text in UTF-8, with or without a byte order mark."""
    content = read_bytes(path, fix, largest, kind)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        message = f"{path}:{line}: not UTF-8 text ({error.reason} at byte {error.start})"
        raise kind(message, file=path, fix=fix) from error


def read_json(path: Path, fix: str, kind: type[HqpipeError] = ConfigError) -> Any:
    """The content of a JSON file.

    Args:
        fix: what the user does about a file that cannot be read, e.g. "run hqpipe diagnose again".
        kind: of error.

    Raises:
        HqpipeError: of `kind`: no such file, not JSON, a field that stands twice, a number that is not finite or too long, or
            too large or deep.
    """
    text = read_text(path, fix, LARGEST_JSON, kind)
    try:
        content = json.loads(
            text, object_pairs_hook=_distinct, parse_int=_integer, parse_constant=_not_a_number, strict=True
        )
        check_plain(content)
    except json.JSONDecodeError as error:
        message = f"{path}:{error.lineno}: not JSON ({error.msg} at column {error.colno})"
        raise kind(message, file=path, fix=fix) from error
    except _Bad as error:
        raise kind(f"{path}: {error}", file=path, field=error.field, fix=fix) from error
    except (RecursionError, MemoryError) as error:
        message = f"{path}: nested too deep, or too large"
        raise kind(message, file=path, fix=fix) from error
    return content


def read_yaml_mapping(path: Path, fix: str, kind: type[HqpipeError] = ConfigError) -> dict[str, Any]:
    """The mapping that a YAML file holds.

    Args:
        fix: what the user does about a file that cannot be read. kind: of error.

    Raises:
        HqpipeError: of `kind`: no such file, not YAML, no mapping, a field that stands twice or is no text, a value that is no
            plain data, a number that is not finite or too long, or too large or deep.
    """
    text = read_text(path, fix, LARGEST_YAML, kind)
    try:
        loader = yaml.SafeLoader(text)  # the C loader overflows the stack on deep nesting
        node = loader.get_single_node()
        if not isinstance(node, yaml.MappingNode):
            what = "nothing" if node is None else "a list" if isinstance(node, yaml.SequenceNode) else "one value"
            raise _Bad(f"expected a mapping of fields, got {what}")
        _check_nodes(node)
        content = loader.construct_document(node)
        check_plain(content)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = "" if mark is None else f":{mark.line + 1}"
        problem = getattr(error, "problem", None) or " ".join(str(error).split())
        raise kind(f"{path}{place}: not valid YAML ({problem})", file=path, fix=fix) from error
    except _Bad as error:
        raise kind(f"{path}: {error}", file=path, field=error.field, fix=fix) from error
    except (RecursionError, MemoryError) as error:
        raise kind(f"{path}: nested too deep, or too large", file=path, fix=fix) from error
    except _BAD_VALUE as error:
        raise kind(f"{path}: a value that YAML cannot read ({_reason(error)})", file=path, fix=fix) from error
    return content


def read_table(path: Path, columns: Sequence[str], fix: str, kind: type[HqpipeError] = ConfigError) -> list[dict]:
    """The rows of a CSV file as column → text.

    Args:
        columns: names that it must have. fix: what the user does about a file that cannot be read. kind: of error.

    Raises:
        HqpipeError: of `kind`: no such file, no such column, or a row that is longer or shorter than the head.
    """
    text = read_text(path, fix, LARGEST_JSON, kind)
    try:
        reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
        head = reader.fieldnames or ()
        for name in columns:
            if name not in head:
                raise kind(f"{path}: no column '{name}'", file=path, field=name, fix=fix)
        rows = []
        for row in reader:
            if None in row or None in row.values():
                raise kind(f"{path}:{reader.line_num}: expected {len(head)} cells as in the head", file=path, fix=fix)
            rows.append(row)
    except csv.Error as error:
        raise kind(f"{path}:{reader.line_num + 1}: not CSV ({error})", file=path, fix=fix) from error
    return rows


def check_plain(content: Any) -> None:
    """Refuse what is no plain data of bounded size; goes through it without recursion."""
    waiting: list[Iterator[tuple[str, Any]]] = [iter([("", content)])]
    places: list[str] = [""]
    count = 0
    while waiting:
        found = next(waiting[-1], None)
        if found is None:
            waiting.pop()
            places.pop()
            continue
        count += 1
        name, value = found
        if type(value) is float and math.isfinite(value):
            continue
        here = f"{places[-1]}{name}"
        if count > MOST_VALUES:
            raise _Bad(f"holds more than {MOST_VALUES} values, by far more than hqpipe writes", here)
        if isinstance(value, dict | list):
            if len(waiting) > DEEPEST:
                raise _Bad(f"nested more than {DEEPEST} levels deep", here)
            waiting.append(_members(value, here))
            places.append(here)
        else:
            _check_value(value, here)


def _members(value: dict | list, place: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, list):
        return ((f"[{index}]", item) for index, item in enumerate(value))
    for key in value:
        if not isinstance(key, str):
            raise _Bad(f"{place or 'the file'}: the name {key!r} is no text, expected it in quotes", place or None)
        _check_value(key, place)
    return ((f".{key}" if place else key, item) for key, item in value.items())


def _check_value(value: Any, place: str) -> None:
    if isinstance(value, str):
        try:
            value.isascii() or value.encode()
        except UnicodeEncodeError as error:
            raise _Bad(f"{place}: holds half of a character, which no text may", place) from error
    elif isinstance(value, float):
        raise _Bad(f"{place}: is {value}, expected a finite number", place)
    elif isinstance(value, int):
        if abs(value) > LARGEST_INTEGER:
            raise _Bad(f"{place}: a whole number of {value.bit_length()} bits, expected at most 63", place)
    elif value is not None:
        raise _Bad(f"{place}: is a {type(value).__name__}, expected text or a number", place)


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        seen: set[str] = set()
        twice = next(name for name, _ in pairs if name in seen or seen.add(name))
        raise _Bad(f"'{twice}' stands twice in one object", twice)
    return found


def _integer(digits: str) -> int:
    if len(digits) > _DIGITS:
        raise _Bad(f"a whole number of {len(digits)} digits, expected at most {_DIGITS - 1}")
    return int(digits)


def _not_a_number(name: str) -> None:
    raise _Bad(f"holds {name}, expected a finite number")


def _check_nodes(top: yaml.MappingNode) -> None:
    """Refuse repeated keys, and aliases that grow to more than `LARGEST_YAML` values or contain themselves."""
    waiting: list[tuple[yaml.Node, str, int]] = [(top, "", 1)]
    count = 0
    while waiting:
        node, place, depth = waiting.pop()
        count += 1
        if count > LARGEST_YAML:
            raise _Bad("its aliases spell more values than the file has bytes", place)
        if depth > DEEPEST:
            raise _Bad(f"nested more than {DEEPEST} levels deep", place[:80])
        if isinstance(node, yaml.SequenceNode):
            waiting += [(item, f"{place}[{index}]", depth + 1) for index, item in enumerate(node.value)]
        elif isinstance(node, yaml.MappingNode):
            seen: dict[str, int] = {}
            for key, value in node.value:
                name, line = str(key.value)[:80], key.start_mark.line + 1
                here = f"{place}.{name}" if place else name
                if name in seen and name != "<<":
                    raise _Bad(f"'{here}' stands twice (lines {seen[name]} and {line})", here)
                seen[name] = line
                waiting.append((value, here, depth + 1))


def _reason(error: BaseException) -> str:
    return getattr(error, "strerror", None) or str(error)[:200] or type(error).__name__
