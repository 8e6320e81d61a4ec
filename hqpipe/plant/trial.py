"""A recorded run of the plant: columns of the log format hqpipe-log/1, and the truth kept apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MEASURED = ("position", "velocity", "effort", "pressure_a", "pressure_b")
TRUE_JOINT_SIGNALS = (
    "position",
    "velocity",
    "torque",
    "tension_a",
    "tension_b",
    "pressure_a",
    "pressure_b",
    "spool",
    "chain",
)
TRUE_SUPPLY_SIGNALS = ("supply/pressure", "supply/drawn", "energy/pump", "energy/relief")
XYZ = ("x", "y", "z")
ORIENTATION = tuple(f"base/orientation/{axis}" for axis in (*XYZ, "w"))
BASE_COLUMNS = (
    *(f"base/position/{axis}" for axis in XYZ),
    *ORIENTATION,
    *(f"base/linear_velocity/{axis}" for axis in XYZ),
    *(f"base/angular_velocity/{axis}" for axis in XYZ),
    *(f"imu/linear_acceleration/{axis}" for axis in XYZ),
)
COMMANDS = ("vx", "vy", "wz")


@dataclass(frozen=True)
class PlantTrial:
    """One run.

    Attributes:
        columns: log column → (T,) float64, what the machine's own sensors and loggers say.
        truth: column → (T,) float64 that no sensor sees; joint/<name>/chain in m at the pitch radius,
            base/orientation/* without the error of the attitude filter, supply/drawn in m³ and energy/* in J since the start.
        control_mode: "position", "torque" or "valve".
        effort_source: "pressure" or "load_cell".
        base: "floating" or "fixed".
        rate_hz: of the columns.
        fell: whether the robot fell, which ends the run unless it was told to go on.
        fall_time: s, None when it did not.
    """

    columns: dict[str, np.ndarray]
    truth: dict[str, np.ndarray]
    control_mode: str
    effort_source: str
    base: str
    rate_hz: float
    fell: bool
    fall_time: float | None

    @property
    def time(self) -> np.ndarray:
        """(T,) s."""
        return self.columns["time"]

    def joint(self, signal: str, joints: tuple[str, ...]) -> np.ndarray:
        """(T, J) of one logged joint signal."""
        return np.stack([self.columns[f"joint/{name}/{signal}"] for name in joints], axis=1)


def log_columns(
    joints: tuple[str, ...], feet: tuple[str, ...], mode: str, with_position: bool, floating: bool
) -> list[str]:
    """Names of the logged columns in the order of `Recorder.add`."""
    sent = ["valve_command"] + ["position_command"] * with_position + ["effort_command"] * (mode == "torque")
    names = ["time", *(f"joint/{joint}/{signal}" for signal in (*sent, *MEASURED) for joint in joints)]
    names += ["supply/pressure", "supply/oil_temperature"]
    if floating:
        names += [*BASE_COLUMNS, *(f"foot/{foot}/contact" for foot in feet)]
        names += [f"foot/{foot}/force/{axis}" for foot in feet for axis in XYZ]
        names += [f"command/{name}" for name in COMMANDS]
    return names


def truth_columns(joints: tuple[str, ...]) -> list[str]:
    """Names of the truth columns in the order of `Recorder.add`."""
    return [
        *(f"joint/{joint}/{signal}" for signal in TRUE_JOINT_SIGNALS for joint in joints),
        *ORIENTATION,
        *TRUE_SUPPLY_SIGNALS,
    ]


class Recorder:
    """Two preallocated tables that grow by one row a tick."""

    def __init__(self, log_names: list[str], truth_names: list[str], length: int) -> None:
        self._names, self._truth_names = log_names, truth_names
        self._log = np.empty((length, len(log_names)))
        self._truth = np.empty((length, len(truth_names)))
        self.rows = 0

    def add(self, log: list[np.ndarray], truth: list[np.ndarray]) -> None:
        """Append one row, given as consecutive pieces of it."""
        np.concatenate(log, out=self._log[self.rows])
        np.concatenate(truth, out=self._truth[self.rows])
        self.rows += 1

    def columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Log and truth columns up to the last row."""
        log = {name: self._log[: self.rows, i].copy() for i, name in enumerate(self._names)}
        truth = {name: self._truth[: self.rows, i].copy() for i, name in enumerate(self._truth_names)}
        return log, truth
