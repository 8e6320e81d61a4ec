"""logset.yaml."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from stat import S_ISDIR, S_ISREG
from typing import Any

import yaml

from hqpipe.errors import LogError, near_match, shown
from hqpipe.files.documents import read_yaml_mapping
from hqpipe.logs import FORMAT
from hqpipe.logs.drive import DRIVE, EVERY_JOINT, LOAD, Stated, read_stated
from hqpipe.logs.joint_kinds import KINDS

FILE = "logset.yaml"
CHOICES = {
    "base": ("floating", "fixed"),
    "control_mode": ("position", "torque", "valve"),
    "effort_source": ("pressure", "load_cell", "current", "estimate"),
}
COMMAND_OF = {"position": "position_command", "torque": "effort_command", "valve": "valve_command"}
"""Control mode → the channel that is its input."""
_KEYS = (
    "format",
    "robot",
    "base",
    "control_mode",
    "effort_source",
    "rate_hz",
    "drive",
    "load",
    "urdf",
    "joint_map",
    "joints",
    "trials",
)
_JOINT_KEYS = ("type",)
_TRIAL_KEYS = ("file", "split", "command", "base", "drive", "load")
SPLITS = ("fit", "heldout")
_RATES = (1e-3, 1e7)  # Hz; a sample a quarter of an hour, and a thousand times what joint controllers run at


@dataclass(frozen=True)
class TrialEntry:
    """One line of `trials`; `file` is relative to the log set, the last three only where they differ from the set's."""

    file: str
    split: str
    command: dict[str, float] | None = None
    base: str | None = None
    drive: Stated = field(default_factory=dict)
    load: Stated = field(default_factory=dict)


@dataclass(frozen=True)
class Manifest:
    """The fields of logset.yaml; None or empty where it is silent.

    Attributes:
        drive, load: of the joints, see `hqpipe.logs.drive`. urdf: path of the robot description that the joints belong to.
        joint_map: joint of the logs → joint of that description, where the names differ.
        kinds: joint → type, of the joints that it names.
    """

    trials: tuple[TrialEntry, ...]
    robot: str | None = None
    base: str | None = None
    control_mode: str | None = None
    effort_source: str | None = None
    rate_hz: float | None = None
    drive: Stated = field(default_factory=dict)
    load: Stated = field(default_factory=dict)
    urdf: str | None = None
    joint_map: dict[str, str] = field(default_factory=dict)
    kinds: Mapping[str, str] = field(default_factory=dict)


def read_manifest(path: Path, files: Iterable[str], *, needs_fit: bool = True) -> Manifest:
    """Read and check a logset.yaml.

    Args:
        path: the file. files: names of the trial files beside it, for near matches.
        needs_fit: whether a trial must be there to fit to.

    Raises:
        LogError: no YAML, an unknown field, a wrong value, or a file that is not there.
    """
    raw = read_yaml_mapping(path, "correct it, docs/how-to/bring-your-own-logs.md shows one", LogError)
    _check_keys(path, "", raw, _KEYS)
    if raw.get("format") != FORMAT:
        raise _wrong(
            path, "format", f"format is {shown(raw.get('format'))}, expected {FORMAT}", f"write format: {FORMAT}"
        )
    for key in CHOICES:
        _check_choice(path, key, raw.get(key), key)
    rate = raw.get("rate_hz")
    if rate is not None and not (_is_number(rate) and _RATES[0] <= rate <= _RATES[1]):
        expected = f"expected samples per second, {_RATES[0]:g} to {_RATES[1]:g}, e.g. 1000"
        raise _wrong(path, "rate_hz", f"rate_hz is {shown(rate)}, {expected}", "correct it, or leave it out")
    if not isinstance(raw.get("robot"), str | None):
        what = f"robot is {shown(raw['robot'])}, expected a name or the path of a URDF"
        raise _wrong(path, "robot", what, "put it in quotes, or leave it out")
    if not isinstance(raw.get("urdf"), str | None):
        what = f"urdf is {shown(raw['urdf'])}, expected the path of a URDF"
        raise _wrong(path, "urdf", what, "put it in quotes, or leave it out")
    names = raw.get("joint_map") or {}
    if not isinstance(names, dict) or not all(isinstance(n, str) for pair in names.items() for n in pair):
        what = f"joint_map is {shown(names)}, expected names of joints in the logs and in the URDF"
        raise _wrong(path, "joint_map", what, "write joint_map: {LOGGED: IN_URDF}, or leave it out")
    return Manifest(
        trials=_trials(path, raw.get("trials"), list(files), needs_fit),
        rate_hz=None if rate is None else float(rate),
        drive=read_stated(path, "drive", raw.get("drive"), DRIVE),
        load=read_stated(path, "load", raw.get("load"), LOAD),
        joint_map=dict(names),
        kinds=_kinds(path, raw.get("joints")),
        **{key: raw.get(key) for key in ("robot", "urdf", *CHOICES)},
    )


def _kinds(path: Path, raw: Any) -> dict[str, str]:
    """Joint → type of `joints`, as {slide: {type: prismatic}}."""
    if raw is None:
        return {}
    fix = "write joints: {NAME: {type: prismatic}}, or leave it out"
    if not isinstance(raw, dict):
        raise _wrong(path, "joints", f"joints is {shown(raw)}, expected the joints by name", fix)
    kinds = {}
    for name, entry in raw.items():
        where = f"joints.{name[:99]}"
        if not isinstance(entry, dict):
            raise _wrong(path, where, f"{where} is {shown(entry)}, expected {{type: prismatic}}", fix)
        _check_keys(path, where + ".", entry, _JOINT_KEYS)
        if entry.get("type") not in KINDS:
            found = entry.get("type")
            what = f"{where}.type is {shown(found)}{_near(found, KINDS)}, expected one of {', '.join(KINDS)}"
            raise _wrong(path, f"{where}.type", what, fix)
        kinds[name] = entry["type"]
    return kinds


def _trials(path: Path, raw: Any, files: list[str], needs_fit: bool) -> tuple[TrialEntry, ...]:
    if not isinstance(raw, list) or not raw:
        what = f"trials: expected a list of {{file, split}}, got {shown(raw)}"
        raise _wrong(path, "trials", what, "list the files of the trials, or remove logset.yaml to have them found")
    entries = [_trial(path, index, item, files) for index, item in enumerate(raw)]
    seen = set()
    for name in (entry.file for entry in entries):
        if name in seen:
            what = f"trials: {name} is listed twice; a trial belongs to one split and counts once"
            raise _wrong(path, "trials", what, "remove one of the two lines")
        seen.add(name)
    if needs_fit and not any(entry.split == "fit" for entry in entries):
        what = "trials: none has split: fit, expected at least one"
        raise _wrong(path, "trials", what, "give a trial split: fit")
    return tuple(entries)


def _trial(path: Path, index: int, raw: Any, files: list[str]) -> TrialEntry:
    where = f"trials[{index}]"
    if not isinstance(raw, dict):
        raise _wrong(
            path, where, f"{where}: expected {{file, split}}, got {shown(raw)}", "write {file: NAME, split: fit}"
        )
    _check_keys(path, where + ".", raw, _TRIAL_KEYS)
    file = _trial_file(path, f"{where}.file", raw.get("file"), files)
    split, command = raw.get("split"), raw.get("command")
    if split not in SPLITS:
        what = f"{where}.split is {shown(split)}{_near(split, SPLITS)}, expected fit or heldout"
        raise _wrong(path, f"{where}.split", what, "write split: fit or split: heldout")
    if command is not None:
        if not isinstance(command, dict) or not all(_is_number(v) for v in command.values()):
            what = f"{where}.command is {shown(command)}, expected numbers, e.g. {{vx: 0.4}}"
            raise _wrong(path, f"{where}.command", what, "correct it, or leave it out")
        command = {str(name): float(value) for name, value in command.items()}
    _check_choice(path, f"{where}.base", raw.get("base"), "base")
    drive = read_stated(path, f"{where}.drive", raw.get("drive"), DRIVE)
    load = read_stated(path, f"{where}.load", raw.get("load"), LOAD)
    return TrialEntry(file, split, command, raw.get("base"), drive, load)


def _trial_file(path: Path, field: str, file: Any, files: list[str]) -> str:
    """The name of a trial file that is there."""
    if not isinstance(file, str) or not file:
        what = f"{field} is {shown(file)}, expected the name of a trial file"
        raise _wrong(path, field, what, "write the name in quotes")
    if PurePosixPath(file).is_absolute() or ".." in PurePosixPath(file).parts:
        what = f"{field} is {shown(file)}, expected a path inside the log set"
        raise _wrong(path, field, what, "move or link the file into the folder")
    try:
        status = (path.parent / file).stat()
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        lost = isinstance(error, FileNotFoundError | NotADirectoryError)
        reason = "" if lost else f" ({getattr(error, 'strerror', None) or error})"
        what = f"{field}: no file {shown(file)}{_near(file, files)}{reason}"
        raise _wrong(path, field, what, "correct the name, or remove the line") from error
    if not S_ISREG(status.st_mode):
        what = f"{field}: {shown(file)} is {'a folder' if S_ISDIR(status.st_mode) else 'no regular file'}"
        raise _wrong(path, field, what, "name a file with one trial")
    return file


def _check_choice(path: Path, field: str, value: Any, key: str) -> None:
    choices = CHOICES[key]
    if value is not None and value not in choices:
        hint = _near(value, choices)
        what = f"{field} is {shown(value)}{hint}, expected one of {', '.join(choices)}"
        raise _wrong(path, field, what, "correct it, or leave it out")


def _check_keys(path: Path, prefix: str, raw: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in raw:
        if key not in known:
            name = str(key)[:99] if isinstance(key, str) else shown(key)
            what = f"unknown field '{prefix}{name}'{near_match(name, known)}"
            raise _wrong(path, prefix + name, what, f"expected only {', '.join(known)}")


def _is_number(value: Any) -> bool:
    """Whether it is a number that a float holds."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _near(value: Any, known: Iterable[str]) -> str:
    return near_match(value[:99], known) if isinstance(value, str) else ""


def _wrong(path: Path, field: str | None, what: str, fix: str) -> LogError:
    return LogError(f"{path}: {what}", file=path, field=field, fix=fix)


def _stated(value: Any) -> Any:
    """A drive or load as it is written: plain numbers where they are those of every joint."""
    return value[EVERY_JOINT] if isinstance(value, dict) and list(value) == [EVERY_JOINT] else value


def write_manifest(path: Path, manifest: Manifest) -> None:
    """Write a logset.yaml; silent fields are left out."""
    fields: dict[str, Any] = {"format": FORMAT}
    for key in _KEYS[1:-2]:
        value = _stated(getattr(manifest, key))
        if value is not None and value != {}:
            fields[key] = int(value) if isinstance(value, float) and value.is_integer() else value
    if manifest.kinds:
        fields["joints"] = {joint: {"type": kind} for joint, kind in manifest.kinds.items()}
    fields["trials"] = [
        {"file": t.file, "split": t.split}
        | ({"command": dict(t.command)} if t.command else {})
        | ({"base": t.base} if t.base and t.base != manifest.base else {})
        | ({"drive": _stated(t.drive)} if t.drive and t.drive != manifest.drive else {})
        | ({"load": _stated(t.load)} if t.load and t.load != manifest.load else {})
        for t in manifest.trials
    ]
    text = yaml.safe_dump(fields, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110)
    path.write_text(text, encoding="utf-8")
