"""Effects that a cause cannot be told from by the law of a joint, in any logs or in those that it has."""

from __future__ import annotations

from dataclasses import replace

from hqpipe.identify.found import JointFound


def with_the_same_by_law(joint: JointFound) -> JointFound:
    """The answer of a joint, with such effects among those that each of its causes is confused with.

    The logs of other joints say nothing of them either, so this comes after joints have taken each other's names.
    """
    # Of its class: a model that wraps another one has other numbers than that.
    same_by_law = getattr(type(joint.model), "same_by_law", None)
    if same_by_law is None or not joint.causes:
        return joint
    same = same_by_law(joint.model, joint.kept.values)
    causes = tuple(
        replace(cause, confused_with=tuple(dict.fromkeys((*cause.confused_with, *same.get(cause.effect, ())))))
        for cause in joint.causes
    )
    return replace(joint, causes=causes)
