"""What actuator models have in common: named joints, a parameter table, stepping by a compiled kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from hqpipe.actuators.loops.actuator_step import NO_WEIGHTS, step_batch
from hqpipe.errors import UsageError, near_match

FORMAT = "hqpipe-actuator/1"
DT_TOLERANCE = 0.02  # as hqpipe.logs.clocks: trials of one log set may differ by that much


@dataclass(frozen=True)
class ParameterField:
    """One column of a model's parameter table.

    Attributes:
        unit: SI unit for a revolute joint.
        lower, upper: closed physical bounds.
        may_be_infinite: infinity means "no limit" and is written as null.
        shared: one value for the whole machine, the same in every row.
        certain: known or set, not fitted: a randomisation leaves it as it is.
    """

    unit: str
    lower: float = 0.0
    upper: float = np.inf
    may_be_infinite: bool = False
    shared: bool = False
    certain: bool = False


@dataclass(frozen=True, eq=False)
class ActuatorModel:
    """Base of the models in `ACTUATOR_MODELS`.

    A class states its name, its kind in hqpipe.actuators.loops.actuator_step, the columns of its table (`FIELDS`), how many
    numbers a joint remembers besides its torque (`MEMORY`), whether the table belongs to one rate (`DT_BOUND`), and what
    actuator.json says of it beyond the table (`KEYS`).

    Attributes:
        joints: names, in the order of the rows of `parameters`.
        parameters: (J, P) float64, read-only; the columns are `FIELDS`.
        dt: sample time the parameters belong to, s; None if the model holds at any rate.
        scope: "per_joint" or "shared" – whether the parameters were determined joint by joint.

    Raises:
        UsageError: a joint is named twice, the table has the wrong shape or a value lies outside its bounds.
    """

    NAME: ClassVar[str]
    KIND: ClassVar[int]
    MEMORY: ClassVar[int] = 0
    FIELDS: ClassVar[dict[str, ParameterField]]
    DT_BOUND: ClassVar[bool] = False
    KEYS: ClassVar[tuple[str, ...]] = ()

    joints: tuple[str, ...]
    parameters: np.ndarray
    dt: float | None = None
    scope: str = field(default="per_joint")

    def __post_init__(self) -> None:
        table = np.array(self.parameters, dtype=np.float64)
        expected = (len(self.joints), len(self.FIELDS))
        if table.shape != expected:
            raise UsageError(
                f"{self.NAME}: expected parameters of shape {expected}, got {table.shape}", field="parameters"
            )
        if len(set(self.joints)) != len(self.joints) or not self.joints:
            names = ", ".join(self.joints) or "none"
            raise UsageError(f"{self.NAME}: expected distinct joint names, got {names}", field="joints")
        if self.scope not in ("per_joint", "shared"):
            raise UsageError(f"{self.NAME}: scope '{self.scope}', expected per_joint or shared", field="scope")
        self._check_values(table)
        if self.DT_BOUND and not (self.dt is not None and np.isfinite(self.dt) and self.dt > 0):
            raise UsageError(
                f"{self.NAME}: dt is {self.dt}, expected the sample time of the fit in seconds", field="dt"
            )
        table.flags.writeable = False
        object.__setattr__(self, "parameters", table)
        object.__setattr__(self, "joints", tuple(self.joints))

    def _check_values(self, table: np.ndarray) -> None:
        for column, (name, spec) in enumerate(self.FIELDS.items()):
            for joint, value in zip(self.joints, table[:, column], strict=True):
                finite = np.isfinite(value) or (spec.may_be_infinite and value == np.inf)
                if not finite or not spec.lower <= value <= spec.upper:
                    raise UsageError(
                        f"{self.NAME}: {name} of joint {joint} is {value}, "
                        f"expected {spec.lower} … {spec.upper} {spec.unit}",
                        field=f"parameters.{name}",
                    )

    @classmethod
    def build(
        cls,
        joints: Sequence[str],
        *,
        dt: float | None = None,
        scope: str = "per_joint",
        **columns: float | Sequence[float] | np.ndarray,
    ) -> Self:
        """Make a model from one number or one (J,) array per parameter.

        Raises:
            UsageError: a parameter is missing or unknown.
        """
        return cls(tuple(joints), cls._table(joints, columns), dt, scope)

    @classmethod
    def _table(cls, joints: Sequence[str], columns: Mapping[str, Any]) -> np.ndarray:
        """(J, P) from one number or one (J,) array per parameter."""
        for name in columns:
            if name not in cls.FIELDS:
                raise UsageError(f"{cls.NAME}: unknown parameter '{name}'{near_match(name, cls.FIELDS)}", field=name)
        if missing := [name for name in cls.FIELDS if name not in columns]:
            raise UsageError(
                f"{cls.NAME}: missing parameter{'s' * (len(missing) > 1)} {', '.join(repr(name) for name in missing)}",
                field=f"parameters.{missing[0]}",
                fix="if an older version wrote the file, run the same command again",
            )
        table = np.empty((len(joints), len(cls.FIELDS)))
        for column, name in enumerate(cls.FIELDS):
            table[:, column] = columns[name]
        return table

    @property
    def memory_columns(self) -> int:
        """M, how many numbers a joint remembers besides its torque."""
        return self.MEMORY

    @property
    def weights(self) -> np.ndarray:
        """(W,) float64 that all joints and robots share; empty unless the model is a net."""
        return NO_WEIGHTS

    def column(self, name: str) -> np.ndarray:
        """(J,) values of one parameter."""
        return self.parameters[:, list(self.FIELDS).index(name)]

    def _rows(self, joints: Sequence[str]) -> list[int]:
        for name in joints:
            if name not in self.joints:
                raise UsageError(
                    f"{self.NAME}: no joint '{name}'{near_match(name, self.joints)} (has {', '.join(self.joints)})",
                    field=name,
                    fix="take a model that was fitted to this machine",
                )
        return [self.joints.index(name) for name in joints]

    def for_joints(self, joints: Sequence[str]) -> Self:
        """The same model with its rows in the order of `joints`, matched by name.

        Raises:
            UsageError: a joint is not in the model.
        """
        rows = self._rows(joints)
        return replace(self, joints=tuple(joints), parameters=self.parameters[rows])

    def check_dt(self, dt: float) -> None:
        """Refuse a sample time other than the one that the parameters belong to.

        Raises:
            UsageError: the model is bound to its dt, and `dt` differs by more than 2 %.
        """
        if self.DT_BOUND and abs(dt / self.dt - 1.0) > DT_TOLERANCE:
            raise UsageError(
                f"{self.NAME}: its coefficients are per sample of {self.dt:.6g} s and cannot be stepped at {dt:.6g} s",
                field="dt",
                fix=f"step it every {self.dt:.6g} s, or fit it again on logs of {1.0 / dt:.6g} Hz",
            )

    def steps_per_row(self, dt: float) -> int:
        """How many samples of the model go into one of a log; dt: s, of the log.

        Raises:
            UsageError: it is no whole number, to 2 %.
        """
        if not self.DT_BOUND:
            return 1
        steps = max(1, round(dt / self.dt))
        if abs(dt / steps / self.dt - 1.0) > DT_TOLERANCE:
            self.check_dt(dt)
        return steps

    def fresh_memory(self, count: int) -> np.ndarray:
        """(N, J, M) memory of `count` robots that have just been reset: zeros, M = `memory_columns`."""
        return np.zeros((count, len(self.joints), self.memory_columns))

    def step(
        self, tau: np.ndarray, memory: np.ndarray, q_des: np.ndarray, q: np.ndarray, qd: np.ndarray, dt: float
    ) -> None:
        """Advance N robots by one sample, in place.

        Args:
            tau: (N, J) float64 torque, N·m; overwritten, and so is `memory`, (N, J, M) of `fresh_memory`.
            q_des, q, qd: (N, J) rad, rad, rad/s.
            dt: s.
        """
        self.check_dt(dt)
        self._advance(tau, memory, q_des, q, qd)

    def _advance(self, tau: np.ndarray, memory: np.ndarray, q_des: np.ndarray, q: np.ndarray, qd: np.ndarray) -> None:
        """`step` robot by robot; a model whose laws fit into vector instructions has a faster way."""
        step_batch(self.KIND, self.parameters, self.weights, tau, memory, q_des, q, qd)

    def to_dict(self) -> dict[str, Any]:
        """JSON-able form; `from_dict` restores the same bytes of every parameter."""
        parameters = {}
        for name, spec in self.FIELDS.items():
            values = [float(v) if np.isfinite(v) else None for v in self.column(name)]
            parameters[name] = {"unit": spec.unit, "values": values}
        return {
            "format": FORMAT,
            "model": self.NAME,
            "joints": list(self.joints),
            "dt": self.dt,
            "scope": self.scope,
            "parameters": parameters,
        }

    @classmethod
    def from_dict(cls, raw: Mapping[str, Any]) -> Self:
        """Inverse of `to_dict`, for a mapping that `hqpipe.actuators.files` has checked."""
        return cls.build(raw["joints"], dt=raw["dt"], scope=raw["scope"], **cls._columns_of(raw))

    @staticmethod
    def _columns_of(raw: Mapping[str, Any]) -> dict[str, list[float]]:
        """Parameter → (J,) values as `to_dict` writes them; null stands for "no limit"."""
        table = raw["parameters"].items()
        return {name: [np.inf if v is None else v for v in entry["values"]] for name, entry in table}


def end_to_end(*arrays: np.ndarray) -> list[np.ndarray]:
    """Views of (N, J) arrays as (N · J,); none where they do not lie in memory like that."""
    if all(a.flags.c_contiguous and a.dtype == np.float64 for a in arrays):
        return [a.reshape(-1) for a in arrays]
    return []
