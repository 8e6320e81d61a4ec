"""What lies beside an actuator model of fit-actuator or diagnose: how sure it is, and what it left on its own logs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.files import FILE
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.posterior_file import FILE as POSTERIOR
from hqpipe.actuators.posterior_file import load_posterior
from hqpipe.errors import ConfigError
from hqpipe.files.documents import read_json, read_table
from hqpipe.files.entries import Entry
from hqpipe.identify.uncertainty import NORMAL
from hqpipe.machine.layout import slot

FIT, DIAGNOSIS, RESIDUALS = "fit.json", "diagnosis.json", "residuals.csv"
COEFFICIENTS = ("k1", "k2", "k3", "k4")
POWERS = (2, 0, 2, 1)  # of the sprocket's radius in joint space, eq. (7)
LARGEST = 1e9  # N·m: no error of an actuator model is larger, and its square is finite
LARGEST_COEFFICIENT = 1e15  # as in actuator.json
_FIT_FIX, _DIAGNOSIS_FIX = "run hqpipe fit-actuator again", "run hqpipe diagnose again"


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
            if (fit := _fit_of(folder, model.scope, joint)) is not None:
                swing = fit.get("persistence_rmse")
                error = _beyond(_error(fit, "free_run_rmse"), _error(fit, "noise"))
                known = swing is not None and swing.value is not None
                found[joint] = Left(error, _error(fit, "persistence_rmse") ** 2 if known else None)
        return found
    if not all((folder / name).is_file() for name in (DIAGNOSIS, RESIDUALS)):
        return {}
    noise = _noise(folder / DIAGNOSIS, model.joints)
    if noise is None:
        return {}
    path, found = folder / RESIDUALS, {}
    for row in read_table(path, ("trial", "joint", "family", "rmse"), _DIAGNOSIS_FIX):
        if (row["trial"], row["family"]) != ("all", "all"):
            continue
        # Without causes the model is what it was before.
        after = _cell(path, row, "rmse_after" if row.get("rmse_after") else "rmse")
        held = _cell(path, row, "rmse_persistence") ** 2 if row.get("rmse_persistence") else None
        found[row["joint"]] = Left(_beyond(after, noise.get(row["joint"], 0.0)), held)
    return found


def _noise(path: Path, joints: Sequence[str]) -> dict[str, float] | None:
    """Joint → noise floor of diagnosis.json in the unit of the joint; None where it has no gap. A file of the first format has
    one floor for all joints."""
    gap = Entry(read_json(path, _DIAGNOSIS_FIX), path, _DIAGNOSIS_FIX).table().get("gap")
    if gap is None or gap.value is None:
        return None
    fields = gap.table()
    if "joints" not in fields:
        return dict.fromkeys(joints, _floor(gap))
    entries = fields["joints"].items()
    for entry in entries:
        if "joint" not in entry.table():
            raise entry.error("missing field 'joint'")
    return {entry.table()["joint"].text(): _floor(entry) for entry in entries}


def _floor(entry: Entry) -> float:
    fields = entry.table()
    if "noise_floor" not in fields:
        raise entry.error("missing field 'noise_floor'")
    return fields["noise_floor"].number(0.0, LARGEST, unit="N·m")


def _coefficients(folder: Path, model: Hydraulic, joint: str) -> Iterator[tuple[str, float]]:
    """Name and variance of the coefficients that the logs determined: from the posterior, else from the intervals."""
    posterior = load_posterior(folder, model)
    if posterior is not None:
        group = next(group for group in posterior.groups if joint in group.joints)
        for i, name in enumerate(posterior.fields):
            if group.scatter[i, i] > 0.0:
                yield name, float(group.scatter[i, i])
        return
    fit = _fit_of(folder, model.scope, joint)
    for each in fit["coefficients"].items() if fit is not None and "coefficients" in fit else ():
        fields = each.table()
        if "name" not in fields:
            raise each.wrong(f"an object with a name of {', '.join(COEFFICIENTS)}")
        name, interval = fields["name"].text(COEFFICIENTS), fields.get("ci95")
        if interval is not None and interval.value:
            low, high = interval.numbers(2, lower=-LARGEST_COEFFICIENT, upper=LARGEST_COEFFICIENT)
            if not low <= high:
                raise interval.error(f"low {low:g} is above high {high:g}")
            yield name, ((high - low) / (2.0 * NORMAL)) ** 2


def _fit_of(folder: Path, scope: str, joint: str) -> dict[str, Entry] | None:
    """The entry of fit.json for a joint; None without it."""
    path = folder / FIT
    if not path.exists():
        return None
    part = Entry(read_json(path, _FIT_FIX), path, _FIT_FIX).table().get(scope)
    fits = part.table().get("fits") if part is not None else None
    for fit in fits.items() if fits is not None else ():
        fields = fit.table()
        if "joint" not in fields:
            raise fit.error("missing field 'joint'")
        if fields["joint"].text() in (joint, "all"):
            return fields
    return None


def _error(fit: dict[str, Entry], name: str) -> float:
    """A root mean squared error of a fit, N·m."""
    if name not in fit:
        raise fit["joint"].error(f"missing field '{name}' beside it")
    return fit[name].number(0.0, LARGEST, unit="N·m")


def _cell(path: Path, row: dict[str, str], column: str) -> float:
    """A root mean squared error of residuals.csv, N·m."""
    try:
        value = float(row[column])
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= LARGEST:
        raise ConfigError(
            f"{path}: joint {row['joint'][:80]}: {column}: expected a number, got '{row[column][:40]}'",
            file=path,
            field=column,
            fix=_DIAGNOSIS_FIX,
        )
    return value


def _beyond(error: float, noise: float) -> float:
    return max(error**2 - noise**2, 0.0)
