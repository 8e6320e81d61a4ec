"""The search over the joints of a layer, and what joints of one machine say of each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from hqpipe.identify.change import KnownJoint, changes_between, changes_since
from hqpipe.identify.exchanges import rivals_of, with_numbers
from hqpipe.identify.found import JointFound, LayerFound
from hqpipe.identify.implied import with_implied
from hqpipe.identify.joint_moves import others_of, settled_together
from hqpipe.identify.joint_pool import JointPool
from hqpipe.identify.joint_search import JointSearch
from hqpipe.identify.minor_causes import without_minor_causes
from hqpipe.identify.model import JointModel, LayerJoints
from hqpipe.identify.numbers_of_others import own_numbers
from hqpipe.identify.passing import modelled, with_passing
from hqpipe.identify.prior import MOST_JOINTS, prior_odds
from hqpipe.identify.same_by_law import with_the_same_by_law
from hqpipe.identify.screening import Names
from hqpipe.identify.shared_names import with_shared_names
from hqpipe.identify.shown import with_shown
from hqpipe.identify.stands_for import with_what_they_stand_for

Progress = Callable[[float, float, str], None]


def identify(
    joints: LayerJoints,
    *,
    workers: int = 1,
    progress: Progress | None = None,
    reference: LayerJoints | Mapping[str, KnownJoint] | None = None,
    covariances: bool = False,
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
        covariances: whether to say how sure the numbers are, for a posterior; not beside a reference.
    """
    if isinstance(reference, Mapping):
        return changes_since(reference, joints, lambda models: _searched(models, workers, progress))
    if reference is not None:
        starts = iter((0.0, 0.5))  # the joints are searched for what both records ask for, then for what changed
        return changes_between(
            reference, joints, lambda models: _searched(models, workers, _half(progress, next(starts)))
        )
    found = _searched(joints.models, workers, progress, covariances)
    return LayerFound(
        joints, with_passing(found, joints.window_s, lambda models: _searched(models, workers, None, covariances))
    )


def _searched(
    models: Sequence[JointModel], workers: int, progress: Progress | None, covariances: bool = False
) -> tuple[JointFound, ...]:
    done = 0

    def report(j: int) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, len(models), models[j].joint)

    with JointPool([JointSearch(model, prior_odds) for model in models], workers) as pool:
        _search(pool, models, report)
        answers = _answered(pool)
        few = _names(models) - _shared(answers) if len(models) > 1 else frozenset()
        sets = [(frozenset(joint.kept.effects), frozenset(joint.base.effects), few) for joint in answers]
        visible = pool.each("visible", sets)
        read = pool.each("readings", [(frozenset(j.kept.effects), frozenset(j.named.effects)) for j in answers])
        found = [
            with_the_same_by_law(replace(joint, model=model, visible=seen))
            for joint, model, seen in zip(answers, models, visible, strict=True)
        ]
        parts = pool.each("stands_for", [(frozenset(j.kept.effects), _causes(j)) for j in answers])
        found = with_shown(with_implied(found, read))
        if not covariances:
            return with_what_they_stand_for(found, parts)
        rivals = rivals_of(found)
        asked = [
            (frozenset(modelled(joint).effects), [rival.step for rival in rivals if j in rival.joints])
            for j, joint in enumerate(found)
        ]
        numbers = pool.each("numbers", asked)
    found = [with_numbers(joint, *own, rivals) for joint, own in zip(found, numbers, strict=True)]
    return with_what_they_stand_for(found, parts)


def _search(pool: JointPool, models: Sequence[JointModel], report: Callable[[int], None]) -> None:
    """Search every joint by itself, and again beside what the others have reached."""
    present = pool.each("first", [(len(models) == 1,)] * len(models), report)
    if len(models) > 1:
        reached = pool.each("reached")
        told = [(others_of(present, j), others_of(reached, j)) for j in range(len(models))]
        present, worths = zip(*pool.each("weighed_again", told), strict=True)
        present = settled_together(models, present, worths, lambda asked: pool.some("moved", asked))
        pool.each("told", _others(present))


def _answered(pool: JointPool) -> list[JointFound]:
    """The answers of joints that were searched, each in the light of those of the others."""
    given_up: dict[int, set[str]] = {}

    def named_alike(answers: Sequence[JointFound]) -> list[JointFound]:
        return with_shared_names(answers, lambda steps: pool.some("renamed", steps), given_up)

    answers = named_alike(pool.each("answered"))
    shared = _shared(answers)
    again = pool.each("with_shared", [(shared, _causes(joint)) for joint in answers])
    answers = named_alike([new or joint for new, joint in zip(again, answers, strict=True)])
    present = [frozenset(joint.kept.effects) for joint in answers]
    rare = {j: (effects, others_of(present, j)) for j, effects in _rare(answers).items()}
    for j, joint in pool.some("with_rare", rare).items():
        answers[j] = joint
    answers = named_alike(answers)
    own = own_numbers(answers, _shared(answers))
    asked = {j: (frozenset(answers[j].kept.effects), numbers) for j, numbers in own.items()}
    for j, joint in pool.some("as_others_have", asked).items():
        answers[j] = joint or answers[j]
    return without_minor_causes(named_alike(answers), lambda least: pool.some("without", least))


def _others(present: Sequence[Names]) -> list[tuple[list[Names]]]:
    """For each joint the effects of all others, as the one argument of a step of its search."""
    return [(others_of(present, j),) for j in range(len(present))]


def _shared(answers: Sequence[JointFound]) -> frozenset[str]:
    """Causes that most joints of the machine have."""
    count = Counter(cause.effect for joint in answers for cause in joint.causes)
    return frozenset(name for name, joints in count.items() if joints > MOST_JOINTS * len(answers) and joints > 1)


def _rare(answers: Sequence[JointFound]) -> dict[int, frozenset[str]]:
    """Joint → its causes that most joints of the machine do not have, of joints with such causes."""
    shared = _shared(answers)
    own = {j: _causes(joint) - shared for j, joint in enumerate(answers)}
    return {j: effects for j, effects in own.items() if effects} if len(answers) > 1 else {}


def _causes(joint: JointFound) -> frozenset[str]:
    return frozenset(cause.effect for cause in joint.causes)


def _names(models: Sequence[JointModel]) -> frozenset[str]:
    return frozenset(effect.name for model in models for effect in model.effects)


def _half(progress: Progress | None, start: float) -> Progress | None:
    """Progress of one of two searches; start: share of the whole that is done before it."""
    if progress is None:
        return None
    return lambda done, total, text: progress(start * total + 0.5 * done, total, text)
