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
from hqpipe.effects.layout import slot
from hqpipe.errors import IdentificationError
from hqpipe.gap.accuse import Accusation, accuse
from hqpipe.gap.diagnosis import LARGEST
from hqpipe.gap.intake import take_in
from hqpipe.gap.joint_data import CONTINUED, LATE, LOGGED, MOVED, joint_data
from hqpipe.gap.row_model import FLOW, RowModel
from hqpipe.gap.set_fit import JointFitter
from hqpipe.gap.verdict import shortage
from hqpipe.logs.split import fit_sections, hold_back
from hqpipe.logs.trajectory import LogSet, Trajectory
from hqpipe.sysid.fit_actuator import PerJoint, per_joint
from hqpipe.sysid.free_run import WINDOW_S, require_channels, window_samples
from hqpipe.sysid.windows import common_dt

SPEED_LATE = slot("setting", "speed_late")  # chosen with the effects
Effects = dict[str, tuple[str, ...]]


@dataclass(frozen=True, eq=False)
class Diagnosed:
    """The fitted model; a `hqpipe.sysid.free_run.TorquePredictor`.

    Attributes:
        rows: what the logs say, effects of the sensors included.
        actuator: what the simulator steps, without the sensors.
        effects: effect → joints that have it.
        warnings: what was found and is not in the model.
    """

    rows: RowModel
    actuator: Augmented
    effects: Effects
    warnings: tuple[str, ...] = ()

    def predict(self, trajectory: Trajectory, window: int) -> np.ndarray:
        """(T, J) N·m, replayed as the diagnosis does, but for the speed.

        Where the diagnosis takes the change of position over the step that is predicted, the speed in the hydraulics is here
        what the positions before it make expect. Two things still look further than other models do: friction at the output
        that depends on speed uses the speed at the predicted sample, and an integrator starts from what the whole trial says.

        Raises:
            IdentificationError: a channel is missing.
            UsageError: the sample time is another one than that of the fit.
        """
        require_channels(trajectory, ("effort", "position_command"), "replaying the model with diagnosed effects")
        self.actuator.check_dt(trajectory.dt)
        known = replace(self.rows, speed=CONTINUED) if self.rows.speed == MOVED else self.rows
        return known.predict(trajectory, window)


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
    rotten = {t.file for t in part.trials} - {t.file for t in intake.log_set.trials}
    log_set = replace(log_set, trials=tuple(t for t in log_set.trials if t.file not in rotten))
    limit = per_joint(effort_limit, log_set.joints, "effort_limit")
    found = accuse(intake.log_set, steps, without, effort_limit=limit, workers=workers)
    reasons, _ = shortage(found.base.fit, found.heldout, np.array([state.data.noise for state in found.states]) ** 2)
    if reasons:
        raise IdentificationError(reasons[0])
    speeds = dict.fromkeys((found.before.speed, LOGGED))
    models = [_refitted(log_set, found, speed, steps, limit) for speed in speeds]
    return min(models, key=lambda model: _misfit(model, fit_sections(log_set, LARGEST), steps))


def _in_windows(log_set: LogSet, steps: int, window_s: float) -> LogSet:
    """The log set without the parts that hold no window."""
    kept = replace(log_set, trials=tuple(t for t in log_set.trials if t.trajectory.samples > steps))
    if not kept.fit or not kept.heldout:
        raise IdentificationError(
            f"no fit trial is long enough to be cut in two parts with windows of {window_s:g} s: record longer ones"
        )
    return kept


def _refitted(log_set: LogSet, found: Accusation, speed: str, steps: int, limit: np.ndarray) -> Diagnosed:
    """The chosen sets, fitted to the whole fit trials from where the choice left them.

    Args:
        speed: of `hqpipe.gap.joint_data.SPEEDS`. steps: samples per window. limit: (J,) N·m.
    """
    trials = [t.trajectory for t in fit_sections(log_set, LARGEST).trials if t.trajectory.samples > steps]
    rows, flow = [], tuple(found.after.rows[:, FLOW].T)
    for j, state in enumerate(found.states):
        row, noise = state.chosen.row.copy(), state.data.noise
        row[SPEED_LATE] += LATE[speed] - LATE[found.before.speed]
        data = joint_data(trials, trials, j, "position", steps, noise, float(limit[j]), speed, flow)
        data.row[SPEED_LATE] = row[SPEED_LATE]
        chosen = replace(state.chosen, row=row)
        rows.append(JointFitter(data).fit(chosen.effects, [chosen]).row)
    model = RowModel(log_set.joints, np.array(rows), "position", speed)
    return Diagnosed(model, model.actuator(), _effects(found), tuple(_left_out(found)))


def _misfit(model: Diagnosed, log_set: LogSet, steps: int) -> float:
    """Mean squared error, free-running in the fit trials, with the speeds that the model is judged on."""
    trials = [trial.trajectory for trial in log_set.fit]
    errors = np.concatenate([(model.predict(t, steps) - t.effort)[1:] for t in trials])
    with np.errstate(over="ignore", invalid="ignore"):
        found = float(np.mean(errors**2))
    return found if np.isfinite(found) else np.inf


def _effects(found: Accusation) -> Effects:
    named = dict.fromkeys(name for state in found.states for name in state.chosen.effects)
    return {name: tuple(s.joint for s in found.states if name in s.chosen.effects) for name in named}


def _left_out(found: Accusation) -> list[str]:
    return [
        f"{cause.effect} in {', '.join(cause.joints)} acts for a part of the fit trials only and is left out"
        for cause in found.passing
    ]
