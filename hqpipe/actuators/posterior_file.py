"""posterior.json: what a fit knows of a model's parameters, beside actuator.json."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.posterior import Group, Posterior, Range, check_fields
from hqpipe.errors import UsageError, near_match
from hqpipe.files.documents import read_json
from hqpipe.files.entries import Entry

FILE = "posterior.json"
FORMAT = "hqpipe-posterior/1"
_KEYS = ("format", "model", "fields", "units", "groups")
_GROUP_KEYS = ("joints", "mean", "scatter", "between", "sections", "lower", "upper", "ranges")
_ROUNDING = 1e-6  # of a correlation
_FIX = "run hqpipe fit-actuator again"
_LARGEST = 1e30  # of a variance: that of a parameter of 1e15; its square is finite
_MOST_SECTIONS = 1_000_000_000  # a count: what a list of joints in years of logs could have


def save_posterior(posterior: Posterior, actuator: ActuatorModel, folder: Path) -> Path:
    """Write `folder`/posterior.json of the model that was saved there; the same posterior gives the same bytes."""
    groups = [
        {
            "joints": list(group.joints),
            "mean": group.mean.tolist(),
            "scatter": group.scatter.tolist(),
            "between": None if group.between is None else group.between.tolist(),
            "sections": group.sections,
            "lower": group.lower.tolist(),
            "upper": [value if np.isfinite(value) else None for value in group.upper.tolist()],
            "ranges": {n: {"low": r.low, "high": r.high, "reason": r.reason} for n, r in group.ranges.items()},
        }
        for group in posterior.groups
    ]
    units = [actuator.FIELDS[name].unit for name in posterior.fields]
    head = {"format": FORMAT, "model": posterior.model, "fields": list(posterior.fields), "units": units}
    path = folder / FILE
    text = json.dumps({**head, "groups": groups}, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    path.write_text(text, encoding="utf-8")
    return path


def load_posterior(folder: Path, actuator: ActuatorModel) -> Posterior | None:
    """Read and check `folder`/posterior.json of the model `actuator`; None where the folder has none.

    Raises:
        ConfigError: the file is broken, has a missing or unknown field, or belongs to another model than `actuator`.
    """
    path = folder / FILE
    if not path.exists() and not path.is_symlink():
        return None
    parts = Entry(read_json(path, _FIX), path, _FIX).mapping(_KEYS)
    parts["format"].text((FORMAT,))
    model = parts["model"].text()
    fields = tuple(item.text() for item in parts["fields"].items(1))
    try:
        check_fields(fields, actuator.FIELDS)
    except UsageError as error:
        raise parts["fields"].error(error.message) from error
    units = [actuator.FIELDS[name].unit for name in fields]
    if parts["units"].value != units:
        raise parts["units"].wrong(str(units))
    posterior = Posterior(model, fields, tuple(_group(part, fields) for part in parts["groups"].items(1)))
    _check_belongs(posterior, actuator, parts)
    return posterior


def _group(part: Entry, fields: tuple[str, ...]) -> Group:
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
        scatter=_covariance(given["scatter"], size),
        between=given["between"].or_none(lambda entry: _covariance(entry, size)),
        sections=given["sections"].whole(0, _MOST_SECTIONS),
        lower=lower,
        upper=upper,
        ranges={name: _range(name, span, fields) for name, span in given["ranges"].table().items()},
    )


def _range(name: str, span: Entry, fields: tuple[str, ...]) -> Range:
    if name not in fields:
        raise span.error(f"unknown '{name[:80]}'{near_match(name[:80], fields)}")
    given = span.mapping(("low", "high", "reason"))
    found = Range(given["low"].number(), given["high"].number(), given["reason"].text())
    if not found.low <= found.high:
        raise span.error(f"low {found.low:g} is above high {found.high:g}")
    return found


def _covariance(entry: Entry, size: int) -> np.ndarray:
    found = np.array(entry.numbers(size, size, lower=-_LARGEST, upper=_LARGEST), dtype=np.float64)
    unit = np.sqrt(np.maximum(np.diag(found), 0.0))
    scaled = found / np.outer(np.where(unit > 0, unit, 1.0), np.where(unit > 0, unit, 1.0))
    if not np.allclose(scaled, scaled.T, rtol=0.0, atol=_ROUNDING) or np.linalg.eigvalsh(scaled).min() < -_ROUNDING:
        raise entry.error("is no covariance: expected a symmetric matrix without negative eigenvalues")
    return found


def _check_belongs(posterior: Posterior, actuator: ActuatorModel, parts: dict[str, Entry]) -> None:
    if posterior.model != actuator.NAME:
        raise parts["model"].error(f"is '{posterior.model}', the actuator.json beside it is {actuator.NAME}")
    named = [joint for group in posterior.groups for joint in group.joints]
    if sorted(named) != sorted(actuator.joints):
        raise parts["groups"].error(
            f"joints are {', '.join(named)}, those of actuator.json {', '.join(actuator.joints)}"
        )
    columns = [list(actuator.FIELDS).index(name) for name in posterior.fields]
    for group in posterior.groups:
        for joint in group.joints:
            held = actuator.parameters[actuator.joints.index(joint), columns]
            if not np.array_equal(held, group.mean):
                raise parts["groups"].error(
                    f"the mean of joint '{joint}' is not what actuator.json holds: they are of two fits"
                )
