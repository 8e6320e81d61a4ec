"""Recordings of SAGE (github.com/isaac-sim2real/sage): a folder per motion with control.csv and state_motor.csv."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.logs.imports.decoding import decoding
from hqpipe.logs.imports.recording import ImportLogError, Recording, Stream

_CONTROL, _STATE, _NAMES = "control", "state_motor", "joint_list.txt"
_LISTS = {"positions": ("position", "rad"), "velocities": ("velocity", "rad/s"), "torques": ("effort", "N·m")}
_EXTRA = ("temperatures", "currents")  # that the README names beside the three
_CLOCK = "timestamp"
_SECONDS = {
    1.0: "s",
    1e-5: "10 µs",
    1e-6: "µs",
}  # in simulation; of the collectors for Unitree and Realman; of the README
_SLOWEST = 1.0  # assumption: no recorder runs at a lower rate than 1 Hz, so that a larger step is no second
_ALIKE = 2.0  # times; assumption: noise and coarse speeds change the distance by less
_GRIPPERS = ("Jaw", "gripper")  # so101_lerobot_collector.py writes 0 to 1 for it
_FIX = "copy the folder again, or leave it out"


class SageReader:
    """One motion; every entry of the lists in the CSV files is a field `positions/<joint>`."""

    suffixes = ()
    extra = None

    @staticmethod
    def claims_folder(folder: Path) -> bool:
        """Whether a folder holds the two files of a motion."""
        return all((folder / f"{name}.csv").is_file() for name in (_CONTROL, _STATE))

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """One recording with the streams `control` and `state_motor`, in s from the first sample of both.

        Raises:
            ImportLogError: a file is missing or damaged, or its lists have not one entry per joint.
        """
        stamps: dict[str, np.ndarray] = {}
        fields: dict[str, dict[str, np.ndarray]] = {}
        for name in (_CONTROL, _STATE):
            stamps[name], fields[name] = _table(path / f"{name}.csv")
        joints = _joints(path)
        notes: list[str] = []
        factor = _factor(stamps[_STATE], fields[_STATE], notes)
        start = min(times[0] for times in stamps.values())
        streams = []
        for name, lists in fields.items():
            columns = {}
            for key, values in lists.items():
                names = _names(path / f"{name}.csv", joints, values.shape[1], notes)
                columns |= {f"{key}/{joint}": column for joint, column in zip(names, values.T, strict=True)}
            streams.append(Stream(name, columns, time=(stamps[name] - start) * factor, time_name=_CLOCK))
        notes += _observed(fields[_STATE], joints)
        return [Recording(path, tuple(streams), notes=tuple(dict.fromkeys(notes)))]


def mapping(recordings: Sequence[Recording]) -> dict[str, Any]:
    """SAGE motions: positions, velocities and torques of state_motor.csv, targets of control.csv."""
    found = [_fields_of(recording) for recording in recordings]
    common = [name for name in found[0] if all(name in each for each in found)] if found else []
    position = f"{_STATE}/positions/"
    joints = [name.removeprefix(position) for name in common if name.startswith(position)]
    joints = [joint for joint in joints if f"{_CONTROL}/positions/{joint}" in common]
    if not joints:
        raise ImportLogError("no motion of SAGE among the sources", fix="name the folders that hold control.csv")
    content: dict[str, Any] = {}
    for joint in joints:
        channels = {"position_command": {"field": f"{_CONTROL}/positions/{joint}", "unit": "rad"}}
        for key, (channel, unit) in _LISTS.items():
            if all(f"{_STATE}/{key}/{each}" in common for each in joints):
                channels[channel] = {"field": f"{_STATE}/{key}/{joint}", "unit": unit}
        content[joint] = channels
    return {
        "format": "hqpipe-log-map/1",
        "base": "fixed",
        "control_mode": "position",
        "effort_source": "current",
        "clock": {"stream": _STATE},
        "joints": content,
    }


def _fields_of(recording: Recording) -> list[str]:
    return [f"{stream.name}/{name}" for stream in recording.streams for name in stream.fields]


def _table(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """(T,) time stamps as stored, and list → (T, n)."""
    with decoding(path, "a table of SAGE", _FIX), path.open(encoding="utf-8-sig", newline="") as stream:
        rows = csv.DictReader(stream, strict=True)
        lists = [name for name in (*_LISTS, *_EXTRA) if name in (rows.fieldnames or ())]
        if _CLOCK not in (rows.fieldnames or ()) or "positions" not in lists:
            what = (
                f"{path}: expected columns type, {_CLOCK} and positions, got {', '.join(rows.fieldnames or ())[:200]}"
            )
            raise ImportLogError(what, file=path, fix=_FIX)
        times, values = [], {name: [] for name in lists}
        for row in rows:
            try:
                times.append(float(row[_CLOCK]))
                for name in lists:
                    values[name].append([float(cell) for cell in row[name].strip(" []").split(",")])
            except (ValueError, TypeError, AttributeError) as error:
                what = f"{path}:{rows.line_num}: expected a time stamp and lists of numbers"
                raise ImportLogError(what, file=path, fix=_FIX) from error
    if len(times) < 2:
        raise ImportLogError(f"{path}: fewer than 2 samples", file=path, fix=_FIX)
    for name in lists:
        if len({len(each) for each in values[name]}) > 1:
            raise ImportLogError(f"{path}: the lists of {name} differ in length", file=path, field=name, fix=_FIX)
    return np.array(times), {name: np.array(each) for name, each in values.items()}


def _joints(path: Path) -> list[str]:
    """Names in joint_list.txt; of a path as the simulation writes it, the last part."""
    file = path / _NAMES
    with decoding(file, "a list of joints", _FIX):
        names = [line.strip().rpartition("/")[2] for line in file.read_text(encoding="utf-8-sig").splitlines()]
    names = [name for name in names if name]
    if len(set(names)) < len(names) or not names:
        raise ImportLogError(f"{file}: expected names of joints, each once", file=file, fix=_FIX)
    return names


def _names(file: Path, joints: list[str], count: int, notes: list[str]) -> list[str]:
    """Joints of the entries of a list; a shorter list is that of the last joints."""
    if count > len(joints):
        what = f"{file}: lists of {count} numbers, but {_NAMES} names {len(joints)} joints"
        raise ImportLogError(what, file=file, fix=f"complete {_NAMES}")
    if count < len(joints):
        notes.append(
            f"{file.name}: lists of {count} of the {len(joints)} joints, taken as the last ones: "
            "the collector for Unitree writes the upper body alone"
        )
    return joints[len(joints) - count :]


def _factor(stamps: np.ndarray, fields: dict[str, np.ndarray], notes: list[str]) -> float:
    """Seconds in a unit of the time stamps: that with which the recorded speeds cover the distance travelled."""
    step = float(np.median(np.diff(stamps)))
    if step < _SLOWEST:
        return 1.0
    factor, reason = 1e-6, "as the README of SAGE says"
    if "velocities" in fields and fields["velocities"].shape == fields["positions"].shape:
        distance = float(np.nansum(np.abs(np.diff(fields["positions"], axis=0))))
        covered = float(np.nansum(np.abs(fields["velocities"][1:]) * np.diff(stamps)[:, None]))
        if distance > 0 and covered > 0:
            ratio = distance / covered
            factor = min((1e-5, 1e-6), key=lambda each: abs(np.log(ratio / each)))
            reason = "with which the recorded velocities cover the distance travelled"
            if not 1 / _ALIKE < ratio / factor < _ALIKE:
                reason = (
                    f"although the recorded velocities then cover {factor / ratio:.2g} times the distance travelled"
                )
    notes.append(f"{_CLOCK} is in units of {_SECONDS[factor]}, {reason}")
    return factor


def _observed(state: dict[str, np.ndarray], joints: list[str]) -> list[str]:
    """What of the signals a user should know."""
    notes = []
    torques = state.get("torques")
    if torques is not None and torques.size and np.nanmin(torques) >= 0 and np.nanmax(torques) > 0:
        notes.append("torques have no sign: they are the magnitude of a current, scaled")
    if named := [joint for joint in joints if joint in _GRIPPERS]:
        notes.append(f"{named[0]}: the collector for the SO-101 writes 0 to 1 for the gripper, not rad")
    return notes
