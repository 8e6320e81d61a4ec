"""How far the parameters of one section of the logs differ from those of another, beyond the scatter of their estimates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hqpipe.sysid.excitation import MAX_INFLATION, inflation
from hqpipe.sysid.intervals import uncertainty
from hqpipe.sysid.normal_equations import NormalEquations
from hqpipe.sysid.windows import Windows

SECTION_S = 5.0  # s; assumption: several strides, so that sections differ in more than the phase of the gait
_SHORTEST_S = 2.0  # s; assumption: shorter ones tell more of noise than of the machine
_ONE_WINDOW = 0.5  # share of a section's information in one window beyond which its own scatter cannot be told


@dataclass(frozen=True, eq=False)
class Section:
    """What one section of a trial says about the parameters of one joint.

    Attributes:
        joint, trial: numbers, to tell sections of one from those of another.
        deviation: (P,) from the fit to all sections. covariance: (P, P) of its scatter.
        information: (P,) on each parameter were all noise of one size; unlike the covariance it does not depend on the
            residuals, so that a section does not count more because its residuals happen to be small. 0 tells nothing.
    """

    joint: int
    trial: int
    deviation: np.ndarray
    covariance: np.ndarray
    information: np.ndarray


def sections_of(
    joints: Sequence[NormalEquations],
    windows: Windows,
    x: np.ndarray,
    free: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> list[Section]:
    """Sections of about 5 s, each estimated by a Gauss-Newton step from the fit to all.

    Args:
        joints: normal equations at `x` of each joint that shares the parameters.
        windows: of the fit. x: (P,) its parameters. free: (P,) bool. lower, upper: (P,) bounds.
    """
    found = []
    for joint, at in enumerate(joints):
        for trial, part in _parts(windows):
            section = _section(at, part, x, free, lower, upper)
            if section is not None:
                found.append(Section(joint, trial, *section))
    return found


def between_sections(groups: Sequence[Sequence[Section]], units: Sequence[np.ndarray]) -> np.ndarray | None:
    """(P, P) covariance of what a section is, in units of its group; None where no two can be compared.

    Method of moments for random effects (DerSimonian and Laird 1986), over pairs and in several dimensions: for the
    estimates a and b of two sections, ½ (a − b)(a − b)ᵀ is on average the covariance sought plus the mean covariance of the
    scatter of a and b, which is subtracted. Pairs count by what they know, parameter by parameter; they are of one group, and
    of different trials and joints wherever there are several. What noise makes negative is set to 0, so that the spread
    of equal sections comes out rather too large than too small.

    Args:
        groups: sections of joints that share their parameters. units: (P,) > 0 for each of the groups.
    """
    pairs = [
        (first, second, unit) for group, unit in zip(groups, units, strict=True) for first, second in _pairs(group)
    ]
    if not pairs:
        return None
    size = len(units[0])
    total, weights = np.zeros((size, size)), np.zeros((size, size))
    for a, b, unit in pairs:
        difference, noise = a.deviation - b.deviation, a.covariance + b.covariance
        together = a.information * b.information * unit**2
        precision = np.sqrt(together / np.where(together > 0.0, a.information + b.information, 1.0))
        weight = np.outer(precision, precision)
        total += weight * 0.5 * (np.outer(difference, difference) - noise) / np.outer(unit, unit)
        weights += weight
    return _definite(np.where(weights > 0.0, total / np.where(weights > 0.0, weights, 1.0), 0.0))


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
    """Deviation, covariance and information of one section, by a Gauss-Newton step from the fit to all."""
    own = NormalEquations(0.0, at.hessians[part], at.scores[part])
    told = _told(own, free)
    if not told.any():
        return None
    step = own.step(x, told, lower, upper, 0.0)
    step = np.clip(x + step, lower, upper) - x
    moved = NormalEquations(0.0, own.hessians, own.scores + own.hessians @ step)
    information = np.zeros(len(told))
    information[told] = np.diag(own.hessian)[told] / inflation(own.hessian, told)[told]
    return step, uncertainty(moved, told).covariance, information


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


def _pairs(sections: Sequence[Section]) -> list[tuple[Section, Section]]:
    """Sections to compare: they differ in trial and in joint where there are several of these."""
    trials, joints = len({s.trial for s in sections}), len({s.joint for s in sections})
    return [
        (a, b)
        for a, b in combinations(sections, 2)
        if (trials == 1 or a.trial != b.trial) and (joints == 1 or a.joint != b.joint)
    ]


def _definite(covariance: np.ndarray) -> np.ndarray:
    """The nearest matrix without negative eigenvalues, in units of the deviations; parameters of no variance get none."""
    unit = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(unit > 0.0, unit, 1.0)
    scaled = np.where(np.outer(unit, unit) > 0.0, covariance / np.outer(safe, safe), 0.0)
    values, vectors = np.linalg.eigh(scaled)
    return safe[:, None] * (vectors * np.maximum(values, 0.0)) @ vectors.T * safe
