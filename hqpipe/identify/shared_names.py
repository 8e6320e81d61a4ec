"""One name where joints of a machine cannot tell two apart: that which more of them give.

Of two effects that leave nearly the same error, as a delay of the command and one of the valve, each joint takes the one that
suits what its law leaves out. So little decides nothing: joints that cannot tell them apart follow the others.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, MutableMapping, Sequence

from hqpipe.identify.found import JointFound
from hqpipe.identify.joint_moves import Step


def with_shared_names(
    answers: Sequence[JointFound],
    renamed: Callable[[Mapping[int, Step]], Mapping[int, JointFound]],
    given_up: MutableMapping[int, set[str]] | None = None,
) -> list[JointFound]:
    """The answers of a machine's joints, each with the names that the others give where it has no better reason for its own.

    Args:
        answers: of each joint. renamed: number of a joint → cause that leaves for good and the one in its place, to its answer.
        given_up: number of a joint → names that it gave up, which it does not take back; added to.
    """
    answers, given_up = list(answers), {} if given_up is None else given_up
    while wanted := _wanted(answers, given_up):
        for j, answer in renamed(wanted).items():
            given_up.setdefault(j, set()).add(wanted[j].leaves)
            answers[j] = answer
    return answers


def _wanted(answers: Sequence[JointFound], given_up: Mapping[int, set[str]]) -> dict[int, Step]:
    """Joint → its cause with a rival that more joints have, and that rival; one for each joint, the most common first."""
    count = Counter(cause.effect for joint in answers for cause in joint.causes)
    found: dict[int, tuple[int, Step]] = {}
    for j, joint in enumerate(answers):
        own = {cause.effect for cause in joint.causes} | given_up.get(j, set())
        for cause in joint.causes:
            for rival in cause.confused_with:
                more = count[rival] > max(count[cause.effect], found[j][0] if j in found else 0)
                if more and rival not in own:
                    found[j] = count[rival], Step(cause.effect, rival)
    return {j: step for j, (_, step) in found.items()}
