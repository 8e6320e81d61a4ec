"""Whether the fit depends on the filter, as it does where something of the motion is in no column."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hqpipe.layers.joint_motion.columns import Columns
from hqpipe.layers.joint_motion.first_fit import blocks, robust_fit, standard_errors
from hqpipe.layers.joint_motion.motion import ParallelFilter
from hqpipe.layers.joint_motion.prepared import BLOCK_S, LEAST_SAMPLES, UNDER_CUTOFF, Prepared
from hqpipe.layers.joint_motion.records import Filters, part_of

if TYPE_CHECKING:
    from hqpipe.layers.joint_motion.joint_motion import MovingMachine

SWEEP = (0.6, 1.7)  # of the cut-off, a factor of three apart; assumption: what a filter hides begins within that
STABLE = 0.05  # change over the sweep that is worth a note, as a share of the coefficient and of the rms torque
CHANGED = 3.0  # standard errors of the difference: once in 400 by chance, if errors are normal


def note_sweep(machine: MovingMachine, data: Prepared, notes: list[str]) -> None:
    """Say so if inertia or friction depend on the cut-off."""
    names = ("inertia", "offset", "coulomb", "viscous")
    fit = data.parts[0]
    sizes = np.sqrt(np.mean(fit.columns[np.ix_(fit.keep, data.group(*names))] ** 2, axis=0))
    torque = float(np.std(fit.output[fit.keep]))
    found, errors, lows = [], [], []
    for factor in SWEEP:
        low_pass = ParallelFilter.of(factor * UNDER_CUTOFF * data.band.cutoff, machine.dt)
        own = tuple(data.columns.functions[k] for k in data.group(*names))
        columns = Columns({}, own, np.zeros(0), data.columns.coupling)
        part = part_of(data.records, False, columns, Filters(data.band.cutoff, low_pass), machine.dt, data.mean)
        if len(part.keep) < LEAST_SAMPLES:
            return
        x, y = part.columns[part.keep], part.output[part.keep]
        found.append(robust_fit(x, y))
        block = blocks(part.segment[part.keep], part.time[part.keep], BLOCK_S)
        errors.append(np.sqrt(np.maximum(np.diag(standard_errors(x, y - x @ found[-1], block)), 0.0)))
        lows.append(factor * UNDER_CUTOFF * data.band.cutoff)
    found, errors = ([values[: len(sizes)] for values in each] for each in (found, errors))
    change = np.abs(found[1] - found[0])
    clear = (
        (change > CHANGED * np.hypot(*errors))
        & (change > STABLE * np.abs(found[0]))
        & (change * sizes > STABLE * torque)
    )
    said = [
        f"{name} {found[0][k]:.3g} and {found[1][k]:.3g}"
        for k, name in ((0, "inertia"), (2, "dry friction"), (3, "viscous friction"))
        if clear[k]
    ]
    if said:
        notes.append(
            f"the fit of base, dry and viscous friction depends on the filter ({lows[0]:.2g} and {lows[1]:.2g} Hz: "
            f"{', '.join(said)}): something of these motions is not in it"
        )
