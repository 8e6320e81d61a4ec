"""What pydantic and the validators of stages find wrong, as errors that name file, line, field and fix."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

from hqpipe.errors import ConfigError, HqpipeError, near_match, shown
from hqpipe.pipeline.overrides import Origin
from hqpipe.pipeline.stage import Stage
from hqpipe.pipeline.yaml_source import Location, YamlSource

_FIX_FILE = "correct the value"
_FIX_NAME = "rename or remove it"


class FieldError(ValueError):
    """What a validator raises about a field below the one that it validates.

    Args:
        error: with the dotted `field` below; its message may begin with that name.
        others: dotted fields that the value must fit together with; the one that the user set is blamed.
    """

    def __init__(self, error: HqpipeError, others: Sequence[str] = ()) -> None:
        super().__init__(str(error))
        self.fix = error.fix
        self.candidates = [_location(name) for name in (error.field or "", *others)]
        self.message = error.message
        self.brief = error.message.removeprefix(f"{error.field}: ") if error.field else error.message


class ConfigErrors(ConfigError):
    """One or several wrong fields; `file`, `field` and `fix` are those of the first."""

    def __init__(self, errors: Sequence[ConfigError]) -> None:
        first = errors[0]
        super().__init__("\n".join(str(error) for error in errors), file=first.file, field=first.field, fix=first.fix)
        self.errors = tuple(errors)

    def __str__(self) -> str:
        return self.message

    def to_json(self) -> dict[str, Any]:
        """As of any error, and ``errors``: all of them, where there are several."""
        several = {"errors": [error.to_json() for error in self.errors]} if len(self.errors) > 1 else {}
        return {**super().to_json(), **several}


def file_errors(error: ValidationError, source: YamlSource, model: type[BaseModel]) -> ConfigErrors:
    """What is wrong with the fields at the top of the file."""
    found = []
    for item in error.errors():
        location = tuple(str(part) for part in item["loc"] if part != "[key]")
        name = ".".join(location)
        message, fix = _complaint(item, location, model, "field")
        found.append(ConfigError(f"{source.where(location)}: {name}: {message}", file=source.path, field=name, fix=fix))
    return ConfigErrors(found)


def section_errors(
    error: ValidationError, origins: Mapping[Location, Origin], model: type[BaseModel], stage: Stage, base: Origin
) -> ConfigErrors:
    """What is wrong with a stage's parameters, each with the layer that set the value.

    Args:
        origins: field → where its value came from. base: of the section as a whole.
    """
    return ConfigErrors([_section_error(item, origins, model, stage, base) for item in error.errors()])


def _section_error(
    item: Any, origins: Mapping[Location, Origin], model: type[BaseModel], stage: Stage, base: Origin
) -> ConfigError:
    location = tuple(str(part) for part in item["loc"])
    cause = item.get("ctx", {}).get("error")
    if isinstance(cause, FieldError):
        tried = [(*location, *below) for below in cause.candidates]
        set_by_user = [place for place in tried if place in origins]
        location = next((place for place in set_by_user if origins[place].file is None), (*set_by_user, tried[0])[0])
        message, fix = cause.brief if location == tried[0] else cause.message, cause.fix
    else:
        message, fix = _complaint(item, location, model, f"parameter of {stage.name}")
        fix = fix if fix != _FIX_FILE else None
    depth = next((n for n in range(len(location), 0, -1) if location[:n] in origins), 0)
    origin = origins[location[:depth]] if depth else base
    rest = ".".join(location[depth:])
    named = origin.text
    if rest:
        named += f".{rest}" if named.endswith(origin.field) else f": {'.'.join(location)}"
    field = ".".join(part for part in (origin.field, rest) if part)
    return ConfigError(f"{named}: {message}", file=origin.file, field=field, fix=fix or origin.fix)


def _location(dotted: str) -> Location:
    """``spans[0].time`` → ("spans", "0", "time")."""
    return tuple(part for part in re.split(r"[.\[\]]+", dotted) if part)


def _complaint(item: Any, location: Location, model: type[BaseModel], kind: str) -> tuple[str, str]:
    """What is wrong with the field at `location`, and what to do."""
    if item["type"] == "extra_forbidden":
        known = _fields_at(model, location[:-1])
        name = location[-1] if len(location[-1]) < 80 else f"{location[-1][:79]}…"
        return f"unknown {kind} '{name}'{near_match(name, known)} (known: {', '.join(known)})", _FIX_NAME
    if item["type"] == "missing":
        return f"{kind} '{location[-1]}' is missing", f"add `{location[-1]}: …`"
    if item["type"] == "value_error":
        return str(item["ctx"]["error"]), _FIX_FILE
    # Pydantic's message in our words.
    message = item["msg"].replace("Input should be ", "expected ").replace("Input should ", "expected to ")
    message = message.replace("a valid integer", "a whole number").replace("a valid dictionary", "a mapping {a: b}")
    message = message.replace(", unable to parse string as an integer", "").replace(
        ", unable to parse string as a number", ""
    )
    message = message.replace("a valid list", "a list [a, b]").replace("a valid string", "text")
    message = message.replace("a valid boolean", "true or false")
    return f"{message}, got {shown(item['input'])}", _FIX_FILE


def _fields_at(model: type[BaseModel], location: Location) -> list[str]:
    """Names of the fields of the (nested) model at `location`; empty if there is no model there."""
    for name in location:
        field = model.model_fields.get(name)
        if field is None or not (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)):
            return []
        model = field.annotation
    return list(model.model_fields)
