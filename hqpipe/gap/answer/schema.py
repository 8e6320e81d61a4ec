"""diagnosis.json (hqpipe-diagnosis/2): its keys, its types and the check of a file against them.

What /2 adds may be absent, so that a file of /1 is read too; `hqpipe diagnose` always writes it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hqpipe.errors import ConfigError, near_match
from hqpipe.files.documents import read_json

FORMAT = "hqpipe-diagnosis/2"
FORMATS = (FORMAT, "hqpipe-diagnosis/1")
FIX = "run hqpipe diagnose again"
VERDICTS = ("explained", "partly_explained", "unknown", "no_gap", "not_identifiable")
LAYERS = ("actuator", "servo", "joint_motion", "rigid_body", "contact", "sensing")
SCOPES = ("joint", "group", "machine")
KINDS = ("revolute", "prismatic", None)
MODES = ("position", "torque", "valve", None)


@dataclass(frozen=True)
class Check:
    """A test of one value and what to say when it fails."""

    expected: str
    passes: Callable[[Any], bool]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and value == value


def _is_interval(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_is_number, value)) and value[0] <= value[1]


def _one_of(*values: str | None) -> Check:
    return Check(" | ".join("null" if v is None else v for v in values), lambda v: v in values)


TEXT = Check("a text", lambda v: isinstance(v, str))
TEXT_OR_NULL = Check("a text or null", lambda v: v is None or isinstance(v, str))
TEXTS = Check("a list of texts", lambda v: isinstance(v, list) and all(isinstance(t, str) for t in v))
COUNT = Check("a whole number ≥ 0", lambda v: isinstance(v, int) and not isinstance(v, bool) and v >= 0)
NUMBER = Check("a number", _is_number)
SIZE = Check("a number ≥ 0", lambda v: _is_number(v) and v >= 0)
SHARE = Check("a number from 0 to 1", lambda v: _is_number(v) and 0 <= v <= 1)
SHARE_OR_NULL = Check("a number from 0 to 1, or null", lambda v: v is None or SHARE.passes(v))
AT_MOST_ONE = Check("a number ≤ 1", lambda v: _is_number(v) and v <= 1)
INTERVAL = Check("[lower, upper]", _is_interval)
TRUTH = Check("true or false", lambda v: isinstance(v, bool))

Shape = Mapping[str, Any]  # key → Check, Shape, [Shape] for a list, or Maybe


@dataclass(frozen=True)
class Maybe:
    """A shape that may be null, or a key that may be absent."""

    shape: Any
    absent: bool = False


@dataclass(frozen=True)
class Named:
    """An object whose keys are free names and whose values share one shape."""

    shape: Any


PLACE = {
    "layer": _one_of(*LAYERS),
    "joint": TEXT,
    "regime": TEXT,
    "share": SHARE,
    "rmse": Maybe(SIZE, absent=True),
    "unit": Maybe(TEXT, absent=True),
    "normalised": Maybe(SIZE, absent=True),
}
PARAMETER = {
    "value": NUMBER,
    "unit": TEXT,
    "ci95": INTERVAL,
    "reference": Maybe(NUMBER, absent=True),  # its value then; null where the effect was absent
    "joints": Maybe(
        Named({"value": NUMBER, "ci95": INTERVAL}), absent=True
    ),  # of each joint, where several were pooled
}
REFERENCE = {"path": TEXT, "kind": _one_of("logs", "actuator"), "sha256": TEXT}
SIZES = {name: SIZE for name in ("before", "after", "noise_floor", "persistence")}
UNITLESS = {name: Maybe(SIZE) for name in SIZES}  # null where a joint has no scale, or the joints no common unit
JOINT_GAP = {
    "joint": TEXT,
    "type": _one_of(*KINDS),
    "unit": TEXT,
    "scale": Maybe(SIZE),
    **SIZES,
    "normalised": UNITLESS,
}
GAP = {
    "layer": _one_of(*LAYERS),
    "metric": TEXT,
    "unit": TEXT_OR_NULL,
    "window_s": SIZE,
    "window_reason": Maybe(TEXT, absent=True),
    **UNITLESS,
    "normalised": Maybe(SIZES, absent=True),
    "joints": Maybe([JOINT_GAP], absent=True),
    "shrink": AT_MOST_ONE,
    "shrink_ci95": INTERVAL,
}
CAUSE = {
    "effect": TEXT,
    "layer": _one_of(*LAYERS),
    "joints": TEXTS,
    "scope": _one_of(*SCOPES),
    "probability": SHARE,
    "parameters": Named(PARAMETER),
    "shrink": AT_MOST_ONE,
    "shrink_ci95": INTERVAL,
    "confused_with": TEXTS,
    "shown_by": Maybe(TEXT, absent=True),  # of a cause that shows in the errors
}
CONSIDERED = {
    "effect": TEXT,
    "layer": _one_of(*LAYERS),
    "joints": TEXTS,
    "scope": _one_of(*SCOPES),
    "score": NUMBER,
    "shrink": Maybe(AT_MOST_ONE),  # null where the effect was not fitted alone
    "reason": TEXT,
}
LEFT_OUT = {
    "trials": TEXTS,
    "joints": TEXTS,
    "channel": TEXT_OR_NULL,
    "kind": TEXT,
    "reason": TEXT,
    "fix": TEXT,
}
DIAGNOSIS = {
    "format": _one_of(*FORMATS),
    "verdict": _one_of(*VERDICTS),
    "logs": {
        "path": TEXT,
        "sha256": TEXT,
        "trials": COUNT,
        "joints": TEXTS,
        "control_mode": _one_of(*MODES),
    },
    "left_out": Maybe([LEFT_OUT], absent=True),
    "reference": Maybe(REFERENCE, absent=True),
    "gap": Maybe(GAP),
    "gaps": Maybe([GAP], absent=True),
    "where": [PLACE],
    "causes": [CAUSE],
    "effects_considered": [CONSIDERED],
    "unexplained": {
        "share_of_gap": SHARE_OR_NULL,
        "above_noise": TRUTH,
        "where": [PLACE],
        "depends_on": [{"signal": TEXT, "joints": TEXTS, "share": SHARE}],
    },
    "next_experiment": TEXT_OR_NULL,
    "warnings": TEXTS,
}


def read_diagnosis(path: Path) -> dict[str, Any]:
    """Read and check a diagnosis.json.

    Raises:
        ConfigError: a key is missing, unknown or of the wrong type.
    """
    content = read_json(path, FIX)
    try:
        validate_diagnosis(content)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error.message}", file=path, field=error.field, fix=FIX) from error
    return content


def validate_diagnosis(raw: Any) -> None:
    """Check a decoded diagnosis.json.

    Raises:
        ConfigError: names the key, what was expected and what was found.
    """
    _check(raw, DIAGNOSIS, "diagnosis")
    if raw["gap"] is None and raw["verdict"] != "not_identifiable":
        raise _wrong("diagnosis.gap", f"null, expected an object with the verdict {raw['verdict']}")
    if raw["gap"] is not None:
        for name in SIZES:
            if (raw["gap"][name] is None) != (raw["gap"]["unit"] is None):
                raise _wrong(f"diagnosis.gap.{name}", "expected a number where the gap has a unit, and null where not")


def _check(value: Any, shape: Any, key: str) -> None:
    if isinstance(shape, Check):
        if not shape.passes(value):
            raise _wrong(key, f"expected {shape.expected}, got {value!r:.80}")
    elif isinstance(shape, Maybe):
        if value is not None:
            _check(value, shape.shape, key)
    elif isinstance(shape, list):
        if not isinstance(value, list):
            raise _wrong(key, f"expected a list, got {type(value).__name__}")
        for index, item in enumerate(value):
            _check(item, shape[0], f"{key}[{index}]")
    elif not isinstance(value, dict):
        raise _wrong(key, f"expected an object, got {type(value).__name__}")
    elif isinstance(shape, Named):
        for name, item in value.items():
            _check(item, shape.shape, f"{key}.{name}")
    else:
        _check_keys(value, shape, key)


def _check_keys(value: Mapping[str, Any], shape: Shape, key: str) -> None:
    for name in value:
        if name not in shape:
            raise _wrong(f"{key}.{name[:80]}", f"unknown key{near_match(name[:80], shape)}")
    for name, inner in shape.items():
        if name in value:
            _check(value[name], inner, f"{key}.{name}")
        elif not (isinstance(inner, Maybe) and inner.absent):
            raise _wrong(f"{key}.{name}", f"missing, expected {_expectation(inner)}")


def _wrong(key: str, problem: str) -> ConfigError:
    return ConfigError(f"{key}: {problem}", field=key)


def _expectation(shape: Any) -> str:
    if isinstance(shape, Check):
        return shape.expected
    return "a list" if isinstance(shape, list) else "an object"
