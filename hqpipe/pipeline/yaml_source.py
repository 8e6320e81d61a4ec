"""A YAML mapping that remembers on which line each field stands, so that an error can name it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from hqpipe.errors import ConfigError

Location = tuple[str, ...]


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


def read_yaml(path: Path) -> YamlSource:
    """Read a YAML mapping with the safe loader.

    Raises:
        ConfigError: not UTF-8, not YAML, not a mapping, or a key that stands twice (YAML keeps the last).
    """
    try:
        loader = yaml.SafeLoader(path.read_text(encoding="utf-8"))
        node = loader.get_single_node()
        lines: dict[Location, int] = {}
        if node is not None:
            _walk(node, (), lines, path)
        data = loader.construct_document(node) if node is not None else {}
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path.name}: not UTF-8 text ({error.reason} at byte {error.start})") from error
    except yaml.YAMLError as error:
        raise ConfigError(f"{path.name}: not valid YAML: {' '.join(str(error).split())}") from error
    if not isinstance(data, dict):
        raise ConfigError(f"{path.name}: expected fields such as 'robot:', got {type(data).__name__}")
    return YamlSource(path, data, lines)


def _walk(node: yaml.Node, above: Location, lines: dict[Location, int], path: Path) -> None:
    """Record the lines of all keys under `node`."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            here = (*above, str(key.value))
            if here in lines:
                both = f"lines {lines[here]} and {key.start_mark.line + 1}"
                raise ConfigError(f"{path.name}: '{'.'.join(here)}' stands twice ({both}): remove one")
            lines[here] = key.start_mark.line + 1
            _walk(value, here, lines, path)
