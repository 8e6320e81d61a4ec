"""Where a fit begins, on a torque whose limit does nothing until the speed reaches it."""

from __future__ import annotations

import numpy as np
import pytest
from identify.toy_joint import ToyJoint

from hqpipe.identify.model import Effect, Parameter
from hqpipe.identify.prior import prior_odds
from hqpipe.identify.search import Search

LIMIT = 5.0  # rad/s; the joint moves at up to 6.5


class Limited(ToyJoint):
    """Viscous friction is part of the base, and speeds beyond a limit brake no more; the candidate is the limit's inverse."""

    base = (*ToyJoint.base, Parameter("nm_s_per_rad", "N·m·s/rad", 2.0, np.inf))
    effects = (Effect("limit", (Parameter("inverse", "s/rad", 0.0, 0.3, 0.0, np.inf, (1.0,)),)),)

    def __init__(self):
        super().__init__(truth={"viscous_friction": 2.0})
        for part in (self.fit, self.heldout):
            part.output[:] += 2.0 * (self._limited(part.velocity, 1.0 / LIMIT) - part.velocity)

    @staticmethod
    def _limited(speed, inverse):
        return np.clip(speed, -1.0 / inverse, 1.0 / inverse) if inverse > 0.0 else speed

    def error(self, values, heldout=False):
        part, regressors = (self.heldout, self._heldout) if heldout else (self.fit, self._fit)
        inertia, offset, friction, inverse = values
        return inertia * regressors[0] + offset + friction * self._limited(part.velocity, inverse) - part.output


def test_a_fit_begins_where_the_effect_does_something():
    search = Search(Limited(), prior_odds(Limited(), {}, 0))
    (promise,) = search.screening.promises(search.base, "limit")
    assert not np.any(search.screening.change(search.base, promise.start)), (
        "the slope suggests a limit beyond all speeds"
    )
    start = search.screening.start(search.base, promise)
    assert np.any(search.screening.change(search.base, start))
    place = search.screening.places("limit")
    assert promise.start[place] < start[place] <= promise.whole[place]
    assert search.grown_by(search.base, "limit").solution.values[place] == pytest.approx(1.0 / LIMIT, rel=0.02)


def test_a_start_that_does_what_is_promised_stays():
    joint = ToyJoint(truth={"spring": 0.5})
    search = Search(joint, prior_odds(joint, {}, 0))
    promise = search.screening.promises(search.base, "spring")[0]
    assert search.screening.start(search.base, promise) is promise.start
