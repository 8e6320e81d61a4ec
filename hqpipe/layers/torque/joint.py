"""One joint with a force loop: its samples, its parameters, and the error of a prediction."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hqpipe.identify.model import Effect, Parameter, Samples
from hqpipe.layers.torque.kernel import LAYOUT, run_blocks
from hqpipe.layers.torque.record import Record
from hqpipe.layers.torque.windows import Windows

INVERSE = {"effort_max_nm": "inverse_effort_max", "stall_nm": "inverse_stall"}
_NEUTRAL = {"limit": np.inf, "recovery_s": 0.1, "drawn_ratio": 1.0, "area_ratio": 1.0, "others": 1.0}


@dataclass(frozen=True, eq=False)
class TorqueJoint:
    """A `hqpipe.identify.model.JointModel`.

    Attributes:
        joint, unit, dt, base, effects, fit, heldout, noise, notes: see there.
        settings: column of `kernel.LAYOUT` → number that no fit changes. records, windows: of the fit and the held-out trials.
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
    settings: dict[str, float]
    records: tuple[Record, Record]
    windows: tuple[Windows, Windows]
    _columns: tuple[tuple[int, str, float], ...] = field(init=False)

    def __post_init__(self) -> None:
        parameters = (*self.base, *(p for effect in self.effects for p in effect.parameters))
        columns = tuple((LAYOUT.index(INVERSE.get(p.name, p.name)), p.name, p.high) for p in parameters)
        object.__setattr__(self, "_columns", columns)

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        """(N,) prediction less measured effort at the samples of `fit` or `heldout`, N·m or N.

        Args:
            values: (P,) base parameters, then those of all effects in their order.
        """
        record, cut = self.records[heldout], self.windows[heldout]
        torque = np.zeros(len(record.effort))
        run_blocks(
            self.row(values),
            record.command,
            record.effort,
            record.signals,
            record.means[cut.stretch],
            cut.restart,
            cut.first,
            cut.last,
            cut.start,
            cut.stop,
            cut.substeps,
            torque,
        )
        return torque[cut.sample] - record.effort[cut.sample]

    def row(self, values: np.ndarray) -> np.ndarray:
        """(len(LAYOUT),) what the kernel reads."""
        row = np.array([_NEUTRAL.get(name, 0.0) for name in LAYOUT])
        for name, number in self.settings.items():
            row[LAYOUT.index(name)] = number
        for value, (column, name, high) in zip(np.asarray(values, dtype=np.float64), self._columns, strict=True):
            if name in INVERSE:  # an effort at its upper bound limits nothing
                row[column] = 0.0 if value >= high else 1.0 / value
            elif name == "limit":
                row[column] = np.inf if value >= high else value
            else:
                row[column] = value
        return row


def samples_of(record: Record, cut: Windows) -> Samples:
    """The samples that a joint is judged on."""
    at = cut.sample
    return Samples(
        files=record.files,
        trial=record.trial[at],
        time=record.time[at],
        position=record.position[at],
        velocity=record.velocity[at],
        output=record.effort[at],
        held=record.effort[cut.held],
    )
