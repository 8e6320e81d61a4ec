from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest


@pytest.mark.parametrize(("speed", "expected"), [(0.0, 0.2), (0.075, 0.6), (0.15, 1.0), (1.0, 1.0)])
def test_actions_shrink_with_the_command_when_standing_is_near(spec, speed, expected):
    gait = replace(spec.gait, prior="none", standing_speed=0.15)
    rule = replace(spec, gait=gait, standing_scale=0.2).target_rule()
    command = np.array([[0.0, 0.0, speed], [speed, 0.0, 0.0]])
    offset = rule.unclipped(np.ones((2, 12)), None, command) - rule.nominal
    np.testing.assert_allclose(offset, expected * spec.action_scale, atol=1e-5)


def test_actions_count_in_full_at_every_command_by_default(spec):
    rule = replace(spec, gait=replace(spec.gait, prior="none")).target_rule()
    offset = rule.unclipped(np.ones((1, 12)), None, np.zeros((1, 3))) - rule.nominal
    np.testing.assert_allclose(offset, spec.action_scale, atol=1e-12)
