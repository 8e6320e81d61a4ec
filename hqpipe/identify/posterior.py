"""The posterior of a fit: the scatter of its estimates, what differs between sections, and ranges where logs say nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hqpipe.actuators.posterior import Group, Posterior, Range
from hqpipe.identify.sections import Section, between_sections, of_mean

_LEAST = 0.1  # assumption: a parameter that is nearly 0 in one joint varies there by a share of what it is in others


@dataclass(frozen=True, eq=False)
class Known:
    """What the fit of one group of joints knows of its P parameters.

    Attributes:
        joints: names. value: (P,) as the model holds it. known: (P,) whether the logs determine it.
        held: (P,) whether it stays at `value`, known or not; its rows of `scatter` are 0.
        scatter: (P, P) covariance of the estimate, 0 where not known. sections: what parts of the logs say.
        lower, upper: (P,) physical bounds.
        assumed: parameter → range to draw from where no joint of the machine determines it.
    """

    joints: tuple[str, ...]
    value: np.ndarray
    known: np.ndarray
    held: np.ndarray
    scatter: np.ndarray
    sections: Sequence[Section]
    lower: np.ndarray
    upper: np.ndarray
    assumed: Mapping[str, Range] = field(default_factory=dict)


def posterior_of(model: str, fields: Sequence[str], fits: Sequence[Known]) -> Posterior:
    """The posterior of a whole machine.

    What differs between sections is pooled over the groups, in shares of the parameters: a few sections of one joint tell
    little, those of all joints enough.

    A parameter that the logs of a joint do not determine is drawn uniformly from what it is in the joints that do, and
    from what the model holds for it; where no joint does, from the range `assumed`; where there is none, it stays.
    """
    units = _units(fits)
    shares = between_sections([fit.sections for fit in fits], [fit.value for fit in fits], units)
    groups = []
    for fit, unit in zip(fits, units, strict=True):
        ranges = {}
        for i, name in enumerate(fields):
            if fit.known[i] or fit.held[i]:
                continue
            others = [other.value[i] for other in fits if other.known[i]]
            if others:
                span = [*others, fit.value[i]]
                text = "what the model holds, and what the joints that determine it have"
                ranges[name] = Range(float(min(span)), float(max(span)), text)
            elif name in fit.assumed:
                ranges[name] = fit.assumed[name]
        kept = unit * (fit.known & ~fit.held)
        between = None if shares is None else shares * np.outer(kept, kept)
        scatter = fit.scatter if between is None else fit.scatter + of_mean(fit.sections, between)
        count = len(fit.sections)
        groups.append(Group(fit.joints, fit.value, scatter, between, count, fit.lower, fit.upper, ranges))
    return Posterior(model, tuple(fields), tuple(groups))


def _units(fits: Sequence[Known]) -> list[np.ndarray]:
    """(P,) sizes that count as one: the parameters, but no less than a tenth of their median over the groups."""
    values = np.abs([fit.value for fit in fits])
    known = np.array([fit.known for fit in fits])
    least = [
        _LEAST * np.median(column[told]) if told.any() else 0.0 for column, told in zip(values.T, known.T, strict=True)
    ]
    sizes = [np.maximum(value, least) for value in values]
    return [np.where(size > 0.0, size, 1.0) for size in sizes]
