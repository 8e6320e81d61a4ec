"""Effects that numbers of others imply: a soft link between piston and joint, by the travel in which friction turns round.

A search leaves these numbers free, as they belong to what it finds. An effect is implied where they are beyond what a sound
machine has. Then the answer is given once more, with a model that keeps the numbers within and with the effect among its
candidates, so that it is a cause by the same rules as any other. It is told where all other causes stay.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from hqpipe.identify.found import JointFound
from hqpipe.identify.joint_answer import answer
from hqpipe.identify.prior import MOST_JOINTS
from hqpipe.identify.search import Known, Names, Search


class Asked(NamedTuple):
    """An answer of a joint to be weighed once more.

    Attributes:
        kept: effects of its set. causes: it names. shared, rare: see `hqpipe.identify.search.Search`.
    """

    kept: Names
    causes: Names
    shared: Names
    rare: Names


class Implied(NamedTuple):
    """The answer of a joint with what it implies, and the search and the set that it comes from.

    Attributes:
        effects: that are implied.
    """

    effects: Names
    search: Search
    known: Known
    found: JointFound


def with_implied(
    answers: Sequence[JointFound],
    shared: Names,
    weighed: Callable[[Mapping[int, Asked]], Mapping[int, JointFound | None]],
) -> list[JointFound]:
    """The answers of a machine's joints, with the effects that they imply. More has to speak for one that most joints do not
    have.

    Args:
        answers: of each joint. shared: causes that most joints of the machine have. weighed: number of a joint → what is asked,
            to its answer with what it implies; None where it implies nothing, or where that is no cause beside the others.
    """

    def asked(joint: JointFound, added: Names, usual: Names) -> Asked:
        causes = _causes(joint)
        rare = (causes | added) - shared - usual if len(answers) > 1 else frozenset()
        return Asked(frozenset(joint.kept.effects), causes, shared | usual, rare)

    nothing: Names = frozenset()
    first = weighed({j: asked(joint, nothing, nothing) for j, joint in enumerate(answers) if joint.causes})
    told = {j: found for j, found in first.items() if found is not None}
    new = {j: _causes(found) - _causes(answers[j]) for j, found in told.items()}
    count = Counter(name for names in new.values() for name in names)
    usual = frozenset(name for name, joints in count.items() if joints > MOST_JOINTS * len(answers))
    again = {j: asked(answers[j], names, usual) for j, names in new.items() if names - usual and len(answers) > 1}
    told |= weighed(again)
    return [told.get(j) or joint for j, joint in enumerate(answers)]


def implied_answer(search: Search, asked: Asked) -> Implied | None:
    """The answer of a finished search with what it implies; None where that is nothing, or no cause beside the others."""
    kept = search.known[asked.kept]
    # Of its class: a model that wraps another one has other numbers than that.
    implied = getattr(type(search.model), "implied", None)
    values = None if implied is None else implied(search.model, kept.solution.values)
    if values is None:
        return None
    limited = Search(search.model.limited(), search.odds, limited=True)
    limited.barred |= search.barred - {name for name, effect in limited.effects.items() if effect.implied}
    limited.refused |= search.refused
    limited.given_up |= search.given_up
    limited.shared, limited.rare = asked.shared, asked.rare
    told = frozenset(n for n, effect in limited.effects.items() if effect.implied and _is_moved(limited, values, n))
    known = limited.begun_from(kept.names | told, values)
    found = answer(limited, known)
    return Implied(told, limited, known, found) if _causes(found) == asked.causes | told else None


def _is_moved(search: Search, values: np.ndarray, name: str) -> bool:
    places = search.screening.places(name)
    return bool(np.any(values[places] != search.fitter.neutral[places]))


def _causes(joint: JointFound) -> Names:
    return frozenset(cause.effect for cause in joint.causes)
