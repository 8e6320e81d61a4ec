"""The paper's model with the effects that a diagnosis of the fit trials alone finds, fitted to all of them.

The choice of effects needs trials of its own to be accepted on: the end of every fit trial is held back for it. Then the
coefficients and parameters of the chosen set are fitted once more, to the whole of the fit trials. Trials on which models
are compared play no part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.actuators.augmented import Augmented
from hqpipe.errors import IdentificationError
from hqpipe.gap.diagnosis import LARGEST
from hqpipe.gap.fitted_joints import FittedJoints
from hqpipe.gap.intake import take_in
from hqpipe.identify.found import JointFound
from hqpipe.identify.free_run import WINDOW_S, require_channels, window_samples
from hqpipe.identify.identify import identify
from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.misfit import misfit_noise
from hqpipe.identify.model import JointModel, LayerJoints, parameter_names, positions
from hqpipe.identify.paper_model.fit_actuator import PerJoint, per_joint
from hqpipe.identify.passing import PassingJoint, modelled
from hqpipe.identify.windows import common_dt
from hqpipe.layers.actuator import Actuator
from hqpipe.layers.actuator.joint import ActuatorJoint
from hqpipe.layers.actuator.parameters import BASE_NAMES, LOGGED_SPEED
from hqpipe.logs.end_stops import mark_end_stops
from hqpipe.logs.split import fit_sections, hold_back
from hqpipe.logs.trajectory import LogSet, Trajectory

Effects = dict[str, tuple[str, ...]]


@dataclass(frozen=True, eq=False)
class Diagnosed:
    """The fitted model; a `hqpipe.identify.free_run.TorquePredictor`.

    Attributes:
        rows: what the logs say, effects of the sensors included.
        actuator: what the simulator steps, without the sensors.
        effects: effect → joints that have it.
        warnings: what was found and is not in the model.
    """

    rows: FittedJoints
    actuator: Augmented
    effects: Effects
    warnings: tuple[str, ...] = ()

    def predict(self, trajectory: Trajectory, window: int) -> np.ndarray:
        """(T, J) N·m, from what is known up to each sample.

        Two things still look further than other models do: friction at the output that depends on speed uses the speed at the
        predicted sample, and an integrator starts from what the whole trial says.

        Raises:
            IdentificationError: a channel is missing.
            UsageError: a sample of the log is no whole number of the model's.
        """
        require_channels(trajectory, ("effort", "position_command"), "replaying the model with diagnosed effects")
        self.actuator.steps_per_row(trajectory.dt)  # refuses another clock
        return self.rows.predict(trajectory, window)


def fit_diagnosed(
    log_set: LogSet,
    *,
    window_s: float = WINDOW_S,
    without: Sequence[str] = (),
    effort_limit: PerJoint = np.inf,
    workers: int = 1,
) -> Diagnosed:
    """Choose effects on the fit trials and fit them.

    Args:
        log_set: of position mode; only its fit trials are used, of long ones evenly spaced sections.
        window_s: of the free run, s. without: effects left out of the library. effort_limit: N·m, or joint → N·m.
        workers: joints searched at a time; the answer does not depend on it.

    Raises:
        IdentificationError: the logs are broken, too short, or of another mode.
    """
    if log_set.control_mode != "position":
        raise IdentificationError(
            f"control mode is {log_set.control_mode or 'unknown'}: effects are added to the paper's model, which is one of "
            "position control; hqpipe diagnose names the effects of other modes"
        )
    steps = window_samples(common_dt(log_set.fit), window_s)
    chosen_on, fitted_to = _parts(log_set, steps, window_s, without)
    limits = per_joint(effort_limit, log_set.joints, "effort_limit")
    layer = Actuator(dict(zip(log_set.joints, map(float, limits), strict=True)))
    found = identify(_all_joints(layer, chosen_on, window_s, without), workers=workers).found
    models = _all_joints(layer, fitted_to, window_s, without).models
    fits = [_refitted(one, model) for one, model in zip(found, models, strict=True)]
    options = [FittedJoints.of(models, values) for values in zip(*fits, strict=True)]
    better = np.argmin([_misfit(option, fitted_to, steps) for option in options], axis=0)
    rows = FittedJoints.of(models, [fits[j][k] for j, k in enumerate(better)])
    return Diagnosed(rows, rows.actuator(), _effects(found), tuple(_left_out(found)))


def _parts(log_set: LogSet, steps: int, window_s: float, without: Sequence[str]) -> tuple[LogSet, LogSet]:
    """What effects are chosen on, the end of every fit trial held out, and the whole fit trials.

    Raises:
        IdentificationError: no effects can be chosen for all joints.
    """
    part = _in_windows(hold_back(log_set, LARGEST), steps, window_s)
    intake = take_in(part, window_s, without)
    if intake.signed.joints:
        raise IdentificationError(
            f"the torque of {', '.join(intake.signed.joints)} has lost its sign, which a prediction of the log cannot have "
            "either; record it with its sign"
        )
    if intake.reasons:
        raise IdentificationError(intake.reasons[0])
    if broken := [item for item in intake.left_out if item.joints and item.channel is None]:
        raise IdentificationError(
            f"{broken[0].reason}: a model of all joints needs sound logs of each; {broken[0].fix}"
        )
    left_out = {t.file for t in part.trials} - {t.file for t in intake.log_set.trials}
    kept = [
        trial
        for trial in fit_sections(log_set, LARGEST).trials
        if trial.file not in left_out and trial.trajectory.samples > steps
    ]
    return intake.log_set, mark_end_stops(replace(log_set, trials=tuple(kept)))[0]


def _in_windows(log_set: LogSet, steps: int, window_s: float) -> LogSet:
    """The log set without the parts that hold no window."""
    kept = replace(log_set, trials=tuple(t for t in log_set.trials if t.trajectory.samples > steps))
    if not kept.fit or not kept.heldout:
        raise IdentificationError(
            f"no fit trial is long enough to be cut in two parts with windows of {window_s:g} s: record longer ones"
        )
    return kept


def _all_joints(layer: Actuator, log_set: LogSet, window_s: float, without: Sequence[str]) -> LayerJoints:
    """The joints of the layer, as soon as all can be judged."""
    joints = layer.joints(log_set, window_s, without)
    for name, reason in joints.left.items():
        raise IdentificationError(f"{name}: {reason}: a model of all joints needs logs in which each of them moves")
    return joints


def _refitted(found: JointFound, model: ActuatorJoint) -> tuple[np.ndarray, np.ndarray]:
    """(P,) values of the chosen effects, fitted to the whole fit trials from where the choice left them.

    Twice: with the speed that suits the torque, and with the logged one. The speed of the positions is noisier in a prediction
    than in the fit, which knows the next position.
    """
    fitter, free = Fitter(model), positions(model, modelled(found).effects)
    start, noise = _same_values(found, model, fitter.neutral), misfit_noise(model)[0] ** 2
    fitted = fitter.fit(free, [start], noise).values
    logged = BASE_NAMES.index(LOGGED_SPEED)
    start = fitted.copy()
    start[logged] = 1.0
    if np.array_equal(start, fitted):
        return fitted, fitted
    return fitted, fitter.fit(free[free != logged], [start], noise).values


def _same_values(found: JointFound, model: JointModel, neutral: np.ndarray) -> np.ndarray:
    """(P,) numbers of the base and the chosen effects in the order of another model of the joint, the others `neutral`."""
    chosen, values = modelled(found), neutral.copy()
    known = dict(zip(parameter_names(found.model), chosen.values, strict=True))
    for k, (effect, name) in enumerate(parameter_names(model)):
        if (effect in chosen.effects or not effect) and (effect, name) in known:
            values[k] = known[effect, name]
    return values


def _misfit(model: FittedJoints, log_set: LogSet, steps: int) -> np.ndarray:
    """(J,) mean squared error in the fit trials, free-running from what is known at each sample."""
    squares, counts = np.zeros((2, len(model.joints)))
    for t in (trial.trajectory for trial in log_set.fit):
        with np.errstate(over="ignore", invalid="ignore"):
            error = np.where(t.recorded, model.predict(t, steps) - t.effort, 0.0)
            squares += (error**2).sum(axis=0)
        counts += t.recorded[1:].sum(axis=0)
    return np.where(np.isfinite(squares), squares / counts, np.inf)


def _effects(found: Sequence[JointFound]) -> Effects:
    named = dict.fromkeys(name for joint in found for name in modelled(joint).effects)
    return {name: tuple(joint.model.joint for joint in found if name in modelled(joint).effects) for name in named}


def _left_out(found: Sequence[JointFound]) -> list[str]:
    """What acts for some time only."""
    passing: dict[str, list[str]] = {}
    for joint in found:
        for cause in joint.causes if isinstance(joint.model, PassingJoint) else ():
            passing.setdefault(cause.effect, []).append(joint.model.joint)
    return [
        f"{effect} in {', '.join(joints)} acts for a part of the fit trials only and is left out"
        for effect, joints in passing.items()
    ]
