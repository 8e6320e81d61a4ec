"""One joint with a position loop: its samples, its parameters, and the error of a prediction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.effects import EFFECTS
from hqpipe.effects.layout import slot
from hqpipe.identify.model import Effect, Parameter, Samples
from hqpipe.kernels.augmented_fit import residual_windows
from hqpipe.layers.actuator.parameters import BY_OPENING, LOGGED_SPEED, PRESLIDING, SPEED_LATE, reported_unit
from hqpipe.layers.actuator.record import Record

LATE = 0.5  # samples by which the mean speed of a step belongs later than the row where it begins


@dataclass(frozen=True, eq=False)
class ActuatorJoint:
    """A `hqpipe.identify.model.JointModel`.

    Attributes:
        joint, unit, dt, base, effects, fit, heldout, noise, notes: see there.
        places: owner and name of each parameter of the effects of the loops. records: of the fit and the held-out trials.
        neutral: (WIDTH,) a row of the loops without effects, settings filled in. shapes: (C, N) of each, see `shapes`.
        draws: rad/s of flow per speed and per position error of this joint. units: of its effort and position.
        unsigned: whether its torque had lost its sign, which was restored.
    """

    joint: str
    unit: str
    dt: float
    base: tuple[Parameter, ...]
    effects: tuple[Effect, ...]
    fit: Samples
    heldout: Samples
    noise: tuple[float, float]
    notes: tuple[str, ...]
    places: tuple[tuple[str, str], ...]
    records: tuple[Record, Record]
    neutral: np.ndarray
    shapes: tuple[np.ndarray, np.ndarray]
    draws: tuple[float, float]
    units: tuple[str, str]
    unsigned: bool = False

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        """(N,) prediction less measured torque at the samples of `fit` or `heldout`, N·m or N.

        Args:
            values: (P,) base parameters, then those of all effects in their order.
        """
        record = self.records[heldout]
        if not record.windows:
            return np.zeros(0)
        named = len(self.base) + len(self.places)
        numbers = self._numbers(values)
        share, opening = numbers[LOGGED_SPEED], numbers.get(BY_OPENING, 0.0)
        signals = record.signals
        if share != 0.0:
            signals = signals._replace(velocity=signals.velocity + share * (record.logged - signals.velocity))
        if opening != 0.0:
            signals = signals._replace(demand=record.by_speed + opening * (record.by_opening - record.by_speed))
        found = record.picked(residual_windows(self.row(values), signals))
        beside = values[named:]
        return found + beside @ self.shapes[heldout] if np.any(beside) else found

    def row(self, values: np.ndarray) -> np.ndarray:
        """(WIDTH,) what the loops read, see `hqpipe.effects.layout`."""
        row, numbers = self.neutral.copy(), self._numbers(values)
        for name in ("k1", "k2", "k3", "k4"):
            row[slot("base", name)] = numbers[name]
        row[slot("coulomb_friction", PRESLIDING)] = numbers[PRESLIDING]
        row[slot("setting", "speed_late")] = LATE * (1.0 - numbers[LOGGED_SPEED]) + numbers[SPEED_LATE]
        opening = numbers.get(BY_OPENING, 0.0)
        row[slot("setting", "flow_per_speed")] = (1.0 - opening) * self.draws[0]
        row[slot("setting", "flow_per_opening")] = opening * self.draws[1]
        for (owner, name), value in zip(self.places, values[len(self.base) :], strict=False):
            if name != BY_OPENING:
                row[slot(owner, name)] = value
        return row

    def reported(self, effect: str, name: str, value: float) -> tuple[str, float, str]:
        """Name, value and unit of a number in the form of diagnosis.json."""
        parameter = next((p for p in EFFECTS[effect].parameters if p.name == name), None)
        if parameter is None:  # a share
            return name, value, "1"
        unit = reported_unit(parameter.unit, self.units)
        if not parameter.inverse:
            return name, value, unit
        return name, 1.0 / value if value else np.inf, unit

    def _numbers(self, values: np.ndarray) -> dict[str, float]:
        """Parameters of the base, and the one of the effects that no column of the loops holds, by their names."""
        found = {p.name: float(value) for p, value in zip(self.base, values, strict=False)}
        for k, (_, name) in enumerate(self.places):
            if name == BY_OPENING:
                found[name] = float(values[len(self.base) + k])
        return found
