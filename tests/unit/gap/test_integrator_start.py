"""Offsets that an integrator takes up, told from what it held when the trials began."""

from __future__ import annotations

import numpy as np
import pytest
from planted_logs import data_of, logs_of

from hqpipe.effects.integral_action import wound_up_for
from hqpipe.effects.layout import slot
from hqpipe.gap.integrator_start import Start, tell_offsets, time_held
from hqpipe.gap.joint_state import JointState
from hqpipe.gap.search import JointSearch
from hqpipe.gap.set_fit import JointFitter

INTEGRATOR = {"integral_action": {"ki": 0.3, "limit": 1.0}}
BIAS = {"torque_bias": {"nm": 8.0}}
LIBRARY = ("integral_action", "torque_bias", "position_bias")


def start(error, *, ki=0.2, time=0.0, offset=0.0, extra=0.0):
    """A joint that was held for `time`; what it holds beyond that, and by how much its second trial differs."""
    error = np.array([error, 1.1 * error])
    held = np.array([wound_up_for(e, ki, 0.0, time) for e in error]) + offset + np.array([0.0, extra])
    return Start(held, error, ki, 0.0, torque=5000.0, slight=1.0)


def test_time_is_what_joints_with_different_loads_agree_on():
    errors = (0.03, -0.02, 0.01, 0.002)
    assert time_held([start(e, time=1.5) for e in errors]) == pytest.approx(1.5, rel=0.02)
    assert time_held([start(e, time=1.5, offset=0.004) for e in errors]) == pytest.approx(1.5, rel=0.02)
    one_off = [start(e, time=1.5, offset=0.004 * (e == 0.01)) for e in errors]
    assert time_held(one_off) == pytest.approx(1.5, rel=0.02)
    assert time_held([start(e) for e in errors]) == 0.0


def test_a_longer_time_is_preferred_to_an_offset_that_all_joints_have():
    """Joints that bear alike: errors of 26 and 30 mrad, as far off in what they hold as noise makes them."""
    alike = [start(e, time=0.9, offset=o) for e, o in ((0.026, 2e-4), (0.026, -1e-4), (0.03, -1e-4), (0.03, 0.0))]
    time = time_held(alike)
    assert all(s.agrees(s.offset(time), 0.0) for s in alike)


def test_starts_that_do_not_agree_tell_nothing():
    errors, held = (0.03, -0.02, 0.01, 0.002), (0.01, -0.02, 0.004, 0.015)
    assert time_held([start(e, offset=h) for e, h in zip(errors, held, strict=True)]) is None
    assert time_held([start(e, offset=0.004, extra=0.01) for e in errors]) is None, "from trial to trial"
    assert time_held([start(0.03), start(-0.02)]) is None, "too few"
    assert time_held([start(1e-5, offset=0.02) for _ in errors]) is None, "settled: it holds the load"


def states_of(effects, **kwargs):
    """Joints for which the search named their integrators; their trials begin held against loads."""
    logs, states = logs_of(effects, seconds=6.0, **kwargs), []
    for j in range(len(effects)):
        data = data_of(logs, j)
        for split in (data.fit, data.heldout):
            split.signals.command[split.signals.bounds[:-1]] += 0.02 * (j - 1.5)
        search = JointSearch(JointFitter(data), LIBRARY, 3.0)
        chosen = search.fit(("integral_action",))
        states.append(JointState(search, search.fit(()), chosen, search.with_support(chosen)))
    return states


def test_an_offset_behind_an_integrator_is_told_from_its_start():
    states = states_of([INTEGRATOR, INTEGRATOR | BIAS, INTEGRATOR, INTEGRATOR])
    assert states[1].chosen.error < 1.1 * states[0].chosen.error, "the run of the trials does not show it"
    found = tell_offsets(states)
    assert [found[j] is states[j] for j in range(4)] == [True, False, True, True]
    chosen = found[1].chosen
    assert set(chosen.effects) == {"integral_action", "torque_bias"}
    assert chosen.row[slot("torque_bias", "nm")] == pytest.approx(8.0, rel=0.1)
    assert found[1].first_number("integral_action") == pytest.approx(0.3, rel=0.05)
    assert chosen.error < 1.02 * states[1].chosen.error


def test_no_offset_is_made_up():
    states = states_of([INTEGRATOR] * 3)
    assert all(a is b for a, b in zip(tell_offsets(states), states, strict=True))
    two = states_of([INTEGRATOR | BIAS] * 2)
    assert all(a is b for a, b in zip(tell_offsets(two), two, strict=True)), "too few joints to know the time"
