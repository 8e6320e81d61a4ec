"""One valve-controlled joint of a log set: its samples, its parameters, and the error of a prediction."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.model import Effect, Parameter, Samples, all_parameters
from hqpipe.layers.valve.kernel import DT, LAYOUT, LONGEST, OWN_DEMAND, SCALE, run_blocks, travelled
from hqpipe.layers.valve.parameters import offset_before
from hqpipe.layers.valve.record import Record
from hqpipe.layers.valve.windows import Windows

INVERSE = {"effort_max_nm": "inverse_effort_max", "pressure_max_pa": "inverse_effort_max"}
WITHOUT_LIMIT = ("limit", "speed_limit", "upper_speed", "lower_speed")  # inert at the bound where no limit is left
_NEUTRAL = {
    "limit": np.inf,
    "speed_limit": np.inf,
    "upper_speed": np.inf,
    "lower_speed": np.inf,
    "recovery_s": 0.1,
    "damping_ratio": 0.4,
    "area_ratio": 1.0,
    "drawn_ratio": 1.0,
    "other_kinds": 1.0,
}


@dataclass(frozen=True, eq=False)
class ValveJoint:
    """A `hqpipe.identify.model.JointModel`.

    Attributes:
        joint, unit, dt, base, effects, fit, heldout, noise, notes: see there.
        travels: whether the position is predicted from the start of each window, not the velocity.
        settings: column of `kernel.LAYOUT` → number that no fit changes.
        records, windows: of the fit and the held-out trials.
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
    travels: bool
    settings: dict[int, float]
    records: tuple[Record, Record]
    windows: tuple[Windows, Windows]
    _columns: tuple[tuple[int, bool, float], ...] = field(init=False)

    def __post_init__(self) -> None:
        parameters = (*self.base, *(p for effect in self.effects for p in effect.parameters))
        columns = tuple(
            (LAYOUT.index(INVERSE.get(p.name, p.name)), p.name in INVERSE, _removed_at(p)) for p in parameters
        )
        object.__setattr__(self, "_columns", columns)

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        """(N,) prediction less measured position (or velocity) at the samples of `fit` or `heldout`, unit of the output.

        Args:
            values: (P,) base parameters, then those of all effects in their order.
        """
        record, cut = self.records[heldout], self.windows[heldout]
        velocity = self.velocity(values, heldout)
        if not self.travels:
            return velocity[cut.sample] - record.velocity[cut.sample]
        error = np.zeros(len(cut.sample))
        travelled(velocity, record.position, cut.begin, cut.begin_samples, cut.sample, cut.window, record.dt, error)
        return error

    def velocity(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        """(T,) predicted mean velocity from each sample to the next; 0 where nothing was simulated."""
        record, cut = self.records[heldout], self.windows[heldout]
        velocity = np.zeros(len(record.command))
        run_blocks(
            self.row(values),
            record.command,
            record.signals,
            cut.first,
            cut.last,
            cut.start,
            cut.kept,
            cut.stop,
            cut.substeps,
            velocity,
        )
        return velocity

    def remarks(self, effects: Collection[str], values: np.ndarray) -> tuple[str, ...]:
        """What the numbers of a fit say beside the parameters of its causes, one sentence each.

        Args:
            effects: the causes. values: (P,) as in `error`.
        """
        names = [parameter.name for parameter in all_parameters(self)]
        number = dict(zip(names, np.asarray(values, dtype=np.float64).tolist(), strict=True))
        found = []
        if "valve_deadband" in effects:
            edges = [number["neutral"] + side * number["half_width"] for side in (-1.0, 1.0)]
            found.append("motion sets in at the commands {:.3g} and {:.3g}: the edges of the deadband".format(*edges))
        if "direction_asymmetry" in effects and not self.records[0].effort_unit:
            found.append(
                "no load is logged, so that unequal piston areas and a constant load such as gravity look the same"
            )
        if "recovery_s" in number and "supply_droop" in effects and number["recovery_s"] < 0.5 * self.dt:
            found.append("the supply follows the flow within a sample, as a pump without an accumulator does")
        return tuple(found)

    def row(self, values: np.ndarray) -> np.ndarray:
        """(len(LAYOUT),) what the kernel reads."""
        row = np.array([_NEUTRAL.get(name, 0.0) for name in LAYOUT])
        row[DT] = self.dt
        for column, number in self.settings.items():
            row[column] = number
        for value, (column, inverse, removed) in zip(np.asarray(values, dtype=np.float64), self._columns, strict=True):
            if inverse:
                row[column] = 0.0 if value >= removed else 1.0 / value
            else:
                row[column] = np.inf if abs(value) >= removed else value
        return row


def _removed_at(parameter: Parameter) -> float:
    """The size from which on a limit is none at all; infinite for what is not a limit."""
    is_limit = parameter.name in WITHOUT_LIMIT or parameter.name in INVERSE
    return max(parameter.high, -parameter.low) if is_limit else np.inf


def of_one_log(models: Sequence[ValveJoint]) -> tuple[ValveJoint, ...]:
    """The joints of one log, whose commands stand in the same row: that of the joint that answers first bounds all."""
    if len(models) < 2:
        return tuple(models)
    first_s = min(_dead_time(model) for model in models)
    return tuple(
        replace(model, base=(*model.base[:-1], offset_before(model.base[-1], first_s, model.dt))) for model in models
    )


def _dead_time(model: ValveJoint) -> float:
    """s from the row of a command to the motion, of the straight line that fits best."""
    names = [parameter.name for parameter in all_parameters(model)]
    if "delay_s" not in names:
        return np.inf
    offset, delay = names.index("row_offset_s"), names.index("delay_s")
    fitter, free = Fitter(model), np.append(np.arange(len(model.base)), delay)
    starts = []
    for start_s in (0.0, *all_parameters(model)[delay].starts):
        start = fitter.neutral.copy()
        start[delay] = start_s
        starts.append(start)
    best = fitter.fit(free, starts, 0.0)
    return float(best.values[offset] + best.values[delay])


def settings_of(command: float, own_demand: float, longest_s: float) -> dict[int, float]:
    """What the kernel reads beside parameters.

    Args:
        command: largest distance from rest. own_demand: what the own speed counts in the flow that the supply gives.
        longest_s: of the trials.
    """
    return {SCALE: command, OWN_DEMAND: own_demand, LONGEST: longest_s}


def samples_of(record: Record, cut: Windows, travels: bool) -> Samples:
    """The samples that a joint is judged on."""
    at = cut.sample
    output = record.position if travels else record.velocity
    return Samples(
        files=record.files,
        trial=record.trial[at],
        time=record.time[at],
        position=record.position[at],
        velocity=record.velocity[at],
        output=output[at],
        held=output[cut.begin[cut.window]],
    )
