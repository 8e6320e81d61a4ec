"""What is no change since an earlier record: differences that two looks at the same machine have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hqpipe.gap.causes import assemble
from hqpipe.gap.changes import FACTORS
from hqpipe.gap.estimate import certainty, covariance_of
from hqpipe.gap.joint_data import Then
from hqpipe.gap.joint_state import JointState
from hqpipe.gap.replay import Replay, persistence_error
from hqpipe.gap.set_fit import JointFitter, SetFit
from hqpipe.gap.worth import bare, take_back

FAMILIAR = 1.25  # on the error that the record left on its own logs: other motion, other error; assumption
CLEAR = 2.0  # standard errors from which the earlier trials themselves show a "change"; assumption
LACKS = 2.0  # squared error over the noise from which a record lacked effects when it was made; assumption
AS_THEN = "the reference missed its own logs by as much"
REASON = "differs from the reference by no more than two fits of the same machine do"


def familiar_error(states: Sequence[JointState], heldout: Sequence[Replay]) -> np.ndarray:
    """(J,) mean squared error beyond the noise that the record's model may have without anything having changed.

    What it left on its own logs, in proportion to how much the torque moves in these; 0 without a record.
    """
    swing, found = persistence_error(heldout), np.zeros(len(states))
    for j, state in enumerate(states):
        then = state.data.then
        if then is not None:
            found[j] = FAMILIAR * then.familiar * (swing[j] / then.swing if then.swing else 1.0)
    return found


def only_needed(states: list[JointState], noise: np.ndarray, familiar: np.ndarray) -> list[JointState]:
    """Without names for what the record missed when it was made.

    A joint that errs as it did has not changed. Of one that errs more, beside a record that lacked effects, the smallest set
    is taken that brings it back to what it was: what would close the rest was lacking then.

    Args:
        noise: (J,) mean squared error that noise leaves. familiar: (J,) the same of a record without any change.
    """
    found = []
    for state, level, known in zip(states, noise, familiar, strict=True):
        if state.data.then is not None and state.chosen.effects:
            back = [fit for fit in state.search.tried if fit.error <= known]
            if state.base.error <= known:
                state = bare(state, AS_THEN)
            elif known > LACKS * level and back:
                state = state.choose(
                    min(back, key=lambda fit: (len(fit.effects), _unknown_then(fit, state.data.then), fit.error))
                )
        found.append(state)
    return found


def _unknown_then(fit: SetFit, then: Then) -> int:
    """Effects of a set that the record did not have: these it may have lacked."""
    return sum(name not in FACTORS and name not in then.effects for name in fit.effects)


def drop_unchanged(states: list[JointState], floor: np.ndarray) -> list[JointState]:
    """Take back the names of differences that are not clear of what is uncertain about the record, the weakest first.

    Args:
        states: one per joint. floor: (J,) mean squared error that is no change.
    """
    if all(state.data.then is None for state in states):
        return states
    while True:
        found = {state.joint: state for state in states}
        unclear = []
        for cause in assemble(states, floor):
            members = [found[joint] for joint in cause.joints]
            sure = [certainty(s.data, s.chosen, cause.effect, _shown_before(s)) for s in members]
            z = float(np.sum(sure) / np.sqrt(len(sure)))
            if z < members[0].search.significance:
                unclear.append((z, cause))
        if not unclear:
            return states
        take_back(min(unclear, key=lambda item: item[0])[1], found, REASON)
        states = list(found.values())


def _shown_before(state: JointState) -> dict[int, float]:
    """Place among the free numbers → what the earlier held-out trials show of it, where they show anything clearly.

    The same question as of the new logs, asked of trials in which nothing had changed.
    """
    then = state.data.then
    if then.heldout is None:
        return {}
    data = replace(state.data, fit=then.heldout)
    fit = JointFitter(data).fit(state.chosen.effects, [state.chosen])
    covariance = covariance_of(data, fit)
    deviations = np.sqrt(np.maximum(np.diag(covariance.now), 0.0))
    clear = np.abs(covariance.values - covariance.then) > CLEAR * deviations
    return {int(at): float(covariance.values[at]) for at in np.flatnonzero(clear)}
