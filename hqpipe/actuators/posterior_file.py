"""posterior.json: what a fit knows of a model's parameters, beside actuator.json."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.actuators.base import ActuatorModel, ParameterField
from hqpipe.actuators.posterior import Alternative, Choice, Group, Posterior, Range, check_fields
from hqpipe.errors import UsageError, near_match
from hqpipe.files.documents import read_json
from hqpipe.files.entries import Entry

FILE = "posterior.json"
FORMAT = "hqpipe-posterior/1"
MIXTURE = "hqpipe-posterior/2"  # with choices between alternatives
_KEYS = ("format", "model", "fields", "units", "groups")
_GROUP_KEYS = ("joints", "mean", "scatter", "between", "sections", "lower", "upper", "ranges")
_CHOICE_KEYS, _ALTERNATIVE_KEYS = ("alternatives",), ("name", "weight", "groups")
_ROUNDING = 1e-6  # of a correlation, and of a sum of weights
_FIXES = {"augmented": "run hqpipe diagnose again"}
_FIX = "run hqpipe fit-actuator again"  # of all other models
_LARGEST = 1e30  # of a variance: that of a parameter of 1e15; its square is finite
_MOST_SECTIONS = 1_000_000_000  # a count: what a list of joints in years of logs could have

Fields = Mapping[str, ParameterField]
"""The F parameters of a posterior."""


def save_posterior(posterior: Posterior, actuator: ActuatorModel, folder: Path) -> Path:
    """Write `folder`/posterior.json of the model that was saved there; the same posterior gives the same bytes."""
    units = [actuator.FIELDS[name].unit for name in posterior.fields]
    raw = {
        "format": MIXTURE if posterior.choices else FORMAT,
        "model": posterior.model,
        "fields": list(posterior.fields),
        "units": units,
        "groups": [_raw_group(group) for group in posterior.groups],
    }
    if posterior.choices:
        raw["choices"] = [
            {"alternatives": [_raw_alternative(alternative) for alternative in choice.alternatives]}
            for choice in posterior.choices
        ]
    path = folder / FILE
    text = json.dumps(raw, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    path.write_text(text, encoding="utf-8")
    return path


def _raw_group(group: Group) -> dict[str, Any]:
    return {
        "joints": list(group.joints),
        "mean": group.mean.tolist(),
        "scatter": group.scatter.tolist(),
        "between": None if group.between is None else group.between.tolist(),
        "sections": group.sections,
        "lower": group.lower.tolist(),
        "upper": [value if np.isfinite(value) else None for value in group.upper.tolist()],
        "ranges": {n: {"low": r.low, "high": r.high, "reason": r.reason} for n, r in group.ranges.items()},
    }


def _raw_alternative(alternative: Alternative) -> dict[str, Any]:
    groups = [_raw_group(group) for group in alternative.groups]
    return {"name": alternative.name, "weight": alternative.weight, "groups": groups}


def load_posterior(folder: Path, actuator: ActuatorModel) -> Posterior | None:
    """Read and check `folder`/posterior.json of the model `actuator`; None where the folder has none.

    Raises:
        ConfigError: the file is broken, has a missing or unknown field, or belongs to another model than `actuator`.
    """
    path = folder / FILE
    if not path.exists() and not path.is_symlink():
        return None
    fix = _FIXES.get(actuator.NAME, _FIX)
    document = Entry(read_json(path, fix), path, fix)
    mixture = isinstance(document.value, dict) and document.value.get("format") == MIXTURE
    parts = document.mapping((*_KEYS, "choices") if mixture else _KEYS)
    parts["format"].text((FORMAT, MIXTURE))
    model = parts["model"].text()
    fields = tuple(item.text() for item in parts["fields"].items(1))
    try:
        check_fields(fields, actuator.FIELDS, settings=mixture)
    except UsageError as error:
        raise parts["fields"].error(error.message) from error
    units = [actuator.FIELDS[name].unit for name in fields]
    if parts["units"].value != units:
        raise parts["units"].wrong(str(units))
    columns = {name: actuator.FIELDS[name] for name in fields}
    groups = tuple(_group(part, columns) for part in parts["groups"].items(0 if mixture else 1))
    choices = tuple(_choice(part, columns) for part in parts["choices"].items(1)) if mixture else ()
    posterior = Posterior(model, fields, groups, choices)
    _check_belongs(posterior, actuator, parts)
    return posterior


def _choice(part: Entry, fields: Fields) -> Choice:
    alternatives = part.mapping(_CHOICE_KEYS)["alternatives"]
    found = tuple(_alternative(item, fields) for item in alternatives.items(2))
    if abs(sum(alternative.weight for alternative in found) - 1.0) > _ROUNDING:
        raise alternatives.error("expected weights that add up to 1")
    for item, alternative in zip(alternatives.items(), found, strict=True):
        if sorted(alternative.joints) != sorted(found[0].joints):
            told = ", ".join(alternative.joints), ", ".join(found[0].joints)
            raise item.inner("groups").error(f"joints are {told[0]}, those of the first alternative {told[1]}")
    return Choice(found)


def _alternative(part: Entry, fields: Fields) -> Alternative:
    given = part.mapping(_ALTERNATIVE_KEYS)
    groups = []
    for entry in given["groups"].items(1):
        group = _group(entry, fields)
        for name, spec, low, high in zip(fields, fields.values(), group.lower, group.upper, strict=True):
            if low < spec.lower or high > spec.upper:
                raise entry.error(f"'{name}' may be {low:g} to {high:g}, expected {spec.lower:g} to {spec.upper:g}")
        groups.append(group)
    return Alternative(given["name"].text(), given["weight"].number(0.0, 1.0), tuple(groups))


def _group(part: Entry, fields: Fields) -> Group:
    given = part.mapping(_GROUP_KEYS)
    size = len(fields)
    mean, lower = (np.array(given[name].numbers(size), dtype=np.float64) for name in ("mean", "lower"))
    upper = [item.or_none(Entry.number) for item in given["upper"].items(size, size)]
    upper = np.array([np.inf if value is None else value for value in upper], dtype=np.float64)
    if not ((lower <= mean) & (mean <= upper)).all():
        raise given["mean"].error("expected values between lower and upper")
    return Group(
        joints=tuple(item.text() for item in given["joints"].items(1)),
        mean=mean,
        scatter=_covariance(given["scatter"], fields),
        between=given["between"].or_none(lambda entry: _covariance(entry, fields)),
        sections=given["sections"].whole(0, _MOST_SECTIONS),
        lower=lower,
        upper=upper,
        ranges={name: _range(name, span, fields) for name, span in given["ranges"].table().items()},
    )


def _range(name: str, span: Entry, fields: Fields) -> Range:
    if name not in fields or fields[name].certain:
        raise span.error(f"unknown '{name[:80]}'{near_match(name[:80], fields)}")
    given = span.mapping(("low", "high", "reason"))
    found = Range(given["low"].number(), given["high"].number(), given["reason"].text())
    if not found.low <= found.high:
        raise span.error(f"low {found.low:g} is above high {found.high:g}")
    return found


def _covariance(entry: Entry, fields: Fields) -> np.ndarray:
    size = len(fields)
    found = np.array(entry.numbers(size, size, lower=-_LARGEST, upper=_LARGEST), dtype=np.float64)
    unit = np.sqrt(np.maximum(np.diag(found), 0.0))
    scaled = found / np.outer(np.where(unit > 0, unit, 1.0), np.where(unit > 0, unit, 1.0))
    if not np.allclose(scaled, scaled.T, rtol=0.0, atol=_ROUNDING) or np.linalg.eigvalsh(scaled).min() < -_ROUNDING:
        raise entry.error("is no covariance: expected a symmetric matrix without negative eigenvalues")
    for name, variance in zip(fields, np.diag(found), strict=True):
        if fields[name].certain and variance != 0.0:
            raise entry.error(f"varies '{name}', which is no fitted parameter, expected 0")
    return found


def _check_belongs(posterior: Posterior, actuator: ActuatorModel, parts: dict[str, Entry]) -> None:
    if posterior.model != actuator.NAME:
        raise parts["model"].error(f"is '{posterior.model}', the actuator.json beside it is {actuator.NAME}")
    named = [joint for group in posterior.held for joint in group.joints]
    if sorted(named) != sorted(actuator.joints):
        raise parts["groups"].error(
            f"joints are {', '.join(named)}, those of actuator.json {', '.join(actuator.joints)}"
        )
    columns = [list(actuator.FIELDS).index(name) for name in posterior.fields]
    for group in posterior.held:
        for joint in group.joints:
            held = actuator.parameters[actuator.joints.index(joint), columns]
            if not np.array_equal(held, group.mean):
                raise parts["groups"].error(
                    f"the mean of joint '{joint}' is not what actuator.json holds: they are of two fits"
                )
