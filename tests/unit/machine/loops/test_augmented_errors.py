"""What a change of a number makes necessary in the windows of a log."""

from __future__ import annotations

import numpy as np
import pytest
from augmented_rows import planted, row, signals_of

from hqpipe.machine.layout import FIELDS
from hqpipe.machine.loops.augmented_columns import ALL
from hqpipe.machine.loops.augmented_errors import CHANGES
from hqpipe.machine.loops.augmented_signals import make_work
from hqpipe.machine.loops.augmented_windows import simulate


@pytest.mark.parametrize("column", [i for i, (owner, _) in enumerate(FIELDS) if owner != "setting"])
def test_what_a_change_makes_necessary_is_enough(column):
    """The fit computes anew only what `CHANGES` says; anything more would make its slopes wrong."""
    owner, name = FIELDS[column]
    signals = signals_of("valve_lag")
    begin = row({k: v for k, v in planted.TYPICAL.items() if k != "integral_action"})
    moved = begin.copy()
    moved[column] = begin[column] * 1.01 if begin[column] else 1e-3
    work = make_work(signals)
    partly, anew = np.empty((2, signals.steps, len(signals.first)))
    simulate(begin, signals, work, partly, ALL)
    simulate(moved, signals, work, partly, CHANGES[column])
    simulate(moved, signals, make_work(signals), anew, ALL)
    np.testing.assert_allclose(partly, anew, atol=1e-9, err_msg=f"{owner} {name}")
