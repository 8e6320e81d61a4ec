"""A YAML mapping that remembers on which line each field stands, so that an error can name it."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from hqpipe.errors import ConfigError, shown

Location = tuple[str, ...]

# What a configuration may be: this project's is 4 kB, 5 deep, of 200 values. Far above that, and far below what takes
# the recursion of the parser, or aliases of aliases, out of bounds.
MAX_BYTES, MAX_DEPTH, MAX_NODES = 1_000_000, 50, 100_000
MAX_DIGITS = 20
"""Characters of a whole number; 2⁶⁴ has 20."""

_CORE = "tag:yaml.org,2002:"
_TAGS = {f"{_CORE}{name}" for name in ("map", "seq", "str", "int", "float", "bool", "null", "merge")}
_KEYS = {f"{_CORE}str", f"{_CORE}merge"}
_CORRECT = "correct that line; text with special characters needs quotes"


@dataclass(frozen=True)
class YamlSource:
    """The content of a YAML file.

    Args:
        path: the file.
        data: its mapping, plain data.
        lines: field, as its path from the top → line, counted from 1.
    """

    path: Path
    data: dict[str, Any]
    lines: dict[Location, int] = field(repr=False)

    def where(self, location: Location) -> str:
        """``"pipeline.yaml:12"``, with the line of `location` or of the nearest field above it."""
        for depth in range(len(location), 0, -1):
            if location[:depth] in self.lines:
                return f"{self.path.name}:{self.lines[location[:depth]]}"
        return self.path.name


class YamlProblem(ValueError):
    """Text that is no YAML that we take.

    Args:
        message: what is wrong.
        fix: what to do about it.
        line: counted from 1; None for the text as a whole.
        field: dotted; None where there is none.
    """

    def __init__(self, message: str, fix: str = _CORRECT, line: int | None = None, field: str | None = None) -> None:
        super().__init__(message)
        self.fix, self.line, self.field = fix, line, field


def read_yaml(path: Path) -> YamlSource:
    """Read a YAML mapping with the safe loader.

    Raises:
        ConfigError: unreadable, not UTF-8, not YAML, too large or too deep, not a mapping, a key that is no text, or one
            that stands twice (YAML keeps the last).
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        fix = "make it a file that can be read"
        raise ConfigError(f"{path}: cannot be read ({error.strerror})", file=path, fix=fix) from error
    try:
        data, lines = parse_yaml(raw.decode("utf-8"))
        if not isinstance(data, dict):
            raise YamlProblem(f"expected fields such as 'robot:', got {shown(data)}", "write `field: value` lines")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        message = f"{path.name}:{line}: not UTF-8 text ({error.reason} at byte {error.start})"
        raise ConfigError(message, file=path, fix="save it with the encoding UTF-8") from None
    except YamlProblem as error:
        where = path.name if error.line is None else f"{path.name}:{error.line}"
        raise ConfigError(f"{where}: {error}", file=path, field=error.field, fix=error.fix) from None
    return YamlSource(path, data, lines)


def parse_yaml(text: str) -> tuple[Any, dict[Location, int]]:
    """Plain data of one YAML document ({} for none), and field → line.

    Numbers are read as in YAML 1.2: ``1e-3`` is one.

    Raises:
        YamlProblem: see `read_yaml`.
    """
    if len(text) > MAX_BYTES:
        raise YamlProblem(f"{len(text)} characters, expected at most {MAX_BYTES}", "keep data in files of their own")
    lines: dict[Location, int] = {}
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
        if node is None:
            return {}, lines
        _walk(node, (), lines)
        return loader.construct_document(node), lines
    except yaml.MarkedYAMLError as error:
        raise _problem(error) from None
    except yaml.YAMLError as error:
        raise YamlProblem(f"not valid YAML: {' '.join(str(error).split())}") from None
    except (ValueError, OverflowError) as error:
        if isinstance(error, YamlProblem):
            raise
        raise YamlProblem(f"not valid YAML: {error}") from None


class _Loader(yaml.SafeLoader):
    """The safe loader with bounds on depth and on what aliases multiply to, and with text keys only."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0
        self._extent: dict[int, tuple[int, int]] = {}  # id of a node → values in it, and how deep it goes

    def compose_node(self, parent: Any, index: Any) -> Any:
        mark = self.peek_event().start_mark
        if self._depth >= MAX_DEPTH:
            raise _too_deep(mark)
        is_alias = self.check_event(yaml.AliasEvent)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        if not is_alias:
            _check_node(node)
            self._extent[id(node)] = self._measured(node, mark)
        elif id(node) not in self._extent:
            raise YamlProblem("not valid YAML: an alias of what it stands in", "write the values out", mark.line + 1)
        return node

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
        tag = super().resolve(kind, value, implicit)
        # 1:30, which YAML 1.1 reads as 90.
        return f"{_CORE}str" if tag in (f"{_CORE}int", f"{_CORE}float") and ":" in value else tag

    def _measured(self, node: Any, mark: Any) -> tuple[int, int]:
        """How many values there are in a node and how deep it goes, with every alias written out."""
        if isinstance(node, yaml.ScalarNode):
            return 1, 1
        children = [part for pair in node.value for part in pair] if isinstance(node, yaml.MappingNode) else node.value
        extents = [self._extent[id(child)] for child in children]
        count, depth = 1 + sum(n for n, _ in extents), 1 + max((d for _, d in extents), default=0)
        if depth > MAX_DEPTH:
            raise _too_deep(mark)
        if count > MAX_NODES:
            message = f"more than {MAX_NODES} values, with every alias written out"
            raise YamlProblem(message, "keep data in files of their own", mark.line + 1)
        return count, depth


# 1e-3 and 1e9, which YAML 1.1 reads as text.
_Loader.add_implicit_resolver(
    f"{_CORE}float", re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$"), list("-+0123456789")
)


def _too_deep(mark: Any) -> YamlProblem:
    return YamlProblem(f"nested more than {MAX_DEPTH} deep", "write it flatter", mark.line + 1)


def _check_node(node: Any) -> None:
    """Refuse types that no parameter has, whole numbers of no use, text that cannot be written, and keys that are no text."""
    line = node.start_mark.line + 1
    if isinstance(node, yaml.ScalarNode) and not node.value.isascii() and not _is_writable(node.value):
        raise YamlProblem("text that holds half of a character", "remove the escape such as \\udc80", line)
    if node.tag not in _TAGS:
        name = node.tag.removeprefix(_CORE)
        raise YamlProblem(
            f"not valid YAML here: a value of the type '{name}'", "write text in quotes, or a number", line
        )
    if node.tag == f"{_CORE}int" and len(node.value) > MAX_DIGITS:
        message = f"a whole number of {len(node.value)} digits, expected at most {MAX_DIGITS}"
        raise YamlProblem(message, "write a smaller number", line)
    if isinstance(node, yaml.MappingNode):
        for key, _ in node.value:
            if key.tag not in _KEYS:
                name = shown(key.value) if isinstance(key, yaml.ScalarNode) else "a list or mapping"
                fix = "give the name of a field, in quotes if it looks like a number or like true, false or null"
                raise YamlProblem(f"a field must be text, got {name}", fix, key.start_mark.line + 1)


def _is_writable(text: str) -> bool:
    """Whether it can be encoded: escapes such as ``\\udc80`` spell halves of characters, which no file or terminal takes."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _problem(error: yaml.MarkedYAMLError) -> YamlProblem:
    """What the parser complains about, with the line."""
    mark = error.problem_mark or error.context_mark
    begun = ""
    if error.context and error.context_mark:
        elsewhere = mark is not None and mark.line != error.context_mark.line
        begun = f" {error.context}{f' that begins in line {error.context_mark.line + 1}' if elsewhere else ''},"
    fix = "indent with spaces instead of tabs" if "\\t" in str(error.problem) else _CORRECT
    return YamlProblem(f"not valid YAML:{begun} {error.problem}", fix, mark and mark.line + 1)


def _walk(node: yaml.Node, above: Location, lines: dict[Location, int]) -> None:
    """Record the lines of all keys under `node`."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            here = (*above, str(key.value))
            if here in lines:
                line, name = key.start_mark.line + 1, ".".join(here)
                message = f"'{name}' stands twice (lines {lines[here]} and {line})"
                raise YamlProblem(message, "remove one", line, name)
            lines[here] = key.start_mark.line + 1
            _walk(value, here, lines)
