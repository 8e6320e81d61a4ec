"""Inverse dynamics of one joint: the torque that its logged motion asks for, with any set of effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hqpipe.identify.model import Effect, Parameter, Samples
from hqpipe.layers.joint_motion.candidates import DIRECT, SHAPES
from hqpipe.layers.joint_motion.columns import Columns
from hqpipe.layers.joint_motion.coupling import Nuisance, Predicted
from hqpipe.layers.joint_motion.records import Part

if TYPE_CHECKING:
    from hqpipe.layers.joint_motion.two_records import TwoRecords


@dataclass(frozen=True, eq=False)
class MotionModel:
    """A `JointModel`. Torque = inertia·a + offset + gravity(q) + effects, low-passed; see docs/theory/joint-motion.md.

    Attributes:
        same: effect → others of the library that do the same in these logs, and are not among `effects`.
        unsigned: whether the log holds the size of the torque only; its sign was restored in `fit` and `heldout`.
        instrumental: whether the regressors are projected on instruments, because the noise of the loop biases them.
        parts: (fit, held-out) filtered samples; measured: the same without instruments. columns: what their columns are.
        nuisances: of both, what the other joints may do, which is taken out of the errors.
        load: gravity of a known load at a right angle, N·m, and its inertia, kg·m²; 0 where none is known.
        back: samples from the start of a window of persistence to its end.
        mean: of the position over the fit trials, from which gravity and springs count, rad or m.
    """

    joint: str
    unit: str
    dt: float
    base: tuple[Parameter, ...]
    effects: tuple[Effect, ...]
    same: Mapping[str, tuple[str, ...]]
    fit: Samples
    heldout: Samples
    noise: tuple[float, float]
    notes: tuple[str, ...]
    unsigned: bool
    instrumental: bool
    parts: tuple[Part, Part]
    measured: tuple[Part, Part]
    nuisances: tuple[Nuisance, Predicted]
    columns: Columns
    load: tuple[float, float]
    back: int
    mean: float

    @property
    def changes(self) -> dict[str, tuple[str, ...]]:
        """Cause → base parameters that change with it; where none bends over the position, a weight is a constant force."""
        names = [p.name for p in self.base]
        weight = [name for name in names if name.startswith("gravity")] or ["offset_nm"]
        return {"payload": tuple(name for name in ("inertia_kg_m2", *weight) if name in names)}

    @cached_property
    def _at(self) -> dict[tuple[str, str], int]:
        """(effect, parameter) → index into the values; no effect for the base."""
        names = [("", p.name) for p in self.base]
        names += [(effect.name, p.name) for effect in self.effects for p in effect.parameters]
        return {name: k for k, name in enumerate(names)}

    @cached_property
    def _kept(self) -> tuple[np.ndarray, ...]:
        """The joint's own columns of the samples that are judged."""
        return tuple(np.ascontiguousarray(part.columns[np.ix_(part.keep, self._used)]) for part in self.parts)

    @cached_property
    def _used(self) -> np.ndarray:
        """Indices of the columns that have coefficients: all but those of the other joints, which are taken out."""
        others = self.columns["coupling"]
        return np.array([k for group in self.columns.groups.values() for k in group if k not in others], dtype=np.int64)

    @cached_property
    def _table(self):
        """Logarithm of the Stribeck speed → weights of its table."""
        from scipy.interpolate import CubicSpline

        return CubicSpline(np.log(self.columns.speeds), np.eye(len(self.columns.speeds)))

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        """(N,) predicted less measured torque, without what other joints may do; see `JointModel`.

        Of a torque that is logged later by s, the value s later is compared: the motion of all joints stays where it is.
        """
        values = np.asarray(values, dtype=float)
        fit, predicted = self.nuisances
        if not heldout:
            return fit.left(self.own_error(values, False))
        fitted = self.own_error(values, False) if predicted.gains.size else np.zeros(0)
        return predicted.left(self.own_error(values, True), fitted)

    def own_error(self, values: np.ndarray, heldout: bool) -> np.ndarray:
        """(N,) predicted less measured torque, with what other joints do."""
        late = self._value(values, "", "timing_s") + self._value(values, "channel_skew", "skew_s")
        return self._predicted(values, heldout) - _advanced(self.parts[heldout], late / self.dt)

    def together(self, then: MotionModel) -> TwoRecords | None:
        """Both records with one machine around the joint; None where they do not have the same terms of other joints."""
        from hqpipe.layers.joint_motion.two_records import TwoRecords

        same = self.columns.coupling is not None and self.columns.coupling == then.columns.coupling
        return TwoRecords(then, self) if same and self.mean == then.mean else None

    def same_by_law(self, values: np.ndarray) -> Mapping[str, tuple[str, ...]]:
        """See `hqpipe.layers.joint_motion.distinct.Distinguished`."""
        return self.same

    def referred_to(self, values: np.ndarray, other: MotionModel) -> np.ndarray:
        """(P,) the same gravity and spring as they count from the mean position of another record."""
        shift = other.mean - self.mean
        moved = np.array(values, dtype=np.float64)
        offset = self._at["", "offset_nm"]
        sine, cosine, angle = (self._at.get(("", f"gravity_{name}")) for name in ("sin_nm", "cos_nm", "angle_rad"))
        if angle is not None:
            moved[angle] += shift
            moved[offset] += self.load[0] * (np.sin(moved[angle]) - np.sin(values[angle]))
        elif sine is not None:
            flat = values[cosine] if cosine is not None else 0.0
            moved[sine] = values[sine] * np.cos(shift) - flat * np.sin(shift)
            turned = values[sine] * np.sin(shift) + flat * np.cos(shift)
            moved[offset] += turned - flat
            if cosine is not None:
                moved[cosine] = turned
        moved[offset] += self._value(values, "spring", "nm_per_rad") * shift
        return moved

    def _predicted(self, values: np.ndarray, heldout: bool) -> np.ndarray:
        part = self.parts[heldout]
        torque = self._torque(values, self._kept[heldout])
        scale = 1.0 + self._value(values, "torque_scale", "ratio")
        drift = self._value(values, "torque_by_time", "rate_per_s")
        if drift != 0.0 or scale != 1.0:
            torque = torque * (scale * (1.0 + drift * part.time[part.keep]))
        return torque

    def _torque(self, values: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(N,) at samples with the columns `rows` of those that have coefficients."""
        indices, targets = self._linear
        found = np.zeros(self.parts[0].columns.shape[1])
        found[targets] = values[indices]
        if self.load[0]:
            angle = self._value(values, "", "gravity_angle_rad")
            found[list(self.columns["gravity"])] = self.load[0] * np.cos(angle), self.load[0] * np.sin(angle)
            found[self.columns.one("inertia")] += self.load[1]
        found[self.columns.one("speed")] += self._value(values, "viscous_friction", "nm_s_per_rad") * self._value(
            values, "direction_asymmetry", "ratio"
        )
        static = self._value(values, "stribeck_friction", "static_nm")
        if static != 0.0:
            speed = self._value(values, "stribeck_friction", "velocity_rad_s")
            found[list(self.columns["stribeck"])] = static * self._table(np.log(speed))
        return rows @ found[self._used]

    def _value(self, values: np.ndarray, effect: str, parameter: str) -> float:
        """Of a parameter that may not be there."""
        at = self._at.get((effect, parameter))
        return 0.0 if at is None else float(values[at])

    @cached_property
    def _linear(self) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the values that are coefficients, and of their columns."""
        gravity = self.columns["gravity"]
        places = {
            ("", "inertia_kg_m2"): self.columns.one("inertia"),
            ("", "offset_nm"): self.columns.one("offset"),
            ("armature", "kg_m2"): self.columns.one("inertia"),
        }
        places |= dict(zip((("", "gravity_sin_nm"), ("", "gravity_cos_nm")), gravity, strict=False))
        for effect, (parameter, _, group) in DIRECT.items():
            places[effect, parameter] = self.columns.one(group)
        for effect, (group, _) in SHAPES.items():
            places |= {(effect, f"coefficient_{i + 1}"): k for i, k in enumerate(self.columns[group])}
        found = [(at, places[name]) for name, at in self._at.items() if name in places]
        return np.array([at for at, _ in found], dtype=np.int64), np.array([k for _, k in found], dtype=np.int64)


def _advanced(part: Part, steps: float) -> np.ndarray:
    """(M,) the measured torque `steps` samples later, by cubic convolution (Keys 1981) within segments."""
    if steps == 0.0:
        return part.output[part.keep]
    whole = int(np.floor(steps))
    x = steps - whole  # the value lies x beyond `whole` samples ahead
    weights = (
        -0.5 * x**3 + x**2 - 0.5 * x,
        1.5 * x**3 - 2.5 * x**2 + 1.0,
        -1.5 * x**3 + 2.0 * x**2 + 0.5 * x,
        0.5 * x**3 - 0.5 * x**2,
    )
    first = np.searchsorted(part.segment, part.segment[part.keep])
    last = np.searchsorted(part.segment, part.segment[part.keep], side="right") - 1
    total = np.zeros(len(part.keep))
    for k, weight in enumerate(weights):
        total += weight * part.output[np.clip(part.keep + whole - 1 + k, first, last)]
    return total
