"""logset.yaml."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from hqpipe.errors import LogError, near_match
from hqpipe.logs import FORMAT

FILE = "logset.yaml"
_CHOICES = {
    "base": ("floating", "fixed"),
    "control_mode": ("position", "torque", "valve"),
    "effort_source": ("pressure", "load_cell", "current", "estimate"),
}
_KEYS = ("format", "robot", "base", "control_mode", "effort_source", "rate_hz", "trials")
_TRIAL_KEYS = ("file", "split", "command", "base")
SPLITS = ("fit", "heldout")


@dataclass(frozen=True)
class TrialEntry:
    """One line of `trials`; `file` is relative to the log set, `base` only where it differs from the set's."""

    file: str
    split: str
    command: dict[str, float] | None = None
    base: str | None = None


@dataclass(frozen=True)
class Manifest:
    """The fields of logset.yaml; None where it is silent."""

    trials: tuple[TrialEntry, ...]
    robot: str | None = None
    base: str | None = None
    control_mode: str | None = None
    effort_source: str | None = None
    rate_hz: float | None = None


def read_manifest(path: Path, files: Iterable[str], *, needs_fit: bool = True) -> Manifest:
    """Read and check a logset.yaml.

    Args:
        path: the file. files: names of the trial files beside it, for near matches.
        needs_fit: whether a trial must be there to fit to.

    Raises:
        LogError: no YAML, an unknown key, a wrong value, or a file that is not there.
    """
    try:
        raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: not YAML: {error}") from error
    if not isinstance(raw, dict):
        raise LogError(f"{path}: expected the fields {', '.join(_KEYS)}, got {type(raw).__name__}")
    _check_keys(path, "", raw, _KEYS)
    if raw.get("format") != FORMAT:
        raise LogError(f"{path}: format is {raw.get('format')!r}, expected {FORMAT}")
    for key in _CHOICES:
        _check_choice(path, key, raw.get(key), key)
    rate = raw.get("rate_hz")
    if rate is not None and not (_is_number(rate) and rate > 0):
        raise LogError(f"{path}: rate_hz is {rate!r}, expected samples per second, e.g. 1000")
    if not isinstance(raw.get("robot"), str | None):
        raise LogError(f"{path}: robot is {raw['robot']!r}, expected a name or the path of a URDF")
    trials = _trials(path, raw.get("trials"), list(files), needs_fit)
    settings = {key: raw.get(key) for key in ("robot", *_CHOICES)}
    return Manifest(trials=trials, rate_hz=None if rate is None else float(rate), **settings)


def _trials(path: Path, raw: Any, files: list[str], needs_fit: bool) -> tuple[TrialEntry, ...]:
    if not isinstance(raw, list) or not raw:
        raise LogError(f"{path}: trials: expected a list of {{file, split}}, got {raw!r}")
    entries = [_trial(path, index, item, files) for index, item in enumerate(raw)]
    names = [entry.file for entry in entries]
    for name in names:
        if names.count(name) > 1:
            raise LogError(f"{path}: trials: {name} is listed twice; a trial belongs to one split")
    if needs_fit and not any(entry.split == "fit" for entry in entries):
        raise LogError(f"{path}: trials: none has split: fit; expected at least one")
    return tuple(entries)


def _trial(path: Path, index: int, raw: Any, files: list[str]) -> TrialEntry:
    where = f"trials[{index}]"
    if not isinstance(raw, dict):
        raise LogError(f"{path}: {where}: expected {{file, split}}, got {raw!r}")
    _check_keys(path, where + ".", raw, _TRIAL_KEYS)
    file, split, command = raw.get("file"), raw.get("split"), raw.get("command")
    if not isinstance(file, str):
        raise LogError(f"{path}: {where}.file is {file!r}, expected the name of a trial file")
    if PurePosixPath(file).is_absolute() or ".." in PurePosixPath(file).parts:
        raise LogError(f"{path}: {where}.file is {file!r}, expected a path inside the log set")
    if not (path.parent / file).is_file():
        raise LogError(f"{path}: {where}.file: no file '{file}'{near_match(file, files)}")
    if split not in SPLITS:
        raise LogError(f"{path}: {where}.split is {split!r}{near_match(str(split), SPLITS)}, expected fit or heldout")
    if command is not None:
        if not isinstance(command, dict) or not all(_is_number(v) for v in command.values()):
            raise LogError(f"{path}: {where}.command is {command!r}, expected numbers, e.g. {{vx: 0.4}}")
        command = {str(name): float(value) for name, value in command.items()}
    _check_choice(path, f"{where}.base", raw.get("base"), "base")
    return TrialEntry(file, split, command, raw.get("base"))


def _check_choice(path: Path, field: str, value: Any, key: str) -> None:
    choices = _CHOICES[key]
    if value is not None and value not in choices:
        hint = near_match(str(value), choices)
        raise LogError(f"{path}: {field} is {value!r}{hint}, expected one of {', '.join(choices)}")


def _check_keys(path: Path, prefix: str, raw: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in raw:
        if key not in known:
            raise LogError(f"{path}: unknown field '{prefix}{key}'{near_match(str(key), known)}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def write_manifest(path: Path, manifest: Manifest) -> None:
    """Write a logset.yaml; silent fields are left out."""
    fields: dict[str, Any] = {"format": FORMAT}
    for key in _KEYS[1:-1]:
        value = getattr(manifest, key)
        if value is not None:
            fields[key] = int(value) if isinstance(value, float) and value.is_integer() else value
    fields["trials"] = [
        {"file": t.file, "split": t.split}
        | ({"command": dict(t.command)} if t.command else {})
        | ({"base": t.base} if t.base and t.base != manifest.base else {})
        for t in manifest.trials
    ]
    text = yaml.safe_dump(fields, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110)
    path.write_text(text, encoding="utf-8")
