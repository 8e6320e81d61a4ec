"""Joint order by name, and the sample time that the coefficients belong to."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.stiff_pd import StiffPD
from hqpipe.errors import UsageError


def hydraulic(**changes):
    values = {"k1": [1.0, 2.0, 3.0], "k2": 0.02, "k3": 0.0, "k4": 0.0, "sprocket_radius": 1.0}
    return Hydraulic.build(("a", "b", "c"), **({"dt": 0.001, "effort_limit": np.inf} | values | changes))


def test_joints_are_matched_by_name():
    model = hydraulic()
    reordered = model.for_joints(("c", "a"))
    assert reordered.joints == ("c", "a")
    np.testing.assert_array_equal(reordered.column("k1"), [3.0, 1.0])
    with pytest.raises(UsageError, match="no joint 'd'"):
        model.for_joints(("a", "d"))


def test_steps_only_at_its_own_sample_time():
    model = hydraulic()
    zeros = np.zeros((1, 3))
    state = (zeros.copy(), model.fresh_memory(1), zeros, zeros, zeros)
    model.step(*state, dt=0.001001)
    with pytest.raises(UsageError, match=r"per sample of 0\.001 s and cannot be stepped at 0\.01 s.*100 Hz"):
        model.step(*state, dt=0.01)
    StiffPD.build(("a",), kp=1.0, kd=0.0, effort_limit=np.inf).check_dt(0.37)


def test_parameters_cannot_be_changed_in_place():
    source = np.tile([1.0, 0.5, 0.0, 0.0, 1.0, 10.0], (2, 1))
    model = Hydraulic(("a", "b"), source, 0.001)
    with pytest.raises(ValueError, match="read-only"):
        model.parameters[0, 0] = 5.0
    source[0, 0] = 9.0
    assert model.parameters[0, 0] == 1.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"k2": 1.01}, "k2 of joint a is 1.01"),
        ({"k1": -1.0}, "k1 of joint a is -1.0"),
        ({"k1": np.nan}, "k1 of joint a is nan"),
        ({"k3": np.inf}, "k3 of joint a is inf"),
        ({"dt": None}, "dt is None"),
        ({"sprocket_radius": 0.0}, "sprocket_radius of joint a"),
        ({"k_1": 0.0}, "unknown parameter 'k_1' – did you mean 'k1'"),
    ],
)
def test_nonsense_is_refused(changes, words):
    with pytest.raises(UsageError, match=words):
        hydraulic(**changes)
