"""Two records of one joint with one machine around it: what the other joints do is the same in both."""

from __future__ import annotations

import numpy as np

from hqpipe.layers.joint_motion.coupling import Nuisance, Predicted, ridge_of, term_sizes
from hqpipe.layers.joint_motion.instruments import projected
from hqpipe.layers.joint_motion.model import MotionModel
from hqpipe.layers.joint_motion.prepared import BASE, FRICTION


class TwoRecords:
    """Errors of a joint in two records, less what the other joints may do with one set of coefficients for both.

    With coefficients of its own each record would put its mean posture into inertia and gravity, and another posture would look
    like a payload.
    """

    def __init__(self, then: MotionModel, now: MotionModel) -> None:
        self.then, self.now = then, now
        rows = [_rows(then, False), _rows(now, False), _rows(now, True)]
        base = np.concatenate([b for _, b, _, _ in rows[:2]])
        terms = np.concatenate([t for t, _, _, _ in rows[:2]])
        held = projected(terms, base)
        terms, later = terms - base @ held, rows[2][0] - rows[2][1] @ held
        size = term_sizes(terms, later)
        terms, later = terms / size, later / size
        (_, _, first, one), (_, _, second, two) = rows[:2]
        own = np.zeros((len(one) + len(two), first.shape[1] + second.shape[1]))  # what is its own may have changed
        own[: len(one), : first.shape[1]], own[len(one) :, first.shape[1] :] = first, second
        ridge = ridge_of(terms, own, np.concatenate([one, two])) if terms.size else 1.0
        self._fit, self._later = Nuisance.of(terms, ridge), Predicted.of(terms, later, ridge)

    def error(self, then: np.ndarray, now: np.ndarray, heldout: bool) -> np.ndarray:
        """(N,) of the earlier and the later record, or of the held-out samples of the later one.

        Args:
            then, now: values of each record, in the order of its model.
        """
        errors = np.concatenate([self.then.own_error(then, False), self.now.own_error(now, False)])
        return self._later.left(self.now.own_error(now, True), errors) if heldout else self._fit.left(errors)


def _rows(model: MotionModel, heldout: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Terms of the other joints, columns of the base, of base and friction, and torque of the samples that are judged."""
    part, columns = model.measured[heldout], model.columns
    kept = part.columns[part.keep]
    base, own = ([k for name in names for k in columns[name]] for names in (BASE, (*BASE, *FRICTION, "stribeck")))
    return kept[:, list(columns["coupling"])], kept[:, base], kept[:, own], part.output[part.keep]
