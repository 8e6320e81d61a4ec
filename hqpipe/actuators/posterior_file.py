"""posterior.json: what a fit knows of a model's parameters, beside actuator.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.keys import check_keys
from hqpipe.actuators.posterior import Group, Posterior, Range, check_fields
from hqpipe.errors import ConfigError, UsageError, near_match

FILE = "posterior.json"
FORMAT = "hqpipe-posterior/1"
_KEYS = ("format", "model", "fields", "units", "groups")
_GROUP_KEYS = ("joints", "mean", "scatter", "between", "sections", "lower", "upper", "ranges")
_ROUNDING = 1e-6  # of a correlation


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
    if not path.is_file():
        return None
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ConfigError(f"{path}: not JSON ({error}); run hqpipe fit-actuator again") from error
    try:
        check_keys(raw, _KEYS)
        if raw["format"] != FORMAT:
            raise UsageError(f"format is '{raw['format']}', expected {FORMAT}")
        fields = tuple(raw["fields"])
        check_fields(fields, actuator.FIELDS)
        groups = tuple(_group(part, fields, f"groups[{i}]") for i, part in enumerate(raw["groups"]))
        posterior = Posterior(raw["model"], fields, groups)
        _check_belongs(posterior, actuator)
    except (UsageError, TypeError, ValueError, AttributeError) as error:
        raise ConfigError(f"{path}: {error}; run hqpipe fit-actuator again") from error
    return posterior


def _group(raw: Any, fields: tuple[str, ...], where: str) -> Group:
    check_keys(raw, _GROUP_KEYS, where)
    ranges = {}
    for name, span in raw["ranges"].items():
        check_keys(span, ("low", "high", "reason"), f"{where}.ranges.{name}")
        if name not in fields:
            raise UsageError(f"{where}.ranges: unknown '{name}'{near_match(name, fields)}")
        ranges[name] = Range(float(span["low"]), float(span["high"]), str(span["reason"]))
        if not ranges[name].low <= ranges[name].high:
            raise UsageError(f"{where}.ranges.{name}: low {span['low']} is above high {span['high']}")
    size = len(fields)
    between = raw["between"]
    mean = _array(raw["mean"], (size,), f"{where}.mean")
    lower = _array(raw["lower"], (size,), f"{where}.lower")
    upper = _array([np.inf if value is None else value for value in raw["upper"]], (size,), f"{where}.upper")
    if not ((lower <= mean) & (mean <= upper)).all():
        raise UsageError(f"{where}.mean: expected values between lower and upper")
    return Group(
        joints=tuple(raw["joints"]),
        mean=mean,
        scatter=_covariance(raw["scatter"], size, f"{where}.scatter"),
        between=None if between is None else _covariance(between, size, f"{where}.between"),
        sections=int(raw["sections"]),
        lower=lower,
        upper=upper,
        ranges=ranges,
    )


def _array(raw: Any, shape: tuple[int, ...], where: str) -> np.ndarray:
    found = np.array(raw, dtype=np.float64)
    if found.shape != shape or np.isnan(found).any():
        raise UsageError(f"{where}: expected {' × '.join(map(str, shape))} numbers, got shape {found.shape}")
    return found


def _covariance(raw: Any, size: int, where: str) -> np.ndarray:
    found = _array(raw, (size, size), where)
    if not np.isfinite(found).all():
        raise UsageError(f"{where}: expected finite numbers")
    unit = np.sqrt(np.maximum(np.diag(found), 0.0))
    scaled = found / np.outer(np.where(unit > 0, unit, 1.0), np.where(unit > 0, unit, 1.0))
    if not np.allclose(scaled, scaled.T, rtol=0.0, atol=_ROUNDING) or np.linalg.eigvalsh(scaled).min() < -_ROUNDING:
        raise UsageError(f"{where}: is no covariance: expected a symmetric matrix without negative eigenvalues")
    return found


def _check_belongs(posterior: Posterior, actuator: ActuatorModel) -> None:
    if posterior.model != actuator.NAME:
        raise UsageError(f"model is '{posterior.model}', the actuator.json beside it is {actuator.NAME}")
    named = [joint for group in posterior.groups for joint in group.joints]
    if sorted(named) != sorted(actuator.joints):
        raise UsageError(f"joints are {', '.join(named)}, those of actuator.json {', '.join(actuator.joints)}")
    columns = [list(actuator.FIELDS).index(name) for name in posterior.fields]
    for group in posterior.groups:
        for joint in group.joints:
            held = actuator.parameters[actuator.joints.index(joint), columns]
            if not np.array_equal(held, group.mean):
                raise UsageError(f"the mean of joint '{joint}' is not what actuator.json holds: they are of two fits")
