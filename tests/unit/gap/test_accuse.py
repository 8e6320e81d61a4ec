"""The accusation: models before and after, shares, what sensors add."""

from __future__ import annotations

import numpy as np
import pytest
from planted_logs import STEPS, logs_of, size

from hqpipe.effects import EFFECTS
from hqpipe.effects.layout import slot
from hqpipe.gap.accuse import accuse, output_noise, prepare
from hqpipe.gap.set_fit import JointFitter

KEPT = ("command_delay", "valve_lag", "valve_deadband", "flow_saturation", "torque_bias")
WITHOUT = tuple(name for name in EFFECTS if name not in KEPT)


def mean_square(replays):
    return np.mean(np.concatenate([r.targets(r.residual) for r in replays]) ** 2, axis=(0, 1))


@pytest.fixture(scope="module")
def logs():
    return logs_of([size("command_delay", "valve_deadband"), {}, size("command_delay")], seconds=6.0)


@pytest.fixture(scope="module")
def found(logs):
    return accuse(logs, STEPS, WITHOUT)


def test_causes_come_with_their_joints_the_largest_share_first(logs, found):
    assert found.library == KEPT
    assert {(c.effect, c.joints) for c in found.causes} == {
        ("command_delay", (logs.joints[0], logs.joints[2])),
        ("valve_deadband", logs.joints[:1]),
    }
    assert list(found.shrink.each) == sorted(found.shrink.each, reverse=True)
    assert found.shrink.each.sum() == pytest.approx(found.shrink.whole)
    assert found.passing == () and found.spans is None


def test_replays_show_the_gap_before_and_noise_after(found):
    before, after = mean_square(found.heldout), mean_square(found.rest.heldout)
    np.testing.assert_allclose(after, found.floor, rtol=0.3)
    assert (before[[0, 2]] > 10.0 * after[[0, 2]]).all()
    assert before[1] == pytest.approx(after[1])
    for j, state in enumerate(found.states):
        assert before[j] == pytest.approx(state.base.error, rel=1e-6)
        assert after[j] == pytest.approx(state.chosen.error, rel=1e-6)
    whole = 1.0 - np.sqrt((after / found.scale**2).sum() / (before / found.scale**2).sum())
    assert found.shrink.whole == pytest.approx(whole, rel=1e-6)


def test_rows_of_the_machine_hold_what_was_found(found):
    for j, state in enumerate(found.states):
        np.testing.assert_array_equal(found.after.rows[j], state.chosen.row)
        np.testing.assert_array_equal(found.before.rows[j], state.base.row)


def test_noise_of_the_reading_is_measured(logs):
    trials = [t.trajectory for t in logs.trials]
    assert output_noise(trials, 1) == pytest.approx(3.0, rel=0.15)


@pytest.mark.parametrize("flow", [(1.0, 0.0), (0.0, 2.0)])
def test_a_sagging_supply_is_felt_by_speeds_or_by_openings(flow):
    droop = {"supply_droop": {"droop": 0.1, "recovery_s": 0.15}}
    logs = logs_of([droop] * 4, seconds=6.0, flow=flow)
    data, _ = prepare(logs, ("supply_droop",), STEPS, None, None)
    chosen = [d.row[[slot("setting", "flow_per_speed"), slot("setting", "flow_per_opening")]] for d in data]
    assert all((row > 0.0).tolist() == [flow[0] > 0.0, flow[1] > 0.0] for row in chosen)
    assert JointFitter(data[0]).fit(("supply_droop",)).error < 1.2 * 2.0 * 3.0**2
