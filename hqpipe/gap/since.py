"""An earlier record of the same machine, its logs or its actuator model, and what it says of each joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from hqpipe.actuators.augmented import Augmented
from hqpipe.actuators.base import DT_TOLERANCE
from hqpipe.actuators.files import FILE, load_actuator
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.effects.layout import NOT_KNOWN, slot
from hqpipe.errors import UsageError
from hqpipe.gap.joint_data import LOGGED, JointData, Then
from hqpipe.gap.levels import Levels
from hqpipe.gap.model_files import COEFFICIENTS, POWERS, Left, digest, left_of, variances
from hqpipe.gap.two_fits import two_fits
from hqpipe.logs.trajectory import LogSet

LOGS, ACTUATOR = "logs", "actuator"
MODE = "position"  # in the others the coefficients are no physics that could be compared one by one


@dataclass(frozen=True, eq=False)
class Earlier:
    """An earlier record.

    Attributes:
        path: as it is shown. kind: `LOGS` or `ACTUATOR`. sha256: of what is read of it.
        mode: control mode. dt: sample time, s. joints: names. source: of the torque, where it is known.
        speed: the speed that its coefficients belong to, of `SPEEDS`; None if the record does not say.
        then: joint → what is known of it. bare: it knows coefficients alone; settings, and what two fits differ by, are then
            those of the new logs.
        window_s: of the free run that it was judged in; None for a model.
        unsigned: joints whose torque had lost its sign. checked: what a second sensor showed, (effect, joint).
        warnings: what to know of it. levels: see `hqpipe.gap.levels`; empty for a model.
    """

    path: str
    kind: str
    sha256: str
    mode: str
    dt: float
    joints: tuple[str, ...]
    speed: str | None
    then: dict[str, Then]
    source: str | None = None
    window_s: float | None = None
    unsigned: tuple[str, ...] = ()
    checked: frozenset[tuple[str, str]] = frozenset()
    warnings: tuple[str, ...] = ()
    bare: bool = False
    levels: Levels = field(default_factory=dict)

    def header(self) -> dict[str, str]:
        """As in diagnosis.json."""
        return {"path": self.path, "kind": self.kind, "sha256": self.sha256}

    def fits(self, log_set: LogSet) -> None:
        """See `check_alike`."""
        check_alike(log_set, self.path, self.mode, self.joints, self.dt, self.source)

    def beside(self, data: Sequence[JointData]) -> list[JointData]:
        """The joints of the new logs, each with what the record says of it."""
        if not self.bare:
            return [replace(d, then=self.then[d.joint], row=self.then[d.joint].row) for d in data]
        return [_beside_bare(d, self.then[d.joint]) for d in data]


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
        path, mode, joints, dt, source: of the reference; source of its torque, None if it is not known.

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
    """Median over the trials, s."""
    return float(np.median([trial.trajectory.dt for trial in log_set.trials]))


def _beside_bare(data: JointData, then: Then) -> JointData:
    """A joint beside coefficients alone: settings are those of the new logs, and so is what two fits differ by."""
    row = np.where(np.isnan(then.row), data.row, then.row)
    columns, covariance = two_fits(replace(data, row=row), then.effects)
    for column, variance in zip(then.columns, np.diag(then.covariance), strict=True):
        at = np.flatnonzero(columns == column)
        covariance[at, at] = np.maximum(covariance[at, at], variance)
    return replace(data, row=row, then=replace(then, row=row, columns=columns, covariance=covariance))


def earlier_actuator(folder: Path, shown: str | None = None) -> Earlier:
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
    effects = model.effects if isinstance(model, Augmented) else {}
    then = {}
    for j, joint in enumerate(model.joints):
        row = model.parameters[j].copy() if isinstance(model, Augmented) else _joint_space(model, j)
        row[slot("setting", "held")] = NOT_KNOWN  # other logs begin in their own way
        variance = fitted.get(joint, {})
        names = tuple(name for name, joints in effects.items() if joint in joints)
        columns = np.array(list(variance), dtype=np.int64)
        covariance = np.diag(np.array(list(variance.values()), dtype=np.float64))
        known = left.get(joint, Left(0.0, None))
        then[joint] = Then(row, columns, covariance, known.error, known.swing, effects=names)
    warnings = []
    if not fitted:
        warnings.append(f"the reference {shown} has no intervals: it is taken to be as sure as these logs are")
    if any(left.get(joint, Left(0.0, None)).swing is None for joint in model.joints):
        warnings.append(
            f"the reference {shown} does not say how much its own logs moved: in livelier ones an error that it always had may "
            "pass for a change"
        )
    speed = LOGGED if isinstance(model, Hydraulic) else None
    return Earlier(
        shown, ACTUATOR, digest(folder), MODE, model.dt, model.joints, speed, then, warnings=tuple(warnings), bare=True
    )


def _joint_space(model: Hydraulic, j: int) -> np.ndarray:
    """(WIDTH,) gains of a joint, effort limit and sample time; NaN where the model says nothing."""
    from hqpipe.effects import EFFECTS
    from hqpipe.effects.layout import neutral_row, slots

    row = np.full_like(neutral_row(), np.nan)
    for name in EFFECTS:
        row[slots(name)] = neutral_row()[slots(name)]
    row[slot("coulomb_friction", "presliding_rad")] = np.nan
    radius = model.column("sprocket_radius")[j]
    for name, power in zip(COEFFICIENTS, POWERS, strict=True):
        row[slot("base", name)] = model.column(name)[j] * radius**power
    row[slot("setting", "effort_limit")] = model.column("effort_limit")[j]
    row[slot("setting", "sample_time")] = model.dt
    row[slot("setting", "speed_late")] = 0.0
    return row
