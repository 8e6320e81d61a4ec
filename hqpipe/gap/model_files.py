"""What lies beside an actuator model of fit-actuator or diagnose: how sure it is, and what it left on its own logs."""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.files import FILE
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.posterior_file import FILE as POSTERIOR
from hqpipe.actuators.posterior_file import load_posterior
from hqpipe.effects.layout import slot
from hqpipe.errors import ConfigError
from hqpipe.gap.estimate import Z95

FIT, DIAGNOSIS, RESIDUALS = "fit.json", "diagnosis.json", "residuals.csv"
COEFFICIENTS = ("k1", "k2", "k3", "k4")
POWERS = (2, 0, 2, 1)  # of the sprocket's radius in joint space, eq. (7)


@dataclass(frozen=True)
class Left:
    """What a model left of one joint.

    Attributes:
        error: mean squared error on its own logs beyond their noise.
        swing: mean squared error of holding the output there; None where the files do not say.
    """

    error: float
    swing: float | None


def digest(folder: Path) -> str:
    """SHA-256 over every file of the model that an answer can depend on."""
    parts = [folder / name for name in (FILE, POSTERIOR, FIT, DIAGNOSIS, RESIDUALS)]
    hashed = [(path.name, hashlib.sha256(path.read_bytes()).hexdigest()) for path in parts if path.is_file()]
    return hashlib.sha256(json.dumps(hashed).encode()).hexdigest()


def variances(folder: Path, model: ActuatorModel) -> dict[str, dict[int, float]]:
    """Joint → column in joint space → variance of the estimate; empty where nothing beside the model says it.

    Raises:
        ConfigError: posterior.json or fit.json is broken.
    """
    if not isinstance(model, Hydraulic):
        return {}
    found: dict[str, dict[int, float]] = {}
    for joint, radius in zip(model.joints, model.column("sprocket_radius"), strict=True):
        for name, variance in _coefficients(folder, model, joint):
            power = POWERS[COEFFICIENTS.index(name)]
            found.setdefault(joint, {})[slot("base", name)] = variance * radius ** (2 * power)
    return found


def left_of(folder: Path, model: ActuatorModel) -> dict[str, Left]:
    """Joint → what the model left on its own logs; empty where nothing beside it says so.

    Raises:
        ConfigError: fit.json, diagnosis.json or residuals.csv is broken.
    """
    if isinstance(model, Hydraulic):
        found = {}
        for joint in model.joints:
            if fit := _fit_of(folder, model.scope, joint):
                where = f"{folder / FIT}: {model.scope}, joint {joint}"
                swing = fit.get("persistence_rmse")
                error = _beyond(_number(fit, "free_run_rmse", where), _number(fit, "noise", where))
                found[joint] = Left(error, None if swing is None else _number(fit, "persistence_rmse", where) ** 2)
        return found
    if not all((folder / name).is_file() for name in (DIAGNOSIS, RESIDUALS)):
        return {}
    gap = _json(folder / DIAGNOSIS, "diagnose").get("gap")
    if gap is None:
        return {}
    noise = _number(gap, "noise_floor", f"{folder / DIAGNOSIS}: gap")
    found = {}
    for row in _pooled_rows(folder / RESIDUALS):
        where = f"{folder / RESIDUALS}: joint {row.get('joint')}"
        after = row.get("rmse_after") or row.get("rmse")  # without causes the model is what it was before
        swing = row.get("rmse_persistence")
        error = _beyond(_number({"rmse_after": after}, "rmse_after", where), noise)
        held = _number(row, "rmse_persistence", where) ** 2 if swing else None
        found[str(row["joint"])] = Left(error, held)
    return found


def _coefficients(folder: Path, model: Hydraulic, joint: str) -> Iterator[tuple[str, float]]:
    """Name and variance of the coefficients that the logs determined: from the posterior, else from the intervals."""
    posterior = load_posterior(folder, model)
    if posterior is not None:
        group = next(group for group in posterior.groups if joint in group.joints)
        for i, name in enumerate(posterior.fields):
            if group.scatter[i, i] > 0.0:
                yield name, float(group.scatter[i, i])
        return
    for each in _fit_of(folder, model.scope, joint).get("coefficients", ()):
        where = f"{folder / FIT}: {model.scope}, joint {joint}, coefficients"
        if not isinstance(each, Mapping) or each.get("name") not in COEFFICIENTS:
            raise ConfigError(
                f"{where}: expected objects with a name of {', '.join(COEFFICIENTS)}; {_again('fit-actuator')}"
            )
        if each.get("ci95"):
            low, high = each["ci95"]
            yield each["name"], ((high - low) / (2.0 * Z95)) ** 2


def _fit_of(folder: Path, scope: str, joint: str) -> Mapping[str, Any]:
    """The entry of fit.json for a joint; empty without it."""
    path = folder / FIT
    if not path.is_file():
        return {}
    part = _json(path, "fit-actuator").get(scope, {})
    fits = part.get("fits", []) if isinstance(part, Mapping) else None
    if not isinstance(fits, list) or not all(isinstance(fit, Mapping) and "joint" in fit for fit in fits):
        raise ConfigError(f"{path}: {scope}.fits: expected a list of objects with a joint; {_again('fit-actuator')}")
    return next((fit for fit in fits if fit["joint"] in (joint, "all")), {})


def _json(path: Path, command: str) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ConfigError(f"{path}: not JSON ({error}); {_again(command)}") from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: expected an object, got {type(content).__name__}; {_again(command)}")
    return content


def _pooled_rows(path: Path) -> list[dict[str, str]]:
    """The rows of residuals.csv for whole joints in all trials."""
    with path.open(newline="", encoding="utf-8") as stream:
        reader = csv.DictReader(stream)
        lacking = [name for name in ("trial", "joint", "family", "rmse") if name not in (reader.fieldnames or ())]
        if lacking:
            raise ConfigError(f"{path}: no column '{lacking[0]}'; {_again('diagnose')}")
        return [row for row in reader if (row["trial"], row["family"]) == ("all", "all")]


def _number(raw: Mapping[str, Any], name: str, where: str) -> float:
    try:
        return float(raw[name])
    except (KeyError, TypeError, ValueError):
        raise ConfigError(f"{where}: {name}: expected a number, got {raw.get(name)!r}; make the model again") from None


def _again(command: str) -> str:
    return f"run hqpipe {command} again"


def _beyond(error: float, noise: float) -> float:
    return max(error**2 - noise**2, 0.0)
