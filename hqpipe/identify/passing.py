"""Effects that act for a part of each trial only: a filter that clogs, a valve that warms, a cable that slips.

Where effects over whole trials leave joints unexplained, each trial is cut into one stretch of time with large errors and the
rest. If the base, fitted to the rest, is nearly right there, the joints are searched again with effects that act in the stretch
alone. The fit trials decide; the held-out ones get a stretch from their own errors, in which the effects are then judged.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hqpipe.identify.found import Fitted, JointFound
from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.model import JointModel, all_parameters, positions
from hqpipe.identify.stretches import LEAST_OUTSIDE, Shown, Stretches, inside, near_ends, stretches_of
from hqpipe.identify.thresholds import HALVED, LEAST_GAIN, QUIET

UNEXPLAINED = LEAST_OUTSIDE
"""Of the squared error of a joint, from which on a stretch is looked for. An effect that acts for a share s of the time, taken
for a lasting one of s of its size, leaves 1 − s of its squares, and s is at most 1 − LEAST_OUTSIDE."""
ROUNDS = 3  # of cutting and fitting the rest again; assumption: a stretch that still moves then has no clear ends

Searched = Callable[[Sequence[JointModel]], tuple[JointFound, ...]]


class PassingJoint:
    """A joint whose effects act inside stretches of time; what the rest of the machine does to it acts always.

    Samples of the fit within a window of an end of a stretch are left out: when in it the effects set in is not known.
    All else but the notes is that of the joint itself.
    """

    def __init__(self, model: JointModel, fit: Stretches, heldout: Stretches, window_s: float) -> None:
        """Args:
        fit, heldout: file → stretch of the trials of each split, s. window_s: see `LayerJoints`.
        """
        self.model = model
        kept = ~near_ends(model.fit, fit, window_s)
        self.fit = model.fit.only(kept)
        self._kept = kept, np.ones(len(model.heldout.time), dtype=bool)
        self._inside = tuple(
            inside(part, stretches, model.dt) for part, stretches in ((self.fit, fit), (model.heldout, heldout))
        )
        lasting = [effect.name for effect in model.effects if effect.context or effect.in_both]
        self._always = positions(model, lasting)
        self._neutral = np.array([parameter.neutral for parameter in all_parameters(model)], dtype=np.float64)
        self._last: dict[bool, tuple[bytes, np.ndarray]] = {}
        self.notes = (*model.notes, f"its causes act for some time only: {_in_words(heldout or fit)}")

    def __getattr__(self, name: str) -> Any:
        if name == "model":  # before __init__, as when it is copied
            raise AttributeError(name)
        return getattr(self.model, name)

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        """(N,) that of the joint inside the stretches, and that of its base outside."""
        here, base = self._inside[heldout], self._neutral.copy()
        base[self._always] = values[self._always]
        outside = self._base_error(base, heldout)
        if np.array_equal(base, values):
            return outside.copy()
        return np.where(here, self._error(values, heldout), outside)

    def _error(self, values: np.ndarray, heldout: bool) -> np.ndarray:
        return self.model.error(values, heldout)[self._kept[heldout]]

    def _base_error(self, values: np.ndarray, heldout: bool) -> np.ndarray:
        """The last one is kept: differences along effects do not change it."""
        key = values.tobytes()
        last = self._last.get(heldout)
        if last is None or last[0] != key:
            last = self._last[heldout] = key, self._error(values, heldout)
        return last[1]


def modelled(joint: JointFound) -> Fitted:
    """The set of a simulator's model: that of the causes, or of the base where they act for some time only."""
    return joint.base if isinstance(joint.model, PassingJoint) else joint.named


def with_passing(found: Sequence[JointFound], window_s: float, searched: Searched) -> tuple[JointFound, ...]:
    """The answers, with those of passing effects in place of lasting ones where these are far better.

    Passing effects have the ends of the stretches as numbers of their own. So they have to leave at most half of what lasting
    ones leave, in a joint and over the machine.

    Args:
        found: of each joint, with lasting effects. window_s: see `LayerJoints`. searched: the search over joint models.
    """
    found = tuple(found)
    asking = [joint for joint in found if joint.unexplained > UNEXPLAINED and np.isfinite(joint.base.error).all()]
    if not asking:
        return found
    cut = _cut(asking, window_s)
    if cut is None:
        return found
    with_rest = [joint for joint in found if joint.unexplained > LEAST_GAIN or not joint.causes]
    quiet = [joint for joint in with_rest if _is_quiet(joint, cut[0])]
    if not any(joint in asking for joint in quiet):
        return found
    again = searched([PassingJoint(joint.model, *cut, window_s) for joint in quiet])
    better = {
        joint.model.joint: passing
        for joint, passing in zip(quiet, again, strict=True)
        if passing.causes and passing.unexplained <= HALVED * joint.unexplained
    }
    chosen = tuple(better.get(joint.model.joint, joint) for joint in found)
    left, lasting = (sum(joint.unexplained for joint in answers) for answers in (chosen, found))
    return chosen if better and left <= HALVED * lasting else found


def _cut(asking: Sequence[JointFound], window_s: float) -> tuple[Stretches, Stretches] | None:
    """Stretches of the fit and of the held-out trials; None where the fit trials show none."""
    errors = [(joint.base.error, joint.base.heldout) for joint in asking]
    fit: Stretches = {}
    heldout: Stretches = {}
    for _ in range(ROUNDS):
        before = fit, heldout
        fit, heldout = (
            stretches_of([_shown(j, e[split], split) for j, e in zip(asking, errors, strict=True)], window_s)
            for split in (0, 1)
        )
        if not fit:
            return None
        if (fit, heldout) == before:
            break
        errors = [_fitted_outside(joint, fit)[1:] for joint in asking]
    return fit, heldout


def _shown(joint: JointFound, error: np.ndarray, split: int) -> Shown:
    model = joint.model
    return Shown((model.fit, model.heldout)[split], error, model.noise[split], model.dt)


class _Outside:
    """A joint that is judged outside of stretches only."""

    def __init__(self, model: JointModel, inside: np.ndarray) -> None:
        self.model, self.inside = model, inside

    def __getattr__(self, name: str) -> Any:
        return getattr(self.model, name)

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        return np.where(self.inside, 0.0, self.model.error(values))


def _fitted_outside(joint: JointFound, fit: Stretches) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N,) bool inside the stretches, and the errors of the fit and the held-out trials with the base fitted outside."""
    model = joint.model
    here = inside(model.fit, fit, model.dt)
    fitter = Fitter(_Outside(model, here))
    values = fitter.fit(positions(model, joint.base.effects), [joint.base.values], model.noise[0] ** 2).values
    return here, model.error(values), model.error(values, True)


def _is_quiet(joint: JointFound, fit: Stretches) -> bool:
    """Whether nearly all of the error above the noise lies inside."""
    if not np.isfinite(joint.base.error).all():
        return False
    here, error, _ = _fitted_outside(joint, fit)
    if here.all() or not here.any():
        return False
    within, outside = (float(np.mean(error[part] ** 2)) - joint.model.noise[0] ** 2 for part in (here, ~here))
    return within > 0.0 and outside <= QUIET * within


def _in_words(stretches: Mapping[str, tuple[float, float]]) -> str:
    return ", ".join(f"{start:.3g} to {end:.3g} s of {file}" for file, (start, end) in stretches.items())
