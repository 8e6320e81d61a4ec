"""The search over the joints of a layer, and what joints of one machine say of each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Lock

import numpy as np

from hqpipe.identify.change import KnownJoint, changes_between, changes_since
from hqpipe.identify.found import JointFound, LayerFound
from hqpipe.identify.joint_answer import answer
from hqpipe.identify.minor_causes import without_minor_causes
from hqpipe.identify.model import JointModel, LayerJoints
from hqpipe.identify.passing import with_passing
from hqpipe.identify.search import Known, Search
from hqpipe.identify.visible import least_visible

Progress = Callable[[float, float, str], None]
_EXPECTED = 1.0  # effects of a joint beforehand; assumption: logs are diagnosed because something is wrong
_COMMON = 0.5  # of the joints have a common effect; by its definition
_MOST_JOINTS = 0.5  # share of the joints that have a cause, from which it is one of the machine
_WEIGHT = 3.0  # joints that the expectation counts as, beside the other joints of the machine; assumption


def identify(
    joints: LayerJoints,
    *,
    workers: int = 1,
    progress: Progress | None = None,
    reference: LayerJoints | Mapping[str, KnownJoint] | None = None,
) -> LayerFound:
    """Find the effects of every joint.

    Each joint is searched by itself. Then an effect that other joints have is more probable in this one, and one that they lack
    less (a beta-binomial prior), and what the joints say is weighed again. Where effects over whole trials leave joints
    unexplained, effects that act for a part of each trial are searched.

    Args:
        joints: of one layer. workers: joints at a time; the answer does not depend on it.
        progress: called with (done, total, text).
        reference: the same joints in an earlier record of the machine, its logs or what a model of it says; then causes are
            what changed since.
    """
    if isinstance(reference, Mapping):
        return changes_since(reference, joints, lambda models: _searched(models, workers, progress))
    if reference is not None:
        starts = iter((0.0, 0.5))  # the joints are searched for what both records ask for, then for what changed
        return changes_between(
            reference, joints, lambda models: _searched(models, workers, _half(progress, next(starts)))
        )
    found = _searched(joints.models, workers, progress)
    return LayerFound(joints, with_passing(found, joints.window_s, lambda models: _searched(models, workers, None)))


def _searched(models: Sequence[JointModel], workers: int, progress: Progress | None) -> tuple[JointFound, ...]:
    done, lock = 0, Lock()

    def first(model: JointModel) -> tuple[Search, Known]:
        nonlocal done
        search = Search(model, prior_odds(model, {}, 0))
        found = search.run()
        with lock:  # joints are searched at a time
            done += 1
            if progress is not None:
                progress(done, len(models), model.joint)
        return search, found

    with ThreadPoolExecutor(max(workers, 1)) as pool:
        searched = list(pool.map(first, models))
        if len(models) > 1:
            present = [known.names for _, known in searched]
            others = [present[:j] + present[j + 1 :] for j in range(len(models))]
            searched = list(
                pool.map(lambda pair: _weighed_again(*pair[0], pair[1]), zip(searched, others, strict=True))
            )
        answers = tuple(pool.map(lambda pair: answer(*pair), searched))
        answers = tuple(pool.map(lambda pair: _with_shared(*pair), _sharing(searched, answers)))
    answers = without_minor_causes(searched, answers)
    return tuple(_with_visible(search, found) for (search, _), found in zip(searched, answers, strict=True))


def _sharing(
    searched: Sequence[tuple[Search, Known]], answers: Sequence[JointFound]
) -> list[tuple[Search, Known, JointFound]]:
    """Each joint with its answer; its search is told which causes most joints of the machine have."""
    count = Counter(cause.effect for joint in answers for cause in joint.causes)
    shared = frozenset(name for name, joints in count.items() if joints > _MOST_JOINTS * len(answers) and joints > 1)
    for search, _ in searched:
        search.shared = shared
    return [(search, known, joint) for (search, known), joint in zip(searched, answers, strict=True)]


def _with_shared(search: Search, known: Known, found: JointFound) -> JointFound:
    """The answer of a joint that lacks a cause of most others, once more: what most have need only be probable in one."""
    lacking = search.shared - {cause.effect for cause in found.causes}
    return answer(search, known) if lacking & known.names else found


def _with_visible(search: Search, found: JointFound) -> JointFound:
    kept, base = (search.known[frozenset(part.effects)] for part in (found.kept, found.base))
    return replace(found, visible=least_visible(search, kept, base))


def _half(progress: Progress | None, start: float) -> Progress | None:
    """Progress of one of two searches; start: share of the whole that is done before it."""
    if progress is None:
        return None
    return lambda done, total, text: progress(start * total + 0.5 * done, total, text)


def prior_odds(model: JointModel, others: Mapping[str, int], joints: int) -> dict[str, float]:
    """ln of the prior odds of each effect.

    Args:
        others: effect → how many of the other joints have it. joints: how many other joints there are.
    """
    expected = min(_EXPECTED / max(len(model.effects), 1), 0.5)
    found = {}
    for effect in model.effects:
        before = _COMMON if effect.common else expected
        share = (_WEIGHT * before + others.get(effect.name, 0)) / (_WEIGHT + joints)
        found[effect.name] = float(np.log(share / (1.0 - share)))
    return found


def _weighed_again(search: Search, known: Known, others: Sequence[frozenset[str]]) -> tuple[Search, Known]:
    """The search with what the other joints have in its prior."""
    count: dict[str, int] = {}
    for names in others:
        for name in names:
            count[name] = count.get(name, 0) + 1
    search.odds = prior_odds(search.model, count, len(others))
    for name in sorted(count, key=lambda name: (-count[name], name)):  # a set has no order of its own
        if name in search.effects and name in search.addable(known.names) and search.odds[name] > 0.0:
            larger = search.grown_by(known, name)
            if search.gain(larger, known) > 0.0:
                known = larger
                continue
            # What one joint's logs ask for in its place may only look like it.
            for other in sorted(known.names):
                option = search.grown_by(search.without(known, other), name)
                if search.preference(option, known) > 0.0:
                    known = option
                    break
    return search, search.improved(known)
