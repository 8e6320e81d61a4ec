"""One joint with a position loop: its samples, its parameters, and the error of a prediction."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from hqpipe.identify.model import Effect, Implied, Parameter, Ratio, Samples, all_parameters
from hqpipe.layers.actuator import link, spool_hysteresis, sudden_change
from hqpipe.layers.actuator.driven_signals import DrivenSignals, Shares
from hqpipe.layers.actuator.parameters import (
    BASE_NAMES,
    BY_OPENING,
    LOGGED_SPEED,
    OF_FRICTION,
    SPEED_LATE,
    reported_unit,
)
from hqpipe.layers.actuator.record import Record
from hqpipe.layers.actuator.repeated_run import RepeatedRun
from hqpipe.layers.actuator.start_noise import StartNoise
from hqpipe.machine import EFFECTS
from hqpipe.machine.chain import Signals, residual_windows
from hqpipe.machine.direction_asymmetry import ALIKE_WITHIN, LEAST_UNEQUAL
from hqpipe.machine.layout import BASE, slot
from hqpipe.machine.moment_arm import PARAMETERS as ARM
from hqpipe.machine.moment_arm import relative_arm
from hqpipe.machine.transmission_compliance import EFFECT as LINK
from hqpipe.machine.viscous_friction import MOST_BEHIND

_LOGGED, _SPEED_LATE = BASE_NAMES.index(LOGGED_SPEED), BASE_NAMES.index(SPEED_LATE)
_PRESLIDING = [BASE_NAMES.index(p.name) for _, p in OF_FRICTION]
_ARM = [BASE_NAMES.index(name) for name in ARM]
_LEAK = BASE.index("k2")
_BASE = [slot("base", name) for name in BASE]
_TURN, _LATE = [slot(owner, p.name) for owner, p in OF_FRICTION], slot("setting", "speed_late")
_ARM_SLOTS = [slot("setting", name) for name in ARM]
_STEP, _MIDDLE = slot("setting", "sample_time"), slot("setting", "middle")
_ORIFICE, _AREAS = ("orifice_flow", "effort_max_nm"), ("direction_asymmetry", "areas")
_OFFSET, _ZERO = ("torque_bias", "nm"), ("position_bias", "rad")
_RATIO, _STRAYED = ("direction_asymmetry", "ratio"), ("position_dependent_stiffness", "strayed")
_AREAS_SLOT, _STRAYED_SLOT = slot(*_AREAS), slot(*_STRAYED)
_FLOW = [slot("setting", "flow_per_speed"), slot("setting", "flow_per_opening")]
SOUND_OFFSET = 0.01
"""Of the largest torque that the orifice lets a joint give, its sensor's full scale, that a sound sensor may be off by: data
sheets of load cells and pressure sensors say so of their zero. Sides of a piston cut to the tolerance H9 (ISO 286-2) do a
sixth of that. The cost: a smaller offset has no name, and only a remark tells of it."""
MOST_OFFSET = 10.0 * SOUND_OFFSET
"""The same of a sensor that is wrong; assumption. Unequal areas of the piston do to the torque what a larger offset would."""
NOTABLE_ARM = 0.05
"""Of the largest moment arm: a remark tells in steps of this how far the least one is below it; assumption."""
_PLACES = 41  # of the positions, over which the arm is looked at
LATE = 0.5  # rows by which the mean speed of a step belongs later than the row where it begins


@dataclass(frozen=True, eq=False)
class ActuatorJoint:
    """A `hqpipe.identify.model.JointModel`.

    Attributes:
        joint, unit, dt, base, effects, fit, heldout, noise, notes, misfit_noise: see there.
        places: owner and name of each parameter of the effects of the loops. records, starts: of the fit and the held-out
            trials.
        neutral: (WIDTH,) a row of the loops without effects, settings filled in. shapes: (C, N) of each, see `shapes`.
        shape_scale: (C,) what they were divided by. stepped: (T,) times of both records that step where the gain may change
            suddenly; None without shapes. ratios: what may have changed since an earlier record, see there.
        draws: rad/s of flow per speed and per position error of this joint. units: of its effort and position.
        unsigned: whether its torque had lost its sign, which was restored. implies: effects that its numbers may imply.
        vibration_shows: effect that a vibration shows in what the law leaves; empty where there may be other reasons.
        is_limited: whether the link between piston and joint is no softer than a rod or a chain.
    """

    joint: str
    unit: str
    dt: float
    base: tuple[Parameter, ...]
    effects: tuple[Effect, ...]
    fit: Samples
    heldout: Samples
    noise: tuple[float, float]
    misfit_noise: tuple[float, float]
    notes: tuple[str, ...]
    places: tuple[tuple[str, str], ...]
    records: tuple[Record, Record]
    starts: tuple[StartNoise, StartNoise]
    neutral: np.ndarray
    shapes: tuple[np.ndarray, np.ndarray]
    shape_scale: np.ndarray
    stepped: tuple[np.ndarray, np.ndarray] | None
    ratios: Mapping[str, Ratio]
    draws: tuple[float, float]
    units: tuple[str, str]
    unsigned: bool = False
    implies: tuple[str, ...] = ()
    vibration_shows: str = ""
    is_limited: bool = False

    _columns: np.ndarray = field(init=False)
    _owned: np.ndarray = field(init=False)
    _with_column: np.ndarray = field(init=False)
    _slots: np.ndarray = field(init=False)
    _opening: int = field(init=False)
    _load: float = field(init=False)
    _run: RepeatedRun = field(init=False)
    _friction: np.ndarray = field(init=False)
    _orifice: tuple[int, float] | None = field(init=False)
    _areas: int | None = field(init=False)
    _of_directions: tuple[int, int] | None = field(init=False)
    _offset: int | None = field(init=False)
    _zero: int | None = field(init=False)
    _neutral: np.ndarray = field(init=False)
    _first_shape: int = field(init=False)
    _change: int | None = field(init=False)
    _play: int | None = field(init=False)
    _timed: np.ndarray = field(init=False)
    _driven: DrivenSignals = field(init=False)
    _share: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        owned = [(owner, name) for owner, name in self.places if name != BY_OPENING]
        object.__setattr__(self, "_columns", np.array([slot(owner, name) for owner, name in owned], dtype=np.int64))
        names = [name for _, name in self.places]
        at = len(self.base) + names.index(BY_OPENING) if BY_OPENING in names else -1
        object.__setattr__(self, "_opening", at)
        own = len(self.base) + np.arange(len(self.places))
        object.__setattr__(self, "_owned", own[own != at])
        object.__setattr__(self, "_load", link.load_at_reversals(self.fit))
        object.__setattr__(self, "_run", RepeatedRun())
        object.__setattr__(self, "_driven", DrivenSignals(self.records[0]))
        friction = [k for k, (owner, _) in enumerate(self.places) if EFFECTS[owner].effort_sources]
        object.__setattr__(self, "_friction", len(self.base) + np.array(friction, dtype=np.int64))
        object.__setattr__(self, "_orifice", self._place_of_orifice())
        directions = [len(self.base) + self.places.index(place) for place in (_RATIO, _STRAYED) if place in self.places]
        object.__setattr__(self, "_of_directions", tuple(directions) if len(directions) == 2 else None)
        for attribute, place in (("_areas", _AREAS), ("_offset", _OFFSET), ("_zero", _ZERO)):
            at = len(self.base) + self.places.index(place) if place in self.places else None
            object.__setattr__(self, attribute, at)
        object.__setattr__(self, "_neutral", np.array([parameter.neutral for parameter in all_parameters(self)]))
        object.__setattr__(self, "_first_shape", len(self._neutral) - len(self.shape_scale))
        owners = [effect.name for effect in self.effects for _ in effect.parameters]
        for attribute, name in (("_change", sudden_change.NAME), ("_play", spool_hysteresis.NAME)):
            object.__setattr__(self, attribute, len(self.base) + owners.index(name) if name in owners else None)
        columns = self.columns
        object.__setattr__(self, "_with_column", np.flatnonzero(columns >= 0))
        object.__setattr__(self, "_slots", columns[self._with_column])
        timed = [k for k, (owner, _) in enumerate(self.places) if owner in sudden_change.TIMED]
        object.__setattr__(self, "_timed", len(self.base) + np.array(timed, dtype=np.int64))

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        """(N,) prediction less measured torque at the samples of `fit` or `heldout`, N·m or N.

        Args:
            values: (P,) base parameters, then those of all effects in their order.
        """
        record = self.records[heldout]
        if not record.windows:
            return np.zeros(0)
        if heldout:
            errors = residual_windows(*self._read(values, record.driven_by(*self._shares(values)), heldout))
        else:
            row, driven = self._read(values, self._driven.by(self._shares(values)))
            errors = self._run.errors(row, driven, self._driven.versions_inside(*self._inside(values)))
        found = record.picked(errors)
        for shape, size in enumerate(values[self._first_shape :].tolist()):
            if size:
                found += size * self.shapes[heldout][shape]
        return found

    def misfit(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        """(N,) error without the noise of the torque at the start of each window, see there."""
        error, start, leak = self.error(values, heldout), self.starts[heldout], float(values[_LEAK])
        share = start.share(error, leak)
        if not heldout:
            object.__setattr__(self, "_share", share)
        return start.removed_from(error, leak, share)

    def _read(self, values: np.ndarray, signals: Signals, heldout: bool = False) -> tuple[np.ndarray, Signals]:
        """The row and the signals that the loops read: those of the machine, but for shapes that act inside the law."""
        row, (change, half_play) = self.row(values), self._inside(values)
        if change and self.stepped:
            row[sudden_change.SLOT] = change
            signals = signals._replace(time=self.stepped[heldout])
        if half_play:
            signals = signals._replace(command=spool_hysteresis.command_behind(signals, half_play))
        return row, signals

    def _inside(self, values: np.ndarray) -> tuple[float, float]:
        """Numbers of the shapes that act inside the law: a sudden change of the gain, which does nothing beside what changes in
        time, and half of a spool's play."""
        change = 0.0 if self._change is None else float(values[self._change])
        if change and np.any(values[self._timed]):
            change = 0.0
        return change, 0.0 if self._play is None else float(values[self._play])

    def _place_of_orifice(self) -> tuple[int, float] | None:
        """Place of the inverse of the orifice's largest torque, and the least value from which it bends the flow.

        The torque at which the pressures of both chambers are equal is the areas' difference times the largest torque. Where
        the root bends nothing, or the areas differ by less than a rod makes them, that torque could be anything, and would
        stand for the offset of a sensor.
        """
        if _ORIFICE not in self.places:
            return None
        first = len(self.base) + self.places.index(_ORIFICE)
        return first, all_parameters(self)[first].least

    @property
    def columns(self) -> np.ndarray:
        """(P,) column of the loops' row, see `hqpipe.machine.layout`, that holds each parameter; −1 for what is the log's alone
        or has no column of its own."""
        found = np.full(len(self._neutral), -1, dtype=np.int64)
        found[: len(BASE)] = _BASE
        found[_PRESLIDING], found[_ARM] = _TURN, _ARM_SLOTS
        found[self._owned] = self._columns
        return found

    @cached_property
    def per_row(self) -> int:
        """Samples of the controller from one row of the log to the next."""
        return round(self.dt / self.neutral[_STEP])

    def moving(self, values: np.ndarray) -> tuple[float, ...]:
        """Shares of the motion of command and position between rows that the controller sees; none where it is no faster."""
        return tuple(values[len(BASE_NAMES) : len(self.base)].tolist())

    def idle(self, values: np.ndarray) -> tuple[int, ...]:
        """Places of parameters that change nothing at these values: how friction turns round, where there is none, areas
        that do not act, a mean pressure that has strayed beside directions of unequal gain, and a sudden change beside what
        changes in time, as an earlier record may have it."""
        present = np.any(values[self._friction] != self._neutral[self._friction])
        turning = () if present else (_SPEED_LATE, *_PRESLIDING)
        areas = (self._areas,) if self._is_even(values) else ()
        strayed = (self._of_directions[1],) if self._has_ratio(values) else ()
        sudden = (self._change,) if self._change is not None and np.any(values[self._timed]) else ()
        return (*turning, *areas, *strayed, *sudden)

    def _has_ratio(self, values: np.ndarray) -> bool:
        """Whether the gains of both directions have a ratio, which is all that a strayed mean pressure would say of them: of
        two numbers that only their sum shows, neither could be told from none."""
        return self._of_directions is not None and values[self._of_directions[0]] != 0.0

    def _is_even(self, values: np.ndarray) -> bool:
        """Whether there are areas of an orifice that bends nothing, that differ by less than those of any rod, or that stand
        beside an offset of the torque: only the sum of the two shows (see `same_by_law`), so that one would undo the other."""
        if self._areas is None:
            return False
        alone = self._offset is None or values[self._offset] == 0.0
        return not alone or self._is_straight(values) or abs(values[self._areas]) < LEAST_UNEQUAL

    def _is_straight(self, values: np.ndarray) -> bool:
        """Whether the orifice bends nothing."""
        return self._orifice is None or bool(values[self._orifice[0]] < self._orifice[1])

    def beyond(self, values: np.ndarray) -> tuple[str, ...]:
        """An offset too large for a torque sensor that measures all that the orifice lets the joint give."""
        too_large = not self._is_straight(values) and self._share_of_offset(values) > MOST_OFFSET
        return (_OFFSET[0],) if too_large else ()

    def sound_sizes(self, values: np.ndarray) -> Mapping[str, float]:
        """N·m of an offset of the torque, where the orifice tells the largest torque, see `SOUND_OFFSET`."""
        if self._offset is None or self._is_straight(values):
            return {}
        return {_OFFSET[0]: SOUND_OFFSET / float(values[self._orifice[0]])}

    def remarks(self, effects: Collection[str], values: np.ndarray) -> tuple[str, ...]:
        """By about how much the moment arm changes over the positions of the fit trials, if by a step of `NOTABLE_ARM`, and
        that a sensor is off by no more than a sound one may be.

        Args:
            effects: the causes. values: (P,) as in `error`.
        """
        found = []
        places = np.quantile(self.fit.position, np.linspace(0.0, 1.0, _PLACES))
        slope, curve = values[_ARM]
        arm = np.array([relative_arm(place, self.neutral[_MIDDLE], slope, curve) for place in places])
        change = round((1.0 - arm.min() / arm.max()) / NOTABLE_ARM) * NOTABLE_ARM  # so that like joints share a remark
        if change != 0.0:
            told = f"its moment arm changes by about {100.0 * change:.0f} % over the logged positions"
            found.append(f"{told}, which a simulator with one arm does not show")
        offset = 0.0 if self._is_straight(values) else self._share_of_offset(values)
        if _OFFSET[0] not in effects and 0.0 < offset < SOUND_OFFSET:
            told = "its logged effort has an offset, which is no cause"
            found.append(f"{told}: a sound sensor may be off by {100.0 * SOUND_OFFSET:.0f} % of the largest effort")
        return tuple(found)

    def same_by_law(self, values: np.ndarray) -> Mapping[str, tuple[str, ...]]:
        """The areas of a piston that do what an offset of the torque sensor does, see `hqpipe.machine.direction_asymmetry`."""
        if self._areas is None or self._is_straight(values) or not self._share_of_offset(values):
            return {}
        return {_OFFSET[0]: (_AREAS[0],)}

    def tolerances(self, values: np.ndarray) -> np.ndarray:
        """(N, K) what sides that are meant to be alike do to the misfit, if they differ by the deviation of `ALIKE_WITHIN`:
        beside an offset of the position, which would take it up, where the orifice bends the flow. Beside an offset of the
        torque it is the same number, see `same_by_law`.

        Args:
            values: (P,) as in `error`.
        """
        if self._zero is None or values[self._zero] == 0.0 or self._is_straight(values) or not self._is_even(values):
            return np.zeros((len(self.fit.time), 0))
        record = self.records[0]
        even, signals = self._read(values, record.driven_by(*self._shares(values)))
        uneven = even.copy()
        uneven[_AREAS_SLOT] = ALIKE_WITHIN / np.sqrt(3.0)  # deviation of a number that is anywhere within
        change = record.picked(residual_windows(uneven, signals)) - record.picked(residual_windows(even, signals))
        start, leak = self.starts[0], float(values[_LEAK])
        share = start.share(self.error(values), leak)
        return start.removed_from(change, leak, share)[:, None]

    def _share_of_offset(self, values: np.ndarray) -> float:
        """The offset of the torque sensor over the largest torque that the orifice lets the joint give."""
        return 0.0 if self._offset is None else abs(float(values[self._offset] * values[self._orifice[0]]))

    def sensitivity(self, values: np.ndarray, index: int) -> np.ndarray | None:
        """(N,) of the misfit by the size of a shape in which the error is linear; None of any other parameter."""
        shape = index - self._first_shape
        if shape < 0:
            return None
        return self.starts[0].removed_from(self.shapes[0][shape], float(values[_LEAK]), self._share)

    def row(self, values: np.ndarray) -> np.ndarray:
        """(WIDTH,) what the loops read, see `hqpipe.machine.layout`."""
        row, opening = self.neutral.copy(), self._by_opening(values)
        row[self._slots] = values[self._with_column]
        row[_LATE] = self.per_row * (LATE * (1.0 - values[_LOGGED]) + values[_SPEED_LATE])
        row[_FLOW] = (1.0 - opening) * self.draws[0], opening * self.draws[1]
        if self._is_even(values):
            row[_AREAS_SLOT] = 0.0
        if self._has_ratio(values):
            row[_STRAYED_SLOT] = 0.0
        if self.is_limited:
            link.stiffen(row, self._load)
        return row

    def implied(self, values: np.ndarray) -> tuple[Implied, ...]:
        """How soft the link between piston and joint is; nothing without friction. One that gave way as much as oil and link
        together is none: then friction turns round in its own way.

        Args:
            values: (P,) as in `error`.
        """
        found = link.compliance(self.row(values), self._load) if LINK.name in self.implies else None
        if found is None:
            return ()
        (number,), (compliance, share) = LINK.parameters, found
        beyond, most = np.log(share / MOST_BEHIND), -np.log(MOST_BEHIND)
        return (Implied(LINK.name, number.name, number.unit, compliance, float(beyond), float(most)),)

    def limited(self) -> ActuatorJoint:
        """The joint with a link that is no softer than a rod or a chain."""
        return replace(self, is_limited=True)

    def values_of(self, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(P,) numbers of a row of the loops, and (P,) whether it says them; NaN in a row stands for what is not known.

        A row does not say how much of the logged speed it was driven with, as a simulator has only one speed, and no rows that
        are further apart than its steps.
        """
        parameters = all_parameters(self)
        values = np.array([parameter.neutral for parameter in parameters], dtype=np.float64)
        known = np.ones(len(values), dtype=bool)
        known[[_LOGGED, _SPEED_LATE, *_PRESLIDING, *_ARM, *range(len(BASE_NAMES), len(self.base))]] = False
        values[: len(BASE)] = row[_BASE]
        values[_ARM] = np.nan_to_num(row[_ARM_SLOTS])
        values[_PRESLIDING] = np.where(np.isfinite(row[_TURN]), row[_TURN], values[_PRESLIDING])
        values[self._owned] = row[self._columns]
        if self._opening >= 0:
            values[self._opening] = float(np.nan_to_num(row[_FLOW[1]]) != 0.0)
        return np.clip(values, [p.low for p in parameters], [p.high for p in parameters]), known

    def referred_to(self, values: np.ndarray, other: ActuatorJoint) -> np.ndarray:
        """The same joint as the model of another record counts it: its shapes have a mean square of their own."""
        found = values.copy()
        found[self._first_shape :] *= other.shape_scale / self.shape_scale
        return found

    def reported(self, effect: str, name: str, value: float) -> tuple[str, float, str]:
        """Name, value and unit of a number in the form of diagnosis.json."""
        own = EFFECTS[effect].parameters if effect in EFFECTS else ()
        parameter = next((p for p in own if p.name == name), None)
        if parameter is None:  # a share, or a ratio to an earlier record
            return name, value, "1"
        unit = reported_unit(parameter.unit, self.units)
        return name, parameter.told(value), unit

    def _shares(self, values: np.ndarray) -> Shares:
        """Of the logged speed, of the flow by openings, and of the motion between rows that the controller sees."""
        return float(values[_LOGGED]), self._by_opening(values), self.moving(values)

    def _by_opening(self, values: np.ndarray) -> float:
        return float(values[self._opening]) if self._opening >= 0 else 0.0
