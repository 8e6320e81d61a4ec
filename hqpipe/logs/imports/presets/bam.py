"""Recordings of BAM (github.com/Rhoban/bam): one servo that moves a pendulum, a JSON file per trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.files.documents import read_json
from hqpipe.logs.imports.decoding import AGAIN
from hqpipe.logs.imports.recording import ImportLogError, Recording, Stream

JOINT = "pendulum"
_ENTRIES, _CLOCK, _DRIVEN = "entries", "timestamp", "torque_enable"
_DUTY = "duty"
_NEEDED = ("position", "goal_position", _CLOCK)
_PWM_COUNTS = 885  # duty 1 of the XL330, e-Manual of the XL330-M288-T: PWM limit
_XL330 = ("xl330", "xl330i")
_WRAP = 2**16  # the older recorder wrote the two bytes of Present PWM without their sign
_LOADS = {"mass": "mass_kg", "length": "lever_m", "arm_mass": "arm_mass_kg", "arm-mass": "arm_mass_kg"}
_DRIVES = {"kp": "firmware_kp", "damping": "firmware_kd", "vin": "supply_v"}  # gains in the units of the servo
_LEAST = 10  # samples; a shorter run between switching on and off is no trial


class BamReader:
    """Raw or processed recordings; the parts with the servo on and off are recordings of their own."""

    suffixes = (".json",)
    extra = None

    @staticmethod
    def claims_file(path: Path) -> bool:
        """Whether a JSON file names the trajectory and lists entries."""
        try:
            with path.open("rb") as stream:
                head = stream.read(4096)
        except OSError:
            return False
        return b'"trajectory"' in head and b'"entries"' in head

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """A recording named `sin_sin_kp100` where the servo holds its target, and `…_off` where it is switched off.

        Raises:
            ImportLogError: not JSON, or not as BAM writes it.
        """
        content = read_json(path, AGAIN, ImportLogError)
        fields = _fields(path, content)
        driven = fields.get(_DRIVEN, np.ones(len(fields[_CLOCK]))) > 0.5
        notes = _add_duty(content, fields)
        name = f"{content.get('trajectory', 'trajectory')}_kp{content.get('kp', '')}"
        edges = [0, *(np.flatnonzero(np.diff(driven)) + 1), len(driven)]
        runs = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True) if b - a >= _LEAST]
        seen: dict[str, int] = {}
        recordings = []
        for run in runs:
            part = name if driven[run.start] else f"{name}_off"
            seen[part] = seen.get(part, 0) + 1
            part = part if seen[part] == 1 else f"{part}_{seen[part]}"
            stream = Stream("", {each: values[run] for each, values in fields.items()})
            recordings.append(Recording(path, (stream,), part, notes, *_stated(path, content)))
        if not recordings:
            raise ImportLogError(f"{path}: fewer than {_LEAST} entries", file=path, field=_ENTRIES, fix=AGAIN)
        return recordings


def mapping(recordings: Sequence[Recording]) -> dict[str, Any]:
    """BAM pendulum recordings: position, target, servo speed, duty, supply voltage and temperature."""
    streams = [recording.streams[0] for recording in recordings]
    if not streams or not all(name in stream.fields for name in _NEEDED for stream in streams):
        raise ImportLogError("no recording of BAM among the files", fix="name .json files of bam.dynamixel.record")
    channels = {
        "position": {"field": "position", "unit": "rad"},
        "position_command": {"field": "goal_position", "unit": "rad"},
    }
    if _in_all(streams, "speed"):
        channels["velocity"] = {"field": "speed", "unit": "rad/s"}
    if _in_all(streams, _DUTY):
        channels["duty"] = {"field": _DUTY, "unit": "1"}
    shared = {}
    if _in_all(streams, "input_volts"):
        shared["supply/voltage"] = {"field": "input_volts", "unit": "V"}
    if _in_all(streams, "temp"):
        shared["servo/temperature"] = {"field": "temp", "unit": "°C"}
    return {
        "format": "hqpipe-log-map/1",
        "base": "fixed",
        "control_mode": "position",
        "clock": {"field": _CLOCK, "unit": "s"},
        "joints": {JOINT: channels},
        **({"shared": shared} if shared else {}),
        "trials": [{"files": "*_off*", "split": "skip"}],
    }


def _in_all(streams: list[Stream], name: str) -> bool:
    return all(name in stream.fields for stream in streams)


def _fields(path: Path, content: Any) -> dict[str, np.ndarray]:
    """Field → (T,) of the entries, truths as 0 and 1."""
    entries = content.get(_ENTRIES) if isinstance(content, dict) else None
    if not isinstance(entries, list) or not entries or not all(isinstance(entry, dict) for entry in entries):
        raise ImportLogError(f"{path}: entries: expected a list of samples", file=path, field=_ENTRIES, fix=AGAIN)
    names = [name for name, value in entries[0].items() if isinstance(value, (int, float))]
    if lacking := [name for name in _NEEDED if name not in names]:
        what = f"{path}: entries: no number '{lacking[0]}' in the first one"
        raise ImportLogError(what, file=path, field=f"{_ENTRIES}.{lacking[0]}", fix=AGAIN)
    values: dict[str, list[float]] = {name: [] for name in names}
    for index, entry in enumerate(entries):
        for name in names:
            value = entry.get(name)
            if not isinstance(value, (int, float)):
                where = f"{_ENTRIES}[{index}].{name}"
                raise ImportLogError(f"{path}: {where}: expected a number", file=path, field=where, fix=AGAIN)
            values[name].append(float(value))
    return {name: np.array(each) for name, each in values.items()}


def _add_duty(content: dict[str, Any], fields: dict[str, np.ndarray]) -> tuple[str, ...]:
    """Make a field `duty` of the PWM of an XL330, which newer recorders write as duty, older ones as an unsigned count."""
    if content.get("motor") not in _XL330 or "load" not in fields:
        return ()
    load = fields["load"]
    if np.abs(load).max() <= 1.0:
        fields[_DUTY] = load
        return ()
    fields[_DUTY] = np.where(load >= _WRAP / 2, load - _WRAP, load) / _PWM_COUNTS
    return (f"duty is load as a signed number of 16 bits, divided by {_PWM_COUNTS}",)


def _stated(path: Path, content: dict[str, Any]) -> tuple[dict[str, dict[str, float]], dict[str, dict[str, float]]]:
    """Drive and load of the joint, as far as the file states them."""
    found = []
    for names in (_DRIVES, _LOADS):
        known = {}
        for name, quantity in names.items():
            if (value := content.get(name)) is None:
                continue
            if not isinstance(value, (int, float)) or isinstance(value, bool):
                raise ImportLogError(f"{path}: {name}: expected a number", file=path, field=name, fix=AGAIN)
            known[quantity] = float(value)
        found.append({JOINT: known} if known else {})
    return found[0], found[1]
