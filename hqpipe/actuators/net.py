"""What neural actuator models have in common: tensors, their order in the compiled step, joints matched by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from hqpipe.actuators.base import ActuatorModel, ParameterField
from hqpipe.actuators.loops.net_step import CHANNELS, RING
from hqpipe.errors import UsageError, near_match

INPUTS = ("effort", "position_command", "position", "velocity")
SPREADS = ("input_spread", "output_spread")


def check_tensors(tensors: Mapping[str, np.ndarray], shapes: Mapping[str, tuple[int, ...]], where: str) -> None:
    """Refuse tensors other than those of `shapes`; `where` begins the message.

    Raises:
        UsageError: one is missing, unknown, of another shape, not finite, or a spread that is not positive.
    """
    for name in tensors:
        if name not in shapes:
            raise UsageError(f"{where}: unknown tensor '{name}'{near_match(name, shapes)}", field=name)
    for name, shape in shapes.items():
        if name not in tensors:
            raise UsageError(f"{where}: missing tensor '{name}' (needs {', '.join(shapes)})", field=name)
        value = tensors[name]
        if value.shape != shape or 0 in shape:
            raise UsageError(f"{where}: {name} has shape {value.shape}, expected {shape}", field=name)
        if not (np.abs(value) <= np.finfo(np.float32).max).all():
            raise UsageError(
                f"{where}: {name} holds numbers that are not finite in single precision",
                field=name,
                fix="train the net again",
            )
        if name in SPREADS and not (value > 0.0).all():
            raise UsageError(f"{where}: {name} holds {value.min()}, expected spreads above 0", field=name)


@dataclass(frozen=True, eq=False)
class NetActuator(ActuatorModel):
    """One net for the whole robot, (4 J · taps, H, J), or a net (4 · taps, H, 1) for each joint.

    See `hqpipe.actuators.loops.net_step`.

    A class states the rows of its first layer per hidden unit (`GATES`), the recurrent states per hidden unit (`STATES`)
    and whether it may look back at past inputs (`LOOKS_BACK`).

    Attributes:
        tensors: name → float64 array, read-only, as `shapes` says: matrices are (outputs, inputs), inputs stand tap by
            tap in the order of `INPUTS`, joint by joint. Mean and spread are those of the trials it was fitted to.
        per_joint: each joint has a net of its own, which reads that joint alone; every tensor has the joints in front.
        taps: how many samples ago the inputs are read, increasing from 0.
        delta: the output is the change of the torque in one sample instead of the torque, N·m.

    Raises:
        UsageError: a tensor is missing, unknown, of the wrong shape or not finite; or the taps are no such list.
    """

    DT_BOUND: ClassVar[bool] = True
    FIELDS: ClassVar[dict[str, ParameterField]] = {
        "effort_limit": ParameterField("N·m", lower=1e-9, may_be_infinite=True, certain=True)
    }
    GATES: ClassVar[int] = 1
    STATES: ClassVar[int] = 0
    LOOKS_BACK: ClassVar[bool] = False
    KEYS: ClassVar[tuple[str, ...]] = ("net",)

    tensors: Mapping[str, np.ndarray] = field(default_factory=dict)
    taps: tuple[int, ...] = (0,)
    delta: bool = False
    per_joint: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "taps", tuple(int(tap) for tap in self.taps))
        self._check_taps()
        given = {name: np.array(value, dtype=np.float64) for name, value in self.tensors.items()}
        shapes = self.shapes(len(self.joints), self.hidden, len(self.taps), self.per_joint)
        check_tensors(given, shapes, self.NAME)
        tensors = {name: given[name] for name in shapes}
        for value in tensors.values():
            value.flags.writeable = False
        object.__setattr__(self, "tensors", tensors)

    def _check_taps(self) -> None:
        rising = all(a < b for a, b in zip(self.taps, self.taps[1:], strict=False))
        if not self.taps or self.taps[0] != 0 or not rising:
            raise UsageError(
                f"{self.NAME}: taps are {list(self.taps)}, expected samples that increase from 0", field="net.taps"
            )
        if len(self.taps) > 1 and not self.LOOKS_BACK:
            raise UsageError(
                f"{self.NAME}: taps are {list(self.taps)}, expected [0]: its memory is recurrent", field="net.taps"
            )

    @property
    def hidden(self) -> int:
        """H, units of the hidden layer of a net."""
        matrix = np.asarray(self.tensors.get("output_weight", np.empty(0)))
        return matrix.shape[-1] if matrix.ndim == 2 + self.per_joint else 0

    def mean(self, channel: str) -> np.ndarray:
        """(J,) mean of one of `INPUTS` over the fit trials."""
        mean, at = self.tensors["input_mean"], INPUTS.index(channel)
        return mean[:, at] if self.per_joint else mean.reshape(CHANNELS, -1)[at]

    @classmethod
    def shapes(cls, joints: int, hidden: int, taps: int = 1, per_joint: bool = False) -> dict[str, tuple[int, ...]]:
        """Name → shape of every tensor, for J joints, H hidden units and a number of taps."""
        outputs, front = (1, (joints,)) if per_joint else (joints, ())
        width, rows = CHANNELS * outputs, cls.GATES * hidden
        recurrent = {"recurrent_weight": (rows, hidden), "recurrent_bias": (rows,)} if cls.STATES else {}
        of_one_net = {
            "input_mean": (width,),
            "input_spread": (width,),
            "output_mean": (outputs,),
            "output_spread": (outputs,),
            "input_weight": (rows, width * taps),
            "input_bias": (rows,),
            **recurrent,
            "output_weight": (outputs, hidden),
            "output_bias": (outputs,),
        }
        return {name: front + shape for name, shape in of_one_net.items()}

    @classmethod
    def build(
        cls,
        joints: Sequence[str],
        *,
        dt: float | None = None,
        scope: str = "per_joint",
        tensors: Mapping[str, np.ndarray] | None = None,
        taps: Sequence[int] = (0,),
        delta: bool = False,
        per_joint: bool = False,
        **columns: float | Sequence[float] | np.ndarray,
    ) -> Self:
        """Make a model from its tensors and `effort_limit`, one number or (J,), N·m."""
        table = cls._table(joints, columns)
        return cls(tuple(joints), table, dt, scope, tensors or {}, tuple(taps), delta, per_joint)

    @property
    def memory_columns(self) -> int:
        """M: recurrent states spread over the joints of a net, or the number of samples seen and a ring of past inputs."""
        if self.STATES:
            return -(-self.STATES * self.hidden // (1 if self.per_joint else len(self.joints)))
        return RING + CHANNELS * (self.taps[-1] + 1) if self.taps[-1] else 0

    @cached_property
    def weights(self) -> np.ndarray:
        """(W,) float32 in the order of `hqpipe.actuators.loops.net_step`."""
        t = self.tensors if self.per_joint else {name: value[None] for name, value in self.tensors.items()}
        count = len(t["input_mean"])
        header = np.array((self.hidden, float(self.delta), len(self.taps), *self.taps), dtype=np.float64)
        parts = [np.tile(header, (count, 1)), t["input_mean"], 1.0 / t["input_spread"]]
        parts += [t["output_mean"], t["output_spread"], t["input_weight"].swapaxes(1, 2), t["input_bias"]]
        if self.STATES:
            parts += [t["recurrent_weight"].swapaxes(1, 2), t["recurrent_bias"]]
        parts += [t["output_weight"].swapaxes(1, 2), t["output_bias"]]
        of_nets = np.concatenate([part.reshape(count, -1) for part in parts], axis=1)
        flat = np.concatenate([[float(count)], of_nets.ravel()]).astype(np.float32)
        flat.flags.writeable = False
        return flat

    def for_joints(self, joints: Sequence[str]) -> Self:
        """The same model with its joints in another order; one net for all cannot do without one of them.

        Raises:
            UsageError: `joints` are not those of the net.
        """
        rows = np.array(self._rows(joints))
        if self.per_joint:
            own = {name: value[rows] for name, value in self.tensors.items()}
            return replace(self, joints=tuple(joints), parameters=self.parameters[rows], tensors=own)
        if missing := [name for name in self.joints if name not in joints]:
            raise UsageError(
                f"{self.NAME}: joint '{missing[0]}' is missing: the net reads all of {len(self.joints)} joints",
                field=missing[0],
                fix="give logs or a robot with all of them, or a model that was fitted without",
            )
        count = len(self.joints)
        wide = np.concatenate([rows + channel * count for channel in range(CHANNELS)])
        t = dict(self.tensors)
        for name in ("input_mean", "input_spread"):
            t[name] = t[name][wide]
        for name in ("output_mean", "output_spread", "output_weight", "output_bias"):
            t[name] = t[name][rows]
        columns = np.concatenate([wide + tap * CHANNELS * count for tap in range(len(self.taps))])
        t["input_weight"] = t["input_weight"][:, columns]
        return replace(self, joints=tuple(joints), parameters=self.parameters[rows], tensors=t)

    def to_dict(self) -> dict[str, Any]:
        """JSON-able form without the tensors."""
        net = {"inputs": list(INPUTS), "taps": list(self.taps), "hidden": self.hidden, "delta": self.delta}
        return super().to_dict() | {"net": net | {"per_joint": self.per_joint}}

    @classmethod
    def from_dict(cls, raw: Mapping[str, Any], tensors: Mapping[str, np.ndarray] | None = None) -> Self:
        """Inverse of `to_dict`, for a mapping that `hqpipe.actuators.files` has checked, and its tensors."""
        net = {key: raw["net"][key] for key in ("taps", "delta", "per_joint") if key in raw["net"]}
        net["tensors"] = tensors or {}
        return cls.build(raw["joints"], dt=raw["dt"], scope=raw["scope"], **net, **cls._columns_of(raw))
