"""``--set stage.key=value``, and how layers of parameters are laid over each other."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

from hqpipe.errors import SHOWN, UsageError, near_match
from hqpipe.pipeline.yaml_source import MAX_DEPTH, Location, YamlProblem, parse_yaml

OPTION = "--set"


@dataclass(frozen=True)
class Origin:
    """Where a value came from.

    Args:
        text: as errors name it, e.g. ``pipeline.yaml:12: stages.collect.seed``.
        file: None for the command line.
        field: dotted.
        fix: what to do about a wrong value.
    """

    text: str
    file: str | None
    field: str
    fix: str


@dataclass(frozen=True)
class Override:
    """One ``--set``, or another option that sets a parameter: what it changes in which section, and its text."""

    section: str
    values: dict[str, Any]
    text: str
    option: str = OPTION

    def origin(self, path: Location) -> Origin:
        told, fix = f"{self.option} {self.text}", f"give {self.option} another value"
        return Origin(told, None, ".".join((self.section, *path)), fix)


def parse_override(text: str, sections: Collection[str]) -> Override:
    """Read ``stage.key=value``; deeper keys are separated by further dots.

    Raises:
        UsageError: it is not of that form, names no known section, or its value is no YAML.
    """
    name, equals, value = text.partition("=")
    section, *keys = name.strip().split(".")
    section = section.replace("-", "_")
    told = f"{OPTION} {text}" if len(text) <= SHOWN else f"{OPTION} {text[: SHOWN - 1]}…"
    if not equals or not keys or not all(keys) or len(keys) > MAX_DEPTH:
        message = f"{told}: expected stage.key=value, at most {MAX_DEPTH} keys deep"
        raise UsageError(message, field=OPTION, fix=f"write e.g. {OPTION} {min(sections)}.seed=3")
    if section not in sections:
        message = f"{told}: unknown stage '{section[:SHOWN]}'{near_match(section[:SHOWN], sections)}"
        names = ", ".join(sorted(sections))
        raise UsageError(f"{message} (known: {names})", field=OPTION, fix="name one of these")
    try:
        values = parse_yaml(value)[0] if value.strip() else None
    except YamlProblem as error:
        message = f"{told}: the value: {error}"
        fix = "quote the value for the shell, and write lists as [a,b] and mappings as {a: b}"
        raise UsageError(message, field=".".join((section, *keys)), fix=fix) from None
    for key in reversed(keys):
        values = {key: values}
    return Override(section, values, told.removeprefix(f"{OPTION} "))


def lay_over(
    into: dict[str, Any],
    values: dict[str, Any],
    above: Location,
    origin: Callable[[Location], Origin],
    origins: dict[Location, Origin],
) -> None:
    """Lay `values` over `into`, mapping by mapping, noting in `origins` where each field came from."""
    for key, value in values.items():
        path = (*above, str(key))
        origins[path] = origin(path)
        if not isinstance(value, dict):
            into[key] = value
            continue
        if not isinstance(into.get(key), dict):
            into[key] = {}
        lay_over(into[key], value, path, origin, origins)
