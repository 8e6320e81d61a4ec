"""How sure an earlier record of a joint is: what two fits of the same machine differ by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hqpipe.gap.estimate import covariance_of
from hqpipe.gap.joint_data import JointData
from hqpipe.gap.set_fit import JointFitter, SetFit


def two_fits(data: JointData, effects: Sequence[str], first: SetFit | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Columns (C,) of a set of effects with the base model, and their covariance (C, C).

    The same set is fitted to the held-out trials too. By what the two fits differ beyond their own noise the model simplifies
    the machine, differently in different motion; it counts in full, once for the record and once for what is compared with it.

    Args:
        data: of the joint, without an earlier record. effects: the set.
        first: its fit to the fit trials; where it is not known, it is made from `data.row`, which then holds the effects.
    """
    if first is None:
        there = replace(JointFitter(data).fit(()), effects=tuple(effects), row=data.row)
        first = JointFitter(data).fit(effects, [there])
    turned = replace(data, fit=data.heldout, heldout=data.fit)
    second = JointFitter(turned).fit(effects, [first])
    own, other = covariance_of(data, first).now, covariance_of(turned, second).now
    if not np.isfinite(own).all():
        return first.free, np.diag(first.row[first.free] ** 2)
    if not np.isfinite(other).all():
        return first.free, own
    apart = second.row[first.free] - first.row[first.free]
    expected = float(apart @ np.linalg.pinv(own + other) @ apart) / max(len(apart), 1)
    beyond = 1.0 - 1.0 / expected if expected > 1.0 else 0.0  # moments: the mean of a χ² is its degrees of freedom
    return first.free, own + beyond * np.outer(apart, apart)
