"""Recordings of PACE (github.com/leggedrobotics/pace-sim2real): a .pt file with `time`, `dof_pos` and `des_dof_pos`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.logs.imports.arrays import Fields, stream_of
from hqpipe.logs.imports.recording import ImportLogError, Recording
from hqpipe.logs.imports.torch_tensors import read_tensors

_TIME, _POSITION, _COMMAND = (
    "time",
    "dof_pos",
    "des_dof_pos",
)  # s and rad, as scripts/pace/data_collection.py writes them
_OPTIONAL = {"dof_vel": ("velocity", "rad/s"), "dof_torque": ("effort", "N·m")}
_GAINS = ("kp", "kd")  # N·m/rad and N·m·s/rad, as collectors that add them to the file send them to the motors
_EVEN = 1e-3  # of a step; float32 seconds are even to 1e-4 of a 5 ms step over some minutes
_FIX = "save time (T,), dof_pos (T, n) and des_dof_pos (T, n)"


class PaceReader:
    """Tensors of a file of torch.save; the file is not unpickled."""

    suffixes = (".pt",)
    extra = None

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """One recording with one stream.

        Raises:
            ImportLogError: no file of torch.save, anything but tensors in it, or not the three that PACE writes.
        """
        tensors = read_tensors(path)
        for name in (_TIME, _POSITION, _COMMAND):
            if name not in tensors:
                found = ", ".join(tensors) or "none"
                raise ImportLogError(f"{path}: no tensor '{name}' (found: {found})", file=path, field=name, fix=_FIX)
        time, position = tensors[_TIME].reshape(-1), tensors[_POSITION]
        shapes = {name: tensors[name].shape for name in (_POSITION, _COMMAND)}
        if position.ndim != 2 or len(time) < 2 or any(s != (len(time), position.shape[1]) for s in shapes.values()):
            what = f"{path}: time has {len(time)} samples, {' and '.join(f'{n} {s}' for n, s in shapes.items())}"
            raise ImportLogError(f"{what}, expected (T, n) for both", file=path, fix=_FIX)
        fields = Fields()
        for name, values in tensors.items():
            if name in _GAINS:
                continue
            columns = values.reshape(len(time), -1) if values.ndim and len(values) == len(time) else None
            if columns is None:
                fields.left[name] = "of another length than time"
            elif name == _TIME:
                fields.add(_TIME, time, "s")
            else:
                for index, column in enumerate(columns.T):
                    fields.add(f"{name}[{index}]", column)
        notes = ["the file does not name its joints: joint_00, joint_01, … in its order", *fields.notes()]
        steps = np.diff(time)
        if np.ptp(steps) < _EVEN * abs(np.median(steps)):
            notes.append("time is evenly spaced: computed afterwards, so that jitter and delay are not in it")
        drive = _gains(tensors, position.shape[1])
        return [Recording(path, (stream_of("", fields, fields.arrays),), notes=tuple(notes), drive=drive)]


def _gains(tensors: dict[str, np.ndarray], joints: int) -> dict[str, dict[str, float]]:
    """Joint → gains of its position loop, where the file holds one of each per joint."""
    found = {n: tensors[n].reshape(-1) for n in _GAINS if n in tensors and tensors[n].size == joints}
    sound = {n: values for n, values in found.items() if np.isfinite(values).all() and (values >= 0).all()}
    return {_joint(j): {n: float(values[j]) for n, values in sound.items()} for j in range(joints)} if sound else {}


def _joint(index: int) -> str:
    return f"joint_{index:02d}"


def mapping(recordings: Sequence[Recording]) -> dict[str, Any]:
    """PACE .pt files: joint positions and their targets, in position control."""
    fields = [recording.streams[0].fields for recording in recordings]
    count = min(sum(name.startswith(f"{_POSITION}[") for name in each) for each in fields) if fields else 0
    if not count:
        raise ImportLogError("no recording of PACE among the files", fix="name .pt files with dof_pos and des_dof_pos")
    joints: dict[str, Any] = {}
    for index in range(count):
        channels = {_POSITION: ("position", "rad"), _COMMAND: ("position_command", "rad")}
        channels |= {n: kind for n, kind in _OPTIONAL.items() if all(f"{n}[{count - 1}]" in each for each in fields)}
        joints[_joint(index)] = {
            channel: {"field": f"{name}[{index}]", "unit": unit} for name, (channel, unit) in channels.items()
        }
    return {
        "format": "hqpipe-log-map/1",
        "control_mode": "position",
        "clock": {"field": _TIME, "unit": "s"},
        "joints": joints,
    }
