"""actuator.json: an actuator model on disk; a net has its weights beside it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hqpipe.actuators import ACTUATOR_MODELS, weights_file
from hqpipe.actuators.base import FORMAT, ActuatorModel
from hqpipe.actuators.keys import check_keys
from hqpipe.actuators.net import NetActuator, check_description
from hqpipe.errors import ConfigError, UsageError, near_match

FILE = "actuator.json"
_KEYS = ("format", "model", "joints", "dt", "scope", "parameters")


def save_actuator(model: ActuatorModel, folder: Path) -> Path:
    """Write `folder`/actuator.json, for a net weights.safetensors too, and return the path of the first.

    The same model gives the same bytes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / FILE
    text = json.dumps(model.to_dict(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    path.write_text(text, encoding="utf-8")
    if isinstance(model, NetActuator):
        weights_file.save_weights(model.tensors, folder / weights_file.FILE)
    return path


def load_actuator(folder: Path) -> ActuatorModel:
    """Read and check `folder`/actuator.json, for a net weights.safetensors too.

    Raises:
        ConfigError: a file is missing or broken, or a field or tensor is missing, unknown or out of bounds.
    """
    path = folder / FILE
    if not path.is_file():
        raise ConfigError(f"{path}: no such file; expected the output of hqpipe fit-actuator or diagnose")
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ConfigError(f"{path}: not JSON ({error}); write it with save_actuator") from error
    return parse_actuator(raw, path)


def parse_actuator(raw: Any, path: Path) -> ActuatorModel:
    """Build the model that `raw` describes; `path` is where it was read, with the weights of a net beside it."""
    name = str(raw.get("model")) if isinstance(raw, dict) else ""
    try:
        check_keys(raw, _KEYS + (ACTUATOR_MODELS[name].KEYS if name in ACTUATOR_MODELS else ()))
        if raw["format"] != FORMAT:
            raise UsageError(f"format is '{raw['format']}', expected {FORMAT}")
        model = ACTUATOR_MODELS[name]
        _check_types(raw, model)
        if issubclass(model, NetActuator):
            return _with_weights(raw, model, path.with_name(weights_file.FILE))
        return model.from_dict(raw)
    except ConfigError:
        raise  # of the weights, which it names
    except UsageError as error:
        raise ConfigError(f"{path}: {error}") from error


def _with_weights(raw: dict[str, Any], model: type[NetActuator], path: Path) -> NetActuator:
    check_description(raw["net"])
    shapes = model.shapes(len(raw["joints"]), raw["net"]["hidden"], len(raw["net"]["taps"]))
    return model.from_dict(raw, weights_file.load_weights(path, shapes))


def _check_types(raw: dict[str, Any], model: type[ActuatorModel]) -> None:
    joints = raw["joints"]
    if not isinstance(joints, list) or not all(isinstance(j, str) for j in joints):
        raise UsageError("joints: expected a list of names")
    if raw["dt"] is not None and not _is_number(raw["dt"]):
        raise UsageError(f"dt: expected seconds or null, got {raw['dt']!r}")
    if not isinstance(raw["parameters"], dict):
        raise UsageError("parameters: expected an object of name → {unit, values}")
    for name, entry in raw["parameters"].items():
        if name not in model.FIELDS:
            raise UsageError(f"parameters: unknown '{name}'{near_match(name, model.FIELDS)}")
        spec = model.FIELDS[name]
        if not isinstance(entry, dict) or set(entry) != {"unit", "values"}:
            raise UsageError(f"parameters.{name}: expected {{unit, values}}")
        if entry["unit"] != spec.unit:
            raise UsageError(f"parameters.{name}: unit is '{entry['unit']}', expected '{spec.unit}'")
        values = entry["values"]
        if not isinstance(values, list) or len(values) != len(joints):
            raise UsageError(f"parameters.{name}: expected {len(joints)} values, one per joint")
        for joint, value in zip(joints, values, strict=True):
            if not (_is_number(value) or (value is None and spec.may_be_infinite)):
                raise UsageError(f"parameters.{name}: joint {joint} is {value!r}, expected a number")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
