"""Earlier logs of the same machine as the record that new ones are compared with: diagnosed like any others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqpipe.effects.layout import NOT_KNOWN, slot
from hqpipe.errors import IdentificationError
from hqpipe.gap.accuse import accuse
from hqpipe.gap.intake import take_in
from hqpipe.gap.joint_data import Then
from hqpipe.gap.joint_state import JointState, Progress
from hqpipe.gap.levels import levels_of
from hqpipe.gap.replay import persistence_error
from hqpipe.gap.second_channel import measured
from hqpipe.gap.since import LOGS, Earlier, sample_time
from hqpipe.gap.two_fits import two_fits
from hqpipe.gap.verdict import shortage
from hqpipe.logs.end_stops import Travel
from hqpipe.logs.trajectory import LogSet


def earlier_logs(
    log_set: LogSet,
    window_s: float | None,
    without: Sequence[str] = (),
    workers: int = 1,
    progress: Progress | None = None,
    travel: Travel | None = None,
) -> Earlier:
    """Diagnose earlier logs and take the machine as it was found: coefficients, effects, and how sure they are.

    Args:
        log_set: fit and held-out trials. window_s: s, or None for what suits the logs.
        without: effects left out of the library.
        workers: joints at a time. progress: called after each joint.
        travel: stated limits of the joints' positions, where end stops may be.

    Raises:
        IdentificationError: they cannot be diagnosed.
    """
    intake = take_in(log_set, window_s, without, travel)
    if intake.reasons:
        raise _refused(log_set, intake.reasons[0], intake.advice)
    told, logs = (*intake.warnings, *intake.stops, *(item.reason for item in intake.left_out)), intake.log_set
    found = accuse(logs, intake.steps, without, intake.signed, None, workers, progress)
    sensor = np.array([state.data.noise for state in found.states]) ** 2
    reasons, _ = shortage(found.base.fit, found.heldout, sensor)
    if reasons:
        raise _refused(log_set, reasons[0], "record longer trials in which every joint moves")
    swing = persistence_error(found.heldout)
    then = {
        state.joint: _then(state, found.after.rows[j], float(found.noise[j]), float(swing[j]))
        for j, state in enumerate(found.states)
    }
    return Earlier(
        path=str(log_set.path),
        kind=LOGS,
        sha256=log_set.sha256,
        mode=log_set.control_mode,
        dt=sample_time(logs),
        joints=log_set.joints,
        speed=found.after.speed,
        then=then,
        source=log_set.effort_source,
        window_s=intake.window.seconds,
        unsigned=intake.signed.joints,
        levels=levels_of(log_set),
        checked=frozenset((f.effect, f.joint) for f in measured(logs, without)),
        warnings=tuple(f"reference: {text}" for text in told),
    )


def _refused(log_set: LogSet, reason: str, advice: str | None) -> IdentificationError:
    return IdentificationError(
        f"reference {log_set.path}: {reason}", file=log_set.path, fix=advice or "give other logs"
    )


def _then(state: JointState, row: np.ndarray, noise: float, swing: float) -> Then:
    """A joint as its earlier logs show it.

    Args:
        row: (WIDTH,) of the whole trials; where an effect acts for some time only, of the rest of it.
        noise, swing: mean squared errors that noise leaves, and that holding the torque does.
    """
    columns, covariance = two_fits(state.data, state.chosen.effects, state.chosen)
    beyond = max(state.chosen.error - noise, 0.0)
    row = row.copy()
    row[slot("setting", "held")] = NOT_KNOWN  # other logs begin in their own way
    return Then(row, columns, covariance, beyond, swing, state.data.heldout, effects=state.chosen.effects)
