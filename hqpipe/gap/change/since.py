"""An earlier record of the same machine, its logs or its actuator model, and what it says of each joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hqpipe.actuators.augmented import Augmented
from hqpipe.actuators.base import DT_TOLERANCE
from hqpipe.actuators.files import FILE, load_actuator
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.errors import UsageError
from hqpipe.gap.change.model_files import COEFFICIENTS, POWERS, Left, digest, left_of, variances
from hqpipe.identify.change import KnownJoint
from hqpipe.layers.actuator.joint import ActuatorJoint
from hqpipe.layers.actuator.parameters import OF_FRICTION
from hqpipe.logs.finer_clock import steps_per_row
from hqpipe.logs.trajectory import LogSet
from hqpipe.machine import EFFECTS
from hqpipe.machine.layout import BASE, NOT_KNOWN, neutral_row, slot, slots

LOGS, ACTUATOR = "logs", "actuator"
MODE = "position"  # in the others the coefficients are no physics that could be compared one by one
FAMILIAR = 1.25  # on the error that a record left on its own logs: other motion, other error; assumption


@dataclass(frozen=True, eq=False)
class EarlierModel:
    """An earlier actuator model of the machine.

    Attributes:
        path: as it is shown. sha256: of what is read of it. dt: sample time of the controller, s. joints: names.
        rows: joint → (WIDTH,), NaN for what the model does not say. sd: joint → column → standard deviation.
        left: joint → what it left on its own logs. warnings: what to know of it.
    """

    path: str
    sha256: str
    dt: float
    joints: tuple[str, ...]
    rows: dict[str, np.ndarray]
    sd: dict[str, dict[int, float]]
    left: dict[str, Left]
    warnings: tuple[str, ...] = ()

    def header(self) -> dict[str, str]:
        """As in diagnosis.json."""
        return {"path": self.path, "kind": ACTUATOR, "sha256": self.sha256}

    def fits(self, log_set: LogSet) -> None:
        """See `check_alike`."""
        check_alike(log_set, self.path, MODE, self.joints, self.dt)

    def beside(self, model: ActuatorJoint) -> tuple[ActuatorJoint, KnownJoint]:
        """A joint of new logs with the settings of the model, and what this says of its numbers."""
        row = self.rows[model.joint]
        model = replace(model, neutral=np.where(np.isnan(row), model.neutral, row))
        values, known = model.values_of(row)
        columns = self.sd.get(model.joint, {})
        sd = np.zeros(len(values))
        for k, name in enumerate(BASE):
            sd[k] = columns.get(slot("base", name), 0.0)
        return model, KnownJoint(values, known, sd)

    def familiar(self, joint: str, moves: float) -> float:
        """Mean squared error that the model may have on new logs without anything having changed.

        Args:
            moves: mean squared error of holding the output there.
        """
        left = self.left.get(joint, Left(0.0, None))
        return FAMILIAR * left.error * (moves / left.swing if left.swing else 1.0)


@dataclass(frozen=True, eq=False)
class EarlierLogs:
    """Earlier logs of the machine, of which the layer that answers makes its own record."""

    log_set: LogSet

    def header(self) -> dict[str, str]:
        """As in diagnosis.json."""
        return {"path": str(self.log_set.path), "kind": LOGS, "sha256": self.log_set.sha256}

    def fits(self, log_set: LogSet) -> None:
        """See `check_alike`."""
        then = self.log_set
        check_alike(log_set, str(then.path), then.control_mode, then.joints, sample_time(then), then.effort_source)

    def fits_layer(self, log_set: LogSet) -> None:
        """See `check_same_machine`."""
        then = self.log_set
        check_same_machine(log_set, str(then.path), then.control_mode, then.joints, then.effort_source)


def check_alike(
    log_set: LogSet, path: str, mode: str | None, joints: Sequence[str], dt: float, source: str | None = None
) -> None:
    """Refuse logs that are not of the machine of a reference, or were not made alike.

    Args:
        path, mode, joints, dt, source: of the reference; dt as of `sample_time`; source of its torque, None if it is not known.

    Raises:
        UsageError: names both sides and the fix.
    """
    if log_set.control_mode != MODE:
        raise UsageError(
            f"{log_set.path}: control mode {log_set.control_mode or 'not given'}; what changed since a reference can be asked "
            f"of the actuator layer in {MODE} mode only",
            file=log_set.path,
            field="control_mode",
            fix="diagnose such logs without --reference",
        )
    check_same_machine(log_set, path, mode, joints, source)
    now = sample_time(log_set)
    if abs(now / dt - 1.0) > DT_TOLERANCE:
        raise UsageError(
            f"{log_set.path} and the reference {path}: sample times {now:.6g} s and {dt:.6g} s, and coefficients are per "
            "sample",
            file=path,
            field="dt",
            fix="give a reference of the same rate",
        )


def check_same_machine(
    log_set: LogSet, path: str, mode: str | None, joints: Sequence[str], source: str | None = None
) -> None:
    """Refuse logs of another machine than the reference, or with another command or torque sensor.

    Args:
        path, mode, joints, source: see `check_alike`.

    Raises:
        UsageError: names both sides and the fix.
    """
    pair = f"{log_set.path} and the reference {path}"
    if log_set.control_mode != mode:
        raise UsageError(
            f"{pair}: control modes {log_set.control_mode or 'not given'} and {mode or 'not given'}",
            file=path,
            field="control_mode",
            fix="give a reference of the same mode",
        )
    if lacking := [joint for joint in log_set.joints if joint not in joints]:
        raise UsageError(
            f"{pair}: joints {', '.join(log_set.joints)} and {', '.join(joints)}, without '{lacking[0]}'",
            file=path,
            field=lacking[0],
            fix="give a reference of the same machine",
        )
    if source and log_set.effort_source and source != log_set.effort_source:
        raise UsageError(
            f"{pair}: torques from {log_set.effort_source} and from {source}, which do not mean the same",
            file=path,
            field="effort_source",
            fix="give a reference with the same sensor",
        )


def sample_time(log_set: LogSet) -> float:
    """Of the controller, s: of logs that are slower, a part of the median over the trials."""
    dt = float(np.median([trial.trajectory.dt for trial in log_set.trials]))
    return dt / steps_per_row(dt)


def earlier_actuator(folder: Path, shown: str | None = None) -> EarlierModel:
    """The record that an actuator model of fit-actuator or diagnose is.

    Args:
        folder: with actuator.json. shown: the path as the answer says it.

    Raises:
        UsageError: the model has no coefficients that could be compared.
        ConfigError: actuator.json or a file beside it is broken.
    """
    model = load_actuator(folder)
    if not isinstance(model, Hydraulic | Augmented):
        raise UsageError(
            f"{folder / FILE}: a model of kind '{model.NAME}' has no coefficients to compare",
            file=folder / FILE,
            field="model",
            fix="give artifacts/actuator, artifacts/diagnosis or the logs that it was fitted to",
        )
    shown = shown or str(folder)
    fitted, left = variances(folder, model), left_of(folder, model)
    steps = 1 if isinstance(model, Augmented) else steps_per_row(model.dt)  # a diagnosis fits on the controller's clock
    rows = {}
    for j, joint in enumerate(model.joints):
        row = model.parameters[j].copy() if isinstance(model, Augmented) else _joint_space(model, j)
        row[slot("setting", "held")] = NOT_KNOWN  # other logs begin in their own way
        rows[joint], slopes = _per_step(row, steps)
        for column in fitted.get(joint, {}):
            fitted[joint][column] *= slopes[column] ** 2
    sd = {joint: {column: float(np.sqrt(v)) for column, v in found.items()} for joint, found in fitted.items()}
    warnings = []
    if not fitted:
        warnings.append(f"the reference {shown} has no intervals: its coefficients are taken as exact")
    if any(left.get(joint, Left(0.0, None)).swing is None for joint in model.joints):
        warnings.append(
            f"the reference {shown} does not say how much its own logs moved: in livelier ones an error that it always had may "
            "pass for a change"
        )
    return EarlierModel(shown, digest(folder), model.dt / steps, model.joints, rows, sd, left, tuple(warnings))


def _per_step(row: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """(WIDTH,) the row of a model whose samples are so many steps of the controller, and (WIDTH,) what a small change of each
    number becomes: gains are per sample, and what is left of a torque after one is that after all its steps."""
    found, slopes = row.copy(), np.ones(len(row))
    gains = [slot("base", name) for name in ("k1", "k3", "k4")] + [slot("setting", "sample_time")]
    found[gains], slopes[gains] = row[gains] / steps, 1.0 / steps
    leak = slot("base", "k2")
    left = 1.0 - row[leak]
    found[leak] = 1.0 - left ** (1.0 / steps)
    slopes[leak] = left ** (1.0 / steps - 1.0) / steps if left > 0.0 else 1.0
    return found, slopes


def _joint_space(model: Hydraulic, j: int) -> np.ndarray:
    """(WIDTH,) gains of a joint, effort limit and sample time; NaN where the model says nothing."""
    row = np.full_like(neutral_row(), np.nan)
    for name in EFFECTS:
        row[slots(name)] = neutral_row()[slots(name)]
    row[[slot(owner, p.name) for owner, p in OF_FRICTION]] = np.nan
    radius = model.column("sprocket_radius")[j]
    for name, power in zip(COEFFICIENTS, POWERS, strict=True):
        row[slot("base", name)] = model.column(name)[j] * radius**power
    row[slot("setting", "effort_limit")] = model.column("effort_limit")[j]
    row[slot("setting", "sample_time")] = model.dt
    row[slot("setting", "speed_late")] = 0.0
    return row
