"""How far the parameters of one section of the logs differ from those of another, beyond the scatter of their estimates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hqpipe.actuators.posterior import factor
from hqpipe.identify.descent import stepped
from hqpipe.identify.determined import MAX_INFLATION, inflation
from hqpipe.identify.normal_equations import NormalEquations
from hqpipe.identify.uncertainty import uncertainty
from hqpipe.identify.windows import Windows

SECTION_S = 5.0  # s; assumption: several strides, so that sections differ in more than the phase of the gait
_SHORTEST_S = 2.0  # s; assumption: shorter ones tell more of noise than of the machine
_TURNS = 5  # the weights settle in two or three
_ONE_WINDOW = 0.5  # share of a section's information in one window beyond which its own scatter cannot be told


@dataclass(frozen=True, eq=False)
class Section:
    """What one section of a trial says about the parameters of one joint.

    Attributes:
        joint, trial: numbers, to tell sections of one from those of another.
        value: (P,) its estimate. covariance: (P, P) of its scatter.
        information: (P,) on each parameter were all noise of size 1; unlike the covariance it does not depend on the
            residuals, so that a section does not count more because its residuals happen to be small. 0 tells nothing.
        weight: (P, P) by which its parameters enter the fit to all sections of the joint.
    """

    joint: int
    trial: int
    value: np.ndarray
    covariance: np.ndarray
    information: np.ndarray
    weight: np.ndarray


def sections_of(
    joints: Sequence[tuple[np.ndarray, NormalEquations]],
    windows: Windows,
    free: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> list[Section]:
    """Sections of about 5 s, each estimated by a Gauss-Newton step from the fit of its joint.

    Args:
        joints: parameters (P,) of each joint by itself, and the normal equations there.
        windows: of the fit. free: (P,) bool. lower, upper: (P,) bounds.
    """
    found = []
    for joint, (x, at) in enumerate(joints):
        whole = _inverse(at.hessian, free)
        for trial, part in _parts(windows):
            section = _section(at, part, x, free, lower, upper)
            if section is not None:
                found.append(Section(joint, trial, *section, whole @ at.hessians[part].sum(axis=0)))
    return found


def between_sections(
    groups: Sequence[Sequence[Section]], shared: Sequence[np.ndarray], units: Sequence[np.ndarray]
) -> np.ndarray | None:
    """(P, P) covariance of what a section is, in units of its group; None where no two can be compared.

    Method of moments for random effects (DerSimonian and Laird 1986) in several dimensions: for the estimates a and b of two
    sections, ½ (a − b)(a − b)ᵀ is on average the covariance sought plus the mean covariance of the scatter of a and b, which
    is subtracted. Pairs are of one group, and of different trials where there are several; where joints share their
    parameters, what counts is how far each of them is from what they share. Parameter by parameter a pair counts by the
    inverse square of the variance of its difference, which holds the one sought and so is found in turns (DerSimonian and
    Kacker 2007). What noise makes negative is set to 0, so that the spread of equal sections comes out rather too large
    than too small.

    Args:
        groups: sections of joints that share their parameters. shared: (P,) parameters of each group.
        units: (P,) > 0 for each of the groups.
    """
    contrasts = [
        (difference / unit, noise / np.outer(unit, unit), scatter / unit**2)
        for group, centre, unit in zip(groups, shared, units, strict=True)
        for difference, noise, scatter in _contrasts(group, centre)
    ]
    if not contrasts:
        return None
    difference, noise, shape = (np.array(column) for column in zip(*contrasts, strict=True))
    found, told = _outer(difference) - noise, np.isfinite(shape)
    shape = np.where(told, shape, 0.0)
    size = np.diagonal(noise, axis1=1, axis2=2).sum(axis=0, where=told) / np.maximum(shape.sum(axis=0), 1e-300)
    between = np.zeros(found.shape[1:])
    for _ in range(_TURNS):
        variance = np.diag(between) + size * shape
        weight = np.where(told, 1.0 / np.where(told & (variance > 0.0), variance, np.inf), 0.0)
        weights = _outer(weight)
        total = np.maximum(weights.sum(axis=0), 1e-300)
        between = _definite((weights * found).sum(axis=0) / total)
    return between


def of_mean(sections: Sequence[Section], between: np.ndarray) -> np.ndarray:
    """(P, P) covariance that the fit to all trials, or to all sections of a single one, has because these differ.

    0 where joints share their parameters: how far they are from what they share holds it.

    Args:
        sections: of one group. between: (P, P) covariance between them.
    """
    if len({section.joint for section in sections}) > 1:
        return np.zeros_like(between)
    trials = {section.trial for section in sections}
    weights = [sum(s.weight for s in sections if s.trial == trial) for trial in sorted(trials)]
    if len(trials) == 1:
        weights = [section.weight for section in sections]
    return sum((weight @ between @ weight.T for weight in weights), np.zeros_like(between))


def _inverse(hessian: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(P, P) inverse in the free parameters, 0 in the others."""
    found, part = np.zeros_like(hessian), hessian[np.ix_(free, free)]
    unit = np.sqrt(np.maximum(np.diag(part), 1e-300))
    scale = np.outer(unit, unit)
    found[np.ix_(free, free)] = np.linalg.pinv(part / scale, rcond=1e-14, hermitian=True) / scale
    return found


def _contrasts(sections: Sequence[Section], shared: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Differences (P,) whose square is on average the covariance sought plus a noise (P, P) that is proportional to the
    last (P,), infinite where nothing is told."""
    with np.errstate(divide="ignore"):
        known = [(s.value, s.covariance, 1.0 / s.information) for s in sections]
    if len({s.joint for s in sections}) > 1:
        return [(value - shared, covariance, scatter) for value, covariance, scatter in known]
    several = len({s.trial for s in sections}) > 1
    return [
        ((a[0] - b[0]) / np.sqrt(2.0), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2]))
        for (i, a), (j, b) in combinations(enumerate(known), 2)
        if not several or sections[i].trial != sections[j].trial
    ]


def _outer(rows: np.ndarray) -> np.ndarray:
    """(N, P, P) outer product of each row (N, P) with itself."""
    return rows[:, :, None] * rows[:, None, :]


def _parts(windows: Windows) -> list[tuple[int, np.ndarray]]:
    """Trial and windows of every section."""
    length = windows.samples * windows.dt
    found = []
    for trial in np.unique(windows.trial):
        own = np.flatnonzero(windows.trial == trial)
        for part in np.array_split(own, max(1, round(len(own) * length / SECTION_S))):
            if len(part) * length >= _SHORTEST_S:
                found.append((int(trial), part))
    return found


def _section(
    at: NormalEquations,
    part: np.ndarray,
    x: np.ndarray,
    free: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Estimate, covariance and information of one section."""
    own = NormalEquations(0.0, at.hessians[part], at.scores[part])
    told = _told(own, free)
    if not told.any():
        return None
    index = np.flatnonzero(told)
    there = stepped(own.hessian[np.ix_(told, told)], own.gradient[told], x, index, lower, upper, 0.0)
    moved = NormalEquations(0.0, own.hessians, own.scores + own.hessians @ (there - x))
    information = np.zeros(len(told))
    information[told] = np.diag(own.hessian)[told] / inflation(own.hessian, told)[told]
    return there, uncertainty(moved, told).covariance, information


def _told(own: NormalEquations, free: np.ndarray) -> np.ndarray:
    """(P,) which free parameters the section determines, and not by a single window."""
    told = free & (np.diag(own.hessian) > 0.0)
    for _ in range(len(free)):
        worst = np.where(told, np.maximum(inflation(own.hessian, told) / MAX_INFLATION, _largest(own, told)), 0.0)
        if worst.max() < 1.0:
            break
        told[int(np.argmax(worst))] = False
    return told


def _largest(own: NormalEquations, told: np.ndarray) -> np.ndarray:
    """(P,) largest share that a window has in what is known of a parameter, over what is allowed."""
    found = np.zeros(len(told))
    if told.any():
        information = own.hessians[:, told, told]
        found[told] = information.max(axis=0) / information.sum(axis=0) / _ONE_WINDOW
    return found


def _definite(covariance: np.ndarray) -> np.ndarray:
    """The nearest matrix without negative eigenvalues, in units of the deviations; parameters of no variance get none."""
    unit = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    root = factor(np.where(np.outer(unit, unit) > 0.0, covariance, 0.0))
    return root @ root.T
