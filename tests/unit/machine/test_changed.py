"""What a change of a number makes necessary in the windows of a log."""

from __future__ import annotations

import numpy as np
import pytest
from machine.augmented_rows import planted, row, signals_of

from hqpipe.machine.chain import loops
from hqpipe.machine.layout import FIELDS, slot


def filled(p, signals, work, before):
    out = np.empty((signals.steps, len(signals.first)))
    loops().fill_errors(p, signals, work, out, loops().changed(before, p))
    return out


@pytest.mark.parametrize("column", range(len(FIELDS)))
def test_what_a_change_makes_necessary_is_enough(column):
    """The fit computes anew only what `changed` says; anything less would make its slopes wrong."""
    owner, name = FIELDS[column]
    signals = signals_of("valve_lag")
    begin = row(planted.TYPICAL)
    begin[slot("viscous_friction", "behind_piston")] = 0.1
    moved = begin.copy()
    moved[column] = begin[column] * 1.01 if begin[column] and np.isfinite(begin[column]) else 1e-3
    work = loops().make_work(signals)
    filled(begin, signals, work, None)
    partly, anew = filled(moved, signals, work, begin), filled(moved, signals, loops().make_work(signals), None)
    np.testing.assert_array_equal(partly, anew, err_msg=f"{owner} {name}")


def test_a_change_of_the_law_alone_leaves_what_runs_along_the_log_as_it_is():
    sizes = {name: planted.TYPICAL[name] for name in ("command_delay", "valve_lag", "orifice_flow", "valve_deadband")}
    begin = row(sizes)
    for owner, name in (("base", "k1"), ("base", "k2"), ("base", "k4"), ("orifice_flow", "effort_max_nm")):
        moved = begin.copy()
        moved[slot(owner, name)] *= 1.01
        assert not loops().changed(begin, moved).any(), name
    moved = begin.copy()
    moved[slot("valve_deadband", "half_width")] *= 1.01
    alone = loops().changed(begin, moved).sum()
    moved[slot("command_delay", "delay_s")] *= 1.01
    assert 0 < alone < loops().changed(begin, moved).sum()
