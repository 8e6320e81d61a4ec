"""What a change of a number makes necessary in the windows of a log, and what is kept of earlier runs."""

from __future__ import annotations

import numpy as np
import pytest
from machine.augmented_rows import planted, row, signals_of
from numba.core.errors import TypingError

from hqpipe.machine.chain import loops
from hqpipe.machine.layout import FIELDS, slot


def filled(p, signals, work):
    out = np.empty((signals.steps, len(signals.first)))
    loops().fill_errors(p, signals, work, out)
    return out


def computed(p, work):
    """How many steps along the log a row asks for; they are then taken for made."""
    return int(loops().arranged(p, work, {})[0].sum())


@pytest.mark.parametrize("column", range(len(FIELDS)))
def test_what_a_change_makes_necessary_is_enough(column):
    """The fit computes anew only what differs from what is kept; anything less would make its slopes wrong."""
    owner, name = FIELDS[column]
    signals = signals_of("valve_lag")
    begin = row(planted.TYPICAL)
    begin[slot("viscous_friction", "behind_piston")] = 0.1
    moved = begin.copy()
    moved[column] = begin[column] * 1.01 if begin[column] and np.isfinite(begin[column]) else 1e-3
    work = loops().make_work(signals)
    for p in (begin, moved, begin):
        anew = filled(p, signals, loops().make_work(signals))
        np.testing.assert_array_equal(filled(p, signals, work), anew, err_msg=f"{owner} {name}")


def test_a_change_of_the_law_alone_leaves_what_runs_along_the_log_as_it_is():
    sizes = {name: planted.TYPICAL[name] for name in ("command_delay", "valve_lag", "orifice_flow", "valve_deadband")}
    begin = row(sizes)
    work = loops().make_work(signals_of("valve_lag"))
    whole = computed(begin, work)
    for owner, name in (("base", "k1"), ("base", "k2"), ("base", "k4"), ("orifice_flow", "effort_max_nm")):
        moved = begin.copy()
        moved[slot(owner, name)] *= 1.01
        assert computed(moved, work) == 0, name
    moved = begin.copy()
    moved[slot("valve_deadband", "half_width")] *= 1.01
    alone = computed(moved, work)
    moved[slot("command_delay", "delay_s")] *= 1.01
    assert 0 < alone < computed(moved, work) <= whole


def test_what_a_difference_moved_costs_nothing_to_put_back():
    begin = row({name: planted.TYPICAL[name] for name in ("command_delay", "valve_lag", "valve_deadband")})
    work = loops().make_work(signals_of("valve_lag"))
    computed(begin, work)
    for owner, name in (("command_delay", "delay_s"), ("valve_lag", "time_constant_s"), ("command_delay", "delay_s")):
        moved = begin.copy()
        moved[slot(owner, name)] *= 1.01
        assert computed(moved, work) > 0, name
        assert computed(begin, work) == 0, name


def test_nothing_is_kept_of_a_run_that_failed():
    begin, signals = row({"valve_lag": planted.TYPICAL["valve_lag"]}), signals_of("valve_lag")
    work = loops().make_work(signals)
    with pytest.raises(TypingError):
        loops().fill_errors(begin, signals, work, None)
    out = filled(begin, signals, work)
    np.testing.assert_array_equal(out, filled(begin, signals, loops().make_work(signals)))
