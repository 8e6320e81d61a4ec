"""actuator.json: an actuator model on disk; a net has its weights beside it."""

from __future__ import annotations

import json
from pathlib import Path

from hqpipe.actuators import ACTUATOR_MODELS, weights_file
from hqpipe.actuators.base import FORMAT, ActuatorModel
from hqpipe.actuators.net import INPUTS, NetActuator
from hqpipe.errors import ConfigError, UsageError, near_match
from hqpipe.files.documents import read_json
from hqpipe.files.entries import Entry

FILE = "actuator.json"
_KEYS = ("format", "model", "joints", "dt", "scope", "parameters")
_FIX = "give the folder of hqpipe fit-actuator or diagnose, or run that again"
LARGEST = (
    1e15  # of a parameter: stiffnesses of rigid joints and inverses of tiny limits stay below, sums of it are finite
)
SLOWEST_S = 1.0  # of a sample: no log of an actuator is taken less often
FASTEST_S = 1e-6
MOST_HIDDEN = 4096  # units; the paper's net has 64. The weights of more would not fit into a processor's cache at 1 kHz
MOST_TAPS = 4096  # samples ago; every robot remembers that many inputs of every joint


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
    document = Entry(read_json(path, _FIX), path, _FIX)
    name = document.value.get("model") if isinstance(document.value, dict) else None
    known = isinstance(name, str) and name in ACTUATOR_MODELS
    fields = document.mapping(_KEYS + (ACTUATOR_MODELS[name].KEYS if known else ()))
    fields["format"].text((FORMAT,))
    fields["model"].text(tuple(ACTUATOR_MODELS))
    model = ACTUATOR_MODELS[name]
    _check_fields(fields, model)
    try:
        if issubclass(model, NetActuator):
            return _with_weights(document, model)
        return model.from_dict(document.value)
    except ConfigError:
        raise  # of the weights, which it names
    except UsageError as error:
        raise ConfigError(f"{path}: {error.message}", file=path, field=error.field, fix=error.fix or _FIX) from error


def _with_weights(document: Entry, model: type[NetActuator]) -> NetActuator:
    raw, net = document.value, document.inner("net")
    _check_net(net)
    sizes = raw["net"]
    shapes = model.shapes(len(raw["joints"]), sizes["hidden"], len(sizes["taps"]), sizes.get("per_joint", False))
    return model.from_dict(raw, weights_file.load_weights(document.file.with_name(weights_file.FILE), shapes))


def _check_net(net: Entry) -> None:
    """Refuse an entry "net" that `NetActuator.to_dict` would not write."""
    fields = net.mapping(("inputs", "taps", "hidden", "delta"), ("per_joint",))
    if fields["inputs"].value != list(INPUTS):
        raise fields["inputs"].wrong(str(list(INPUTS)))
    for tap in fields["taps"].items(1, MOST_TAPS):
        tap.whole(0, MOST_TAPS, "every robot remembers that many inputs of every joint")
    fields["hidden"].whole(1, MOST_HIDDEN, "larger nets cannot be stepped at 1 kHz")
    fields["delta"].flag()
    if "per_joint" in fields:  # files of before there was a choice have one net for all joints
        fields["per_joint"].flag()


def _check_fields(fields: dict[str, Entry], model: type[ActuatorModel]) -> None:
    joints = [item.text() for item in fields["joints"].items(1)]
    if "" in joints:
        raise fields["joints"].error("holds an empty name")
    fields["dt"].or_none(lambda entry: entry.number(FASTEST_S, SLOWEST_S, unit="s"))
    fields["scope"].text(("per_joint", "shared"))
    for name, entry in fields["parameters"].table().items():
        if name not in model.FIELDS:
            raise entry.error(f"unknown parameter '{name[:80]}'{near_match(name[:80], model.FIELDS)}")
        spec, given = model.FIELDS[name], entry.mapping(("unit", "values"))
        if given["unit"].value != spec.unit:
            raise given["unit"].wrong(f"'{spec.unit}'")
        for joint, value in zip(joints, given["values"].items(len(joints), len(joints)), strict=True):
            if value.value is None and spec.may_be_infinite:
                continue
            if isinstance(value.value, bool) or not isinstance(value.value, int | float):
                raise value.error(f"of joint {joint}: expected a number, got {value.value!r}")
            value.number(-LARGEST, LARGEST, unit=spec.unit)
