"""Fit a set of effects to one joint, together with the base model's own coefficients.

With an earlier record of the joint nothing but the set is fitted: all else is held at what it was then.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from hqpipe.effects import EFFECTS
from hqpipe.effects.layout import neutral_row, slot, slots
from hqpipe.gap.changes import FACTORS, MOST_RATIO, base_slots, in_order, leaders, multiplied, ratios
from hqpipe.gap.joint_data import JointData, Split
from hqpipe.kernels.augmented_fit import CHANGES, fit_windows, residual_windows

BASE_OF_MODE = {"position": ("k1", "k2", "k3", "k4"), "torque": ("k1", "k2", "k3")}
OUTLIER_SIGMAS = 6.0  # assumption: only gross errors (sensor glitches) lie beyond
OUTLIER_SHARE = 0.5  # of the output's RMS; keeps impacts from counting as outliers
SPANS = (1, 5, 20)  # samples of the differences that first guesses come from
FIRST_LOOK = 3  # iterations before a start is compared with its rivals
POORER = 1.01  # loss over that of a part of the set, from which it is fitted again; less is haste
SHY = 0.1  # of the size that an effect has by itself, where that made matters worse; assumption
ITERATIONS, TOLERANCE = 25, 1e-4
RATIO_SCALE = 0.1  # of a coefficient: the size of a step of its change
ALONE = np.full(1, -1)  # a column that nothing is tied to

Names = tuple[str, ...]


@dataclass(frozen=True, eq=False)
class SetFit:
    """A set of effects fitted to one joint.

    Attributes:
        effects: names, in the order of the chain.
        row: (WIDTH,) parameters.
        loss: Huber loss per sample in the fit trials.
        hessian: (n, n) Gauss-Newton matrix of the free columns, about where the row is.
        free: (n,) free columns.
        heldout: (W,) mean squared error of each held-out window.
        fitted: (W,) the same in the fit trials.
        tied: (n, T) what grows with each free column, see `fit_windows`.
    """

    effects: Names
    row: np.ndarray
    loss: float
    hessian: np.ndarray
    free: np.ndarray
    heldout: np.ndarray
    fitted: np.ndarray
    tied: np.ndarray = field(default_factory=lambda: np.empty((0, 0), dtype=np.int64))

    @property
    def error(self) -> float:
        """Mean squared held-out error."""
        return float(self.heldout.mean())


def is_poor(fit: SetFit, part: SetFit) -> bool:
    """Whether a set is worse than a part of it: its fit ended in the wrong place."""
    return fit.loss > POORER * part.loss and set(part.effects) < set(fit.effects)


def window_errors(row: np.ndarray, split: Split) -> np.ndarray:
    """(W,) mean squared error of each window; infinite where the free run runs away."""
    return _squared(residual_windows(row, split.signals))


def _squared(residuals: np.ndarray) -> np.ndarray:
    """(W,) mean squares of (steps, W) residuals; infinite where the free run ran away."""
    with np.errstate(over="ignore", invalid="ignore"):
        errors = np.mean(residuals**2, axis=0)
    return np.where(np.isfinite(errors), errors, np.inf)


def _huber(residuals: np.ndarray, outlier: float) -> float:
    """Huber loss per sample of (steps, W) residuals; infinite where the free run ran away."""
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.abs(residuals)
        loss = float(np.mean(np.where(size > outlier, outlier * (2.0 * size - outlier), size**2)))
    return loss if np.isfinite(loss) else np.inf


class JointFitter:
    """Fits effect sets to one joint, each set once.

    Args:
        data: of the joint.
    """

    def __init__(self, data: JointData) -> None:
        self.data = data
        self._ground = neutral_row() if data.then is None else data.then.row
        signals = data.fit.signals
        # Of the position error: only position mode has a k4.
        self._widest = float(np.abs(signals.command - signals.position).max())
        self._known: dict[Names, SetFit] = {}
        self._again: set[tuple[Names, Names]] = set()

    def fit(self, effects: Iterable[str] = (), warm: Sequence[SetFit] = (), iterations: int = ITERATIONS) -> SetFit:
        """Fit a set, from the best of `warm` rows joined together and the effects' own start values.

        No set is worse than a part of it, but for where the fit began: where `warm` shows that, it is fitted again.
        """
        names = in_order(effects)
        if names not in self._known:
            start = self._best_start(names, self._starts(names, warm))
            self._known[names] = self._result(names, *self._run(names, start, iterations))
        for part in warm:
            known = self._known[names]
            if is_poor(known, part) and (names, part.effects) not in self._again:
                self._again.add((names, part.effects))
                found = self._run(names, self._shy(part, names), iterations)
                if found[1] < known.loss:
                    self._known[names] = self._result(names, *found)
        return self._known[names]

    def refine(self, fit: SetFit, larger: SetFit | None = None) -> SetFit:
        """The same set, fitted until it settles, from where it is or from a larger set; it replaces the hasty fit."""
        rows = [fit.row] if larger is None else [fit.row, self._joined(fit.effects, larger, [larger])]
        start = self._best_start(fit.effects, rows)
        self._known[fit.effects] = self._result(fit.effects, *self._run(fit.effects, start, ITERATIONS))
        return self._known[fit.effects]

    def fit_from(self, fit: SetFit, effect: str, value: float) -> SetFit:
        """The same set, fitted from where the first number of an effect is `value`; it is not remembered."""
        row = fit.row.copy()
        if effect in FACTORS:
            row = multiplied(row, effect, value / self.first_number(fit, effect))
        else:
            row[slots(effect)[0]] = value
        return self._result(fit.effects, *self._run(fit.effects, row, ITERATIONS))

    def fit_like(self, fit: SetFit, numbers: Mapping[int, float]) -> SetFit:
        """The same set, fitted from where these columns have these numbers; it is not remembered."""
        row = fit.row.copy()
        row[list(numbers)] = list(numbers.values())
        return self._result(fit.effects, *self._run(fit.effects, row, ITERATIONS))

    def first_number(self, fit: SetFit, effect: str) -> float:
        """The first number of an effect of a set, in the fit's own form."""
        if effect in FACTORS:
            return ratios(fit.row, self._ground, fit.effects).get(effect, 1.0)
        return float(fit.row[slots(effect)[0]])

    def fit_awake(self, fit: SetFit, effect: str) -> SetFit:
        """The same set, fitted from the best of an effect's own starts; it is not remembered."""
        parameter = EFFECTS[effect].parameters[0]
        size = self.data.size[parameter.scale]
        rows = []
        for start in parameter.starts:
            rows.append(fit.row.copy())
            rows[-1][slots(effect)[0]] = start / size if parameter.inverse else start * size
        return self._result(fit.effects, *self._run(fit.effects, self._best_start(fit.effects, rows), ITERATIONS))

    def _best_start(self, names: Names, rows: Sequence[np.ndarray]) -> np.ndarray:
        """Of several rows the one that does best after a first look."""
        if len(rows) == 1:
            return rows[0]
        looks = [self._run(names, row, FIRST_LOOK) for row in rows]
        return min(looks, key=lambda found: found[1])[0]

    def _result(self, names: Names, row: np.ndarray, loss: float, hessian: np.ndarray, residuals: np.ndarray) -> SetFit:
        heldout = window_errors(row, self.data.heldout)
        free, *_, tied = self._columns(names)
        return SetFit(names, row, loss, hessian, free, heldout, _squared(residuals), tied)

    def _run(self, names: Names, row: np.ndarray, iterations: int) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
        free, lower, upper, scale, tied = self._columns(names)
        row = row.copy()
        for column, value in self._settled(names).items():
            row[column] = value
        signals = self.data.fit.signals
        outlier = max(OUTLIER_SIGMAS * self.data.noise, OUTLIER_SHARE * float(np.sqrt(np.nanmean(signals.target**2))))
        if not len(free):
            residuals = residual_windows(row, signals)
            return row, _huber(residuals, outlier), np.empty((0, 0)), residuals
        return fit_windows(row, signals, free, lower, upper, scale, tied, CHANGES, outlier, iterations, TOLERANCE)

    def _settled(self, names: Names) -> dict[int, float]:
        """Column → number of what others speak for: effects of the set that say the same, or the machine."""
        found = {}
        for name in (name for name in names if name not in FACTORS):
            for column, parameter in zip(slots(name), EFFECTS[name].parameters, strict=True):
                if column in self.data.held:
                    found[column] = self.data.held[column]
                elif self.data.mode not in parameter.modes or (parameter.beside or name) not in names:
                    found[column] = parameter.neutral
                elif set(parameter.yields_to) & set(names):
                    start = parameter.starts[0] * self.data.size[parameter.scale]
                    found[column] = start if self.data.then is None else float(self._ground[column])
        return found

    def _columns(self, names: Names) -> tuple[np.ndarray, ...]:
        """Free columns of a set with their bounds, sizes and what is tied to them."""
        parts = self._base_columns() if self.data.then is None else self._factor_columns(names)
        for more in (self._effect_columns(names), self._presliding(names)):
            parts = [[*known, *new] for known, new in zip(parts, more, strict=True)]
        free, *sizes, tied = parts
        width = max([len(t) for t in tied], default=0) if self.data.then is not None else 0
        ties = np.full((len(free), width), -1, dtype=np.int64)
        for i, group in enumerate(tied if width else []):
            ties[i, : len(group)] = group
        return np.array(free, dtype=np.int64), *(np.array(values, dtype=np.float64) for values in sizes), ties

    def _factor_columns(self, names: Names) -> list[list]:
        """What of the base model changed since the earlier record: of each change the column that leads."""
        free, lower, upper, scale, tied = [], [], [], [], []
        for name, column in leaders(names, self._ground).items():
            then = float(self._ground[column])
            free.append(column)
            lower.append(then / MOST_RATIO)
            upper.append(min(then * MOST_RATIO, 1.0) if column == slot("base", "k2") else then * MOST_RATIO)
            scale.append(RATIO_SCALE * then)
            tied.append(base_slots(name))
        return [free, lower, upper, scale, tied]

    def _base_columns(self) -> list[list]:
        """All coefficients of the base model."""
        free, lower, upper, scale = [], [], [], []
        natural = self.data.natural
        for name in BASE_OF_MODE[self.data.mode]:
            free.append(slot("base", name))
            lower.append(0.0)
            upper.append(self._most(name))
            scale.append(0.1 * natural[name])
        return [free, lower, upper, scale, [ALONE] * len(free)]

    def _most(self, name: str) -> float:
        """Upper bound of a base coefficient: neither leakage nor an impact takes more than the torque there is."""
        return {"k2": 1.0, "k4": 1.0 / max(self._widest, 1e-300)}.get(name, np.inf)

    def _effect_columns(self, names: Names) -> list[list]:
        """The numbers of a set's effects; one that an earlier record holds may be as it was, whatever the logs' sizes."""
        free, lower, upper, scale = [], [], [], []
        settled, size = self._settled(names), self.data.size
        for effect in (name for name in names if name not in FACTORS or self.data.then is None):
            for column, parameter in zip(slots(effect), EFFECTS[effect].parameters, strict=True):
                if column in settled:
                    continue
                unit = 1.0 / size[parameter.scale] if parameter.inverse else size[parameter.scale]
                then = float(self._ground[column]) if self.data.then is not None else parameter.lower * unit
                free.append(column)
                lower.append(min(parameter.lower * unit, then))
                upper.append(max(parameter.upper * unit, then))
                scale.append(unit * max(abs(start) for start in (*parameter.starts, 0.01)))
        return [free, lower, upper, scale, [ALONE] * len(free)]

    def _presliding(self, names: Names) -> list[list]:
        """The travel in which friction turns round, where an effect of the set needs it and none has it."""
        dry = {"stribeck_friction", "load_dependent_friction"} & set(names)
        known = "coulomb_friction" in names or (self.data.then is not None and self.data.then.rubs)
        if not dry or known:
            return [[], [], [], [], []]
        turn = next(p for p in EFFECTS["coulomb_friction"].parameters if p.name == "presliding_rad")
        size = self.data.size[turn.scale]
        column = slot("coulomb_friction", turn.name)
        return [[column], [turn.lower * size], [turn.upper * size], [turn.starts[0] * size], [ALONE]]

    def _starts(self, names: Names, warm: Sequence[SetFit]) -> list[np.ndarray]:
        """Rows to begin with."""
        if not names:
            return [self._first_guess() if self.data.then is None else self._ground]
        base = self.fit().row
        if warm:
            return [self._joined(names, fit, warm) for fit in warm]
        if self.data.then is not None:
            return self._changed(names)
        options = [
            [
                (column, start / size if p.inverse else start * size)
                for start in p.starts
                for size in [self.data.size[p.scale]]
            ]
            for name in names
            for column, p in zip(slots(name), EFFECTS[name].parameters, strict=True)
        ]
        rows = []
        for factor in EFFECTS[names[0]].stiffer if len(names) == 1 else (1.0,):
            for choice in product(*options):
                row = base.copy()
                row[[slot("base", "k1"), slot("base", "k3")]] *= factor
                for column, value in choice:
                    row[column] = value
                rows.append(row)
        return rows

    def _changed(self, names: Names) -> list[np.ndarray]:
        """Rows in which each name of a set in turn is somewhere else than in the earlier record, and that record's own."""
        rows = [self._ground]
        for name in names:
            if name in FACTORS:
                rows += [multiplied(self._ground, name, start) for start in (0.7, 1.4)]
                continue
            parameters = list(zip(slots(name), EFFECTS[name].parameters, strict=True))
            for start in product(*(p.starts for _, p in parameters)):
                row = self._ground.copy()
                for (column, p), value in zip(parameters, start, strict=True):
                    size = self.data.size[p.scale]
                    row[column] = value / size if p.inverse else value * size
                rows.append(row)
        return rows

    def _joined(self, names: Names, fit: SetFit, warm: Sequence[SetFit]) -> np.ndarray:
        """The row of one fit, with the effects that it lacks from the others."""
        row = fit.row.copy()
        gone = ratios(fit.row, self._ground, fit.effects) if self.data.then is not None else {}
        for name in names:
            if name not in fit.effects:
                donor = next((other for other in warm if name in other.effects), None)
                if donor is None:
                    donor = self.fit((name,))
                if name in FACTORS:
                    row = multiplied(row, name, self.first_number(donor, name))
                    continue
                row[slots(name)] = donor.row[slots(name)]
                self._reset_shape(row, name)
        for name in fit.effects:
            if name not in names:
                if name in FACTORS:
                    row = multiplied(row, name, 1.0 / gone.get(name, 1.0))
                else:
                    row[slots(name)] = self._ground[slots(name)]
        return row

    def _shy(self, fit: SetFit, names: Names) -> np.ndarray:
        """The row of a fit, with a tenth of what the effects that it lacks are by themselves."""
        row = self._joined(names, fit, [fit])
        for name in set(names) - set(fit.effects) - set(FACTORS):
            first = slots(name)[0]
            row[first] = self._ground[first] + SHY * (row[first] - self._ground[first])
        return row

    def _reset_shape(self, row: np.ndarray, name: str) -> None:
        """Numbers that only shape an effect start afresh: alone, it may have bent them to imitate what it lacked."""
        for column, parameter in zip(slots(name), EFFECTS[name].parameters, strict=True):
            if not parameter.counts and len(parameter.starts) == 1 and not self._ground[slots(name)[0]]:
                size = self.data.size[parameter.scale]
                row[column] = parameter.starts[0] / size if parameter.inverse else parameter.starts[0] * size

    def _first_guess(self) -> np.ndarray:
        """Base gains from differences over a few samples, the better of several spans in the free run."""
        rows = [self._regressed(span) for span in SPANS if span <= self.data.fit.signals.steps]
        losses = [np.mean(window_errors(row, self.data.fit)) for row in rows]
        return rows[int(np.nanargmin(losses))]

    def _regressed(self, span: int) -> np.ndarray:
        s, mode = self.data.fit.signals, self.data.mode
        row = self.data.row.copy()
        at = s.first[None, :] + np.arange(0, s.steps - span + 1, span)[:, None]

        def summed(values: np.ndarray) -> np.ndarray:
            total = np.concatenate([[0.0], np.cumsum(values)])
            return (total[at + span] - total[at]).ravel()

        error = s.command - (s.position if mode == "position" else s.effort)
        rise = (s.effort[at + span] - s.effort[at]).ravel()
        columns = [summed(error), -summed(s.effort), -summed(s.velocity)]
        x = np.stack(columns, axis=1)
        gains = np.linalg.lstsq(x, rise, rcond=None)[0]
        for name, gain in zip(("k1", "k2", "k3"), gains, strict=True):
            row[slot("base", name)] = min(max(gain, 0.0), 0.9 if name == "k2" else np.inf)
        return row
