"""What several joints of a machine change at once: effects that join, leave, or take the place of others.

Joints that are searched one after the other go by what the others have just then. Where half of them were given a delay of the
command and half one of the valve, no single joint is better off with the other name, though all together may be. So the same
step is weighed in all joints that can take it: what their logs say adds up, and the prior knows how many have each effect.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.identify.model import JointModel
from hqpipe.identify.prior import log_prior

_MOST = 24  # steps of a machine; assumption: what still changes then is a draw
_LEAST = 1e-6  # ln: a step that gains less is one of rounding

Names = frozenset[str]


@dataclass(frozen=True)
class Step:
    """An effect that leaves the set of a joint and one that joins it; None for none of these."""

    leaves: str | None
    joins: str | None

    def of(self, names: Names) -> Names:
        """The set after it."""
        return (names - {self.leaves}) | ({self.joins} - {None})


Worths = Mapping[Step, float]
"""ln of how much more probable the logs of a joint are after a step than before it, the prior of the effects left aside."""


def best_step(
    models: Sequence[JointModel], present: Sequence[Names], worths: Sequence[Worths]
) -> tuple[Step, list[int]]:
    """The step, and the joints that take it, which make all logs together the most probable; no joints where none does.

    Args:
        models: (J,) present: (J,) effects of each joint. worths: (J,) the steps that it may take.
    """
    count = Counter(name for names in present for name in names)
    joints_of: dict[Step, list[tuple[float, int]]] = {}
    for j, steps in enumerate(worths):
        for step, worth in steps.items():
            if np.isfinite(worth):
                joints_of.setdefault(step, []).append((worth, j))
    best: tuple[float, Step, list[int]] = (_LEAST, Step(None, None), [])
    for step, able in joints_of.items():
        able.sort(key=lambda pair: (-pair[0], pair[1]))
        taken = np.arange(1, len(able) + 1)
        gain = np.cumsum([worth for worth, _ in able])
        for name, sign in ((step.leaves, -1), (step.joins, 1)):
            if name is not None:
                gain = gain + _prior_change(models, name, count[name], sign * taken)
        k = int(np.argmax(gain))
        if gain[k] > best[0]:
            best = float(gain[k]), step, sorted(j for _, j in able[: k + 1])
    return best[1], best[2]


def _prior_change(models: Sequence[JointModel], name: str, count: int, change: np.ndarray) -> np.ndarray:
    model, effect = next((m, e) for m in models for e in m.effects if e.name == name)
    return log_prior(model, effect, count + change, len(models)) - log_prior(
        model, effect, np.array(count), len(models)
    )


def others_of(present: Sequence[Names], j: int) -> list[Names]:
    """The effects of all joints but one."""
    return [*present[:j], *present[j + 1 :]]


def settled_together(
    models: Sequence[JointModel],
    present: Sequence[Names],
    worths: Sequence[Worths],
    moved: Callable[[Mapping[int, tuple[Step, list[Names]]]], Mapping[int, tuple[Names, Worths]]],
) -> list[Names]:
    """The effects of each joint when no step of any number of joints makes the logs more probable.

    Args:
        models, present, worths: see `best_step`. moved: number of a joint → the step that it takes and the effects of the other
            joints after it, to its set and the steps from there.
    """
    present, worths = list(present), list(worths)
    undone: set[tuple[int, Step]] = set()  # steps that joints took back, until another joint changes
    for _ in range(_MOST):
        open_ones = [{s: w for s, w in steps.items() if (j, s) not in undone} for j, steps in enumerate(worths)]
        step, joints = best_step(models, present, open_ones)
        if not joints:
            break
        after = [step.of(names) if j in joints else names for j, names in enumerate(present)]
        before = list(present)
        asked = {j: (step, others_of(after, j)) for j in joints}
        for j, (names, steps) in moved(asked).items():
            present[j], worths[j] = names, steps
        undone = undone | {(j, step) for j in joints} if present == before else set()
    return present
