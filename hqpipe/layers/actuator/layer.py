"""Joints whose position is commanded and whose torque is measured."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from hqpipe.errors import IdentificationError
from hqpipe.identify.free_run import window_samples
from hqpipe.identify.least_squares import Fitter, Solution
from hqpipe.identify.model import FORCE_SENSOR, LayerJoints
from hqpipe.identify.window_choice import window_for
from hqpipe.layers.actuator.changes import RATIOS
from hqpipe.layers.actuator.joint import ActuatorJoint
from hqpipe.layers.actuator.parameters import TOLD_BY_FRICTION, base_parameters, effects_of
from hqpipe.layers.actuator.record import draws_of, record_of
from hqpipe.layers.actuator.shapes import free_run_shapes, shapes_of
from hqpipe.layers.actuator.sizes import Sizes, at_rest, sizes_of
from hqpipe.layers.actuator.spool_hysteresis import spool_hysteresis
from hqpipe.layers.actuator.start import first_guesses
from hqpipe.layers.actuator.start_noise import StartNoise
from hqpipe.layers.actuator.sudden_change import moment_of_change, stepped_time, with_sudden_change
from hqpipe.layers.refusal import no_joint_judged
from hqpipe.logs.finer_clock import steps_per_row
from hqpipe.logs.joint_kinds import PRISMATIC, unit_of
from hqpipe.logs.trajectory import LogSet
from hqpipe.logs.vibration import MEANS, Vibration, vibrations
from hqpipe.machine import EFFECTS
from hqpipe.machine.layout import BASE, neutral_row, slot
from hqpipe.machine.stribeck_friction import EFFECT as STRIBECK

NEEDED = ("position_command", "effort", "position", "velocity")
# Without its sign noise round zero torque is a size, which looks like slack once the sign is restored.
_SLACK = tuple(name for name, effect in EFFECTS.items() if effect.slack)
CLEAR = 4.0  # standard deviations of the torque's sensor: its noise alone shows more once in 16 000 samples
FEWEST_WINDOWS = 10  # of the fit trials; assumption: fewer do not tell an effect from chance


class Actuator:
    """The actuator layer in control mode position: commanded position → torque (paper, eqs. 1 to 9)."""

    NAME = "actuator"

    def __init__(
        self,
        effort_limit: Mapping[str, float] | None = None,
        unsigned: Collection[str] = (),
        earlier: LogSet | None = None,
    ) -> None:
        """
        Args:
            effort_limit: joint → N·m at which it saturates. unsigned: joints whose torque had lost its sign.
            earlier: logs to whose signals the sizes of all numbers refer, so that both records count them alike; None for
                those that are judged.
        """
        self.effort_limit, self.unsigned, self.earlier = effort_limit or {}, frozenset(unsigned), earlier

    def lacking(self, log_set: LogSet) -> list[str]:
        """Columns that the logs do not have."""
        return [name for name in NEEDED if any(getattr(t.trajectory, name) is None for t in log_set.trials)]

    def joints(self, log_set: LogSet, window_s: float | None = None, without: Collection[str] = ()) -> LayerJoints:
        """The joints whose position is commanded.

        Args:
            log_set: with commanded positions and measured efforts, end stops marked.
            window_s: length of a free run; None for one that suits the logs.
            without: names of effects to leave out.

        Raises:
            IdentificationError: no joint can be judged.
        """
        if lacking := self.lacking(log_set):
            raise IdentificationError(
                f"{log_set.path}: no column {' and '.join(lacking)}, which the layer '{self.NAME}' in mode position needs",
                file=log_set.path,
                field=lacking[0],
                fix="record the commanded position and the torque of the joints",
            )
        window = window_for(log_set, window_s)
        dt = float(np.median([t.trajectory.dt for t in log_set.trials]))
        steps = window_samples(dt, window.seconds, log_set.path)
        models, left = [], {}
        draws = self._draws(log_set)
        vibrating = {each.joint: each for each in vibrations([t.trajectory for t in log_set.trials])}
        for j, name in enumerate(log_set.joints):
            barred = {*without, *(_SLACK if name in self.unsigned else ())}
            model = self._joint(log_set, j, steps, draws, barred, vibrating.get(name))
            if isinstance(model, str):
                left[name] = model
            else:
                models.append(model)
        if not models:
            raise no_joint_judged(
                log_set.path,
                "by its commanded position",
                left,
                "record longer motions under changing commands",
                "position_command",
            )
        return LayerJoints(
            self.NAME, "free_run_rmse", window.seconds, window.reason, tuple(models), left, material=FORCE_SENSOR
        )

    def _joint(
        self,
        log_set: LogSet,
        j: int,
        steps: int,
        draws: tuple[np.ndarray, np.ndarray],
        barred: Collection[str],
        vibration: Vibration | None,
    ) -> ActuatorJoint | str:
        """The model of joint `j`, or why there is none."""
        name, kind = log_set.joints[j], log_set.kinds.get(log_set.joints[j])
        dt = _sample_time(log_set)
        per_row = steps_per_row(dt)
        slowest = max(per_row, steps_per_row(_sample_time(self.earlier)) if self.earlier else 1)
        records = tuple(record_of(trials, j, steps, draws, per_row) for trials in (log_set.fit, log_set.heldout))
        if records[0].windows < FEWEST_WINDOWS:
            return f"only {records[0].windows} windows of {steps} samples away from its end stops"
        if reason := at_rest([t.trajectory for t in log_set.fit], j):
            return reason
        size = self._sizes(log_set, j, draws[0])
        runs = len(records[0].signals.bounds) - 1
        effects, places = effects_of(size, len(log_set.joints), runs, log_set.effort_source, barred)
        units = (unit_of("N·m", kind), unit_of("rad", kind))
        notes = () if vibration is None else (f"{vibration.text(units[0])}; {MEANS}",)
        # Without its sign the torque near zero changes from sample to sample as well.
        fed = STRIBECK.name in {effect.name for effect in effects} and name not in self.unsigned
        row = self._neutral(log_set.joints[j], size, dt / per_row)

        fit, heldout = (record.samples() for record in records)
        none = np.zeros((0, len(fit.trial))), np.zeros((0, len(heldout.trial)))
        starts = tuple(StartNoise(size.noise**2, record.step, record.judged) for record in records)

        def model(first: dict[str, float], leak: float = 0.0, law: Solution | None = None) -> ActuatorJoint:
            # A base that lacks an effect may leak too little; the floor is the least that noise leaves.
            noise, misfit_noise = starts[0].floor(max(first["k2"], leak))
            shapes, scale, stepped, known = none, np.zeros(0), None, effects
            if law is not None:
                shapes, scale = free_run_shapes(records, size, first)
                moment = moment_of_change(records[0], size, first, law, shapes[0])
                stepped = tuple(stepped_time(record, moment) for record in records)
                known = (*with_sudden_change(effects), spool_hysteresis(size, units[1]), *shapes_of(size, units[0]))
            return ActuatorJoint(
                joint=name,
                unit=units[0],
                dt=dt,
                base=base_parameters(first, size, slowest),
                effects=known,
                fit=fit,
                heldout=heldout,
                noise=(noise, noise),
                misfit_noise=(misfit_noise, misfit_noise),
                starts=starts,
                notes=notes,
                places=places,
                records=records,
                neutral=row,
                shapes=shapes,
                shape_scale=scale,
                stepped=stepped,
                ratios={name: ratio for name, ratio in RATIOS.items() if name not in barred},
                draws=(float(draws[0][j]), float(draws[1][j])),
                units=units,
                unsigned=name in self.unsigned,
                implies=tuple(effect for effect in TOLD_BY_FRICTION if effect not in barred),
                vibration_shows=STRIBECK.name if fed else "",
            )

        guess = _best_guess(model, first_guesses(records[0], per_row))
        first, law = _fitted(model(guess))
        return model(first, guess["k2"], law)  # the shapes fade with the leakage

    def _draws(self, log_set: LogSet) -> tuple[np.ndarray, np.ndarray]:
        """(J,) rad/s of flow per speed and per position error of each joint."""
        logs = self.earlier or log_set
        slides = [logs.kinds.get(name) == PRISMATIC for name in logs.joints]
        by_speed, by_opening = draws_of([t.trajectory for t in logs.fit], slides)
        at = [logs.joints.index(name) for name in log_set.joints]
        return by_speed[at], by_opening[at]

    def _sizes(self, log_set: LogSet, j: int, draws: np.ndarray) -> Sizes:
        """Sizes that the numbers of joint `j` refer to; the noise is always that of the logs that are judged."""
        slides = log_set.kinds.get(log_set.joints[j]) == PRISMATIC
        own = sizes_of([t.trajectory for t in log_set.fit], j, draws, slides, _alike(log_set, slides))
        if self.earlier is None:
            return own
        then, k = [t.trajectory for t in self.earlier.fit], self.earlier.joints.index(log_set.joints[j])
        if at_rest(then, k):
            return own
        everywhere = np.ones(len(self.earlier.joints))
        everywhere[[self.earlier.joints.index(name) for name in log_set.joints]] = draws
        return replace(sizes_of(then, k, everywhere, slides, _alike(self.earlier, slides)), noise=own.noise)

    def _neutral(self, joint: str, size: Sizes, step: float) -> np.ndarray:
        """(WIDTH,) a row of the loops without effects; step: s."""
        row = neutral_row()
        row[slot("setting", "sample_time")] = step
        row[slot("setting", "middle")] = size.middle
        row[slot("setting", "clear")] = CLEAR * size.noise
        row[slot("setting", "effort_limit")] = self.effort_limit.get(joint, np.inf)
        return row


def _alike(log_set: LogSet, slide: bool) -> list[int]:
    """Numbers of the joints that slide, or of those that turn."""
    return [k for k, name in enumerate(log_set.joints) if (log_set.kinds.get(name) == PRISMATIC) is slide]


def _sample_time(log_set: LogSet) -> float:
    """Median over the fit trials, s."""
    return float(np.median([t.trajectory.dt for t in log_set.fit]))


def _best_guess(
    model: Callable[[dict[str, float]], ActuatorJoint], guesses: Sequence[dict[str, float]]
) -> dict[str, float]:
    """Of the first guesses the one that runs free best."""

    def square(first: dict[str, float]) -> float:
        fitter = Fitter(model(first))
        error = fitter.error(fitter.neutral)
        return float(error @ error)

    return min(guesses, key=square)


def _fitted(joint: ActuatorJoint) -> tuple[dict[str, float], Solution]:
    """The four coefficients fitted by themselves, and their fit."""
    fitter = Fitter(joint)
    found = fitter.fit(np.arange(len(BASE)), [fitter.neutral], 0.0)
    return {name: float(value) for name, value in zip(BASE, found.values, strict=False)}, found
