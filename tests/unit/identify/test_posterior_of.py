"""What may vary in the posterior of a machine, and by how much."""

from __future__ import annotations

import numpy as np

from hqpipe.actuators.posterior import Range
from hqpipe.identify.posterior import Known, posterior_of
from hqpipe.identify.sections import Section

FIELDS = ("a", "b")
LOWER, UPPER = np.zeros(2), np.full(2, np.inf)
SCATTER = np.diag([1e-4, 1e-4])


def known(name, value, told=(True, True), held=(False, False), assumed=None) -> Known:
    """Two sections of different trials that differ by 40 % of 1 in both parameters."""
    value, told, held = np.array(value), np.array(told), np.array(held)
    free = told & ~held
    sections = [
        Section(
            0, trial, value + np.where(free, 0.2 * sign, 0.0), SCATTER, np.where(free, 1e4, 0.0), 0.5 * np.diag(free)
        )
        for trial, sign in enumerate((-1.0, 1.0))
    ]
    scatter = SCATTER * np.outer(free, free)
    return Known((name,), value, told, held, scatter, sections, LOWER, UPPER, assumed or {})


def test_what_lies_between_sections_counts_for_all_joints_but_not_where_a_parameter_is_held():
    posterior = posterior_of("m", FIELDS, [known("hip", [1.0, 1.0]), known("knee", [1.0, 0.0], held=(False, True))])
    hip, knee = (group.covariance for group in posterior.groups)
    assert hip[0, 0] > 0.01 and hip[1, 1] > 0.01
    assert knee[0, 0] > 0.01 and (knee[1] == 0.0).all() and (knee[:, 1] == 0.0).all()
    assert posterior.groups[1].ranges == {}


def test_an_undetermined_parameter_is_drawn_from_the_other_joints_unless_it_is_held():
    others = known("hip", [1.0, 2.0])
    free, held = (known("knee", [1.0, 5.0], (True, False), (False, stays)) for stays in (False, True))
    span = posterior_of("m", FIELDS, [others, free]).groups[1].ranges["b"]
    assert (span.low, span.high) == (2.0, 5.0)
    assert posterior_of("m", FIELDS, [others, held]).groups[1].ranges == {}


def test_an_assumed_range_serves_where_no_joint_tells():
    span = Range(0.0, 3.0, "assumption")
    one = known("hip", [1.0, 0.0], (True, False), assumed={"b": span})
    assert posterior_of("m", FIELDS, [one]).groups[0].ranges == {"b": span}
