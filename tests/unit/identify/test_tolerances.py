"""What is known to within a tolerance moves the numbers of an answer, and leaves them as unsure as the errors leave it."""

from __future__ import annotations

import numpy as np
import pytest
from identify.toy_joint import ToyJoint

from hqpipe.identify.beside import rank_beside
from hqpipe.identify.intervals import corrected, half_widths
from hqpipe.identify.prior import prior_odds
from hqpipe.identify.search import Search

DEVIATION, FRICTION = 0.05, 0.3


class Uneven(ToyJoint):
    """A joint with friction, and something that is known to within `DEVIATION`: it does what friction does, and `own` times
    more besides."""

    def __init__(self, deviations, own):
        super().__init__(truth={"coulomb_friction": FRICTION}, seed=3)
        self.does = np.sign(self.fit.velocity) + own * np.sin(7.0 * self.fit.position)
        self.fit.output[:] += deviations * DEVIATION * self.does

    def tolerances(self, values):
        return DEVIATION * self.does[:, None]


def friction_of(model):
    """The number as it is fitted and as it is told, and its half widths without and with the tolerance."""
    search = Search(model, prior_odds(model, {}, 0))
    known = search.grown_by(search.base, "coulomb_friction")
    rank_beside(search, known)
    index = int(search.screening.places("coulomb_friction")[0])
    place = int(np.flatnonzero(known.solution.free == index)[0])
    values, half = corrected(search, known)
    return known.solution.values[index], values[index], half_widths(search, known)[place], half[place]


def test_what_the_errors_show_of_it_is_taken_out_of_the_number():
    fitted, told, _, half = friction_of(Uneven(1.2, own=1.0))
    assert fitted - FRICTION > 0.04
    assert told == pytest.approx(FRICTION, abs=0.01) and abs(told - FRICTION) < half < 0.03


def test_what_the_errors_do_not_show_of_it_widens_the_interval():
    fitted, told, without, half = friction_of(Uneven(1.0, own=0.0))
    assert told == pytest.approx(fitted, abs=1e-3)
    assert half == pytest.approx(np.hypot(without, 1.96 * DEVIATION), rel=0.01)


def test_it_is_never_taken_to_be_beyond_its_limits():
    fitted, told, *_ = friction_of(Uneven(6.0, own=1.0))
    assert fitted - told < 1.05 * np.sqrt(3.0) * DEVIATION


def test_a_model_without_tolerances_tells_what_is_fitted():
    fitted, told, without, half = friction_of(ToyJoint(truth={"coulomb_friction": FRICTION}, seed=3))
    assert (fitted, without) == (told, half)
