"""From which size on an effect would be named, and changes that logs would not show."""

from __future__ import annotations

import pytest
from layer_cases import layer_joints, toy

from hqpipe.gap.answer.layer_visible import unseen_changes, visible_from
from hqpipe.identify.identify import identify


def test_an_effect_is_named_above_the_size_that_is_told_and_not_below():
    def found(friction):
        model = toy("hip", 1, coulomb_friction=friction)
        return identify(layer_joints([model])).found[0]

    least = found(0.0).visible["coulomb_friction"]
    assert f"would be named from {least:.2g} N·m on" in visible_from([found(0.0)], "coulomb_friction")
    assert [bool(found(factor * least).causes) for factor in (0.5, 2.0)] == [False, True]


def test_what_would_take_an_unusual_size_is_said():
    model = toy("hip", 1, noise=60.0)
    assert "at a usual size it would not show" in visible_from(identify(layer_joints([model])).found, "spring")


@pytest.mark.parametrize(("noise", "said"), [(0.02, False), (4.0, True)])
def test_changes_that_noise_hides_are_told(noise, said):
    then, now = (toy("hip", seed, noise=noise, coulomb_friction=2.0) for seed in (1, 2))
    (joint,) = identify(layer_joints([now]), reference=layer_joints([then])).found
    assert not joint.causes
    assert bool(unseen_changes(joint)) == said
    assert all("would not show a change of coulomb_friction by" in text for text in unseen_changes(joint))
