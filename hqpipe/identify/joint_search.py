"""The search over one joint, step by step; what each step returns can be copied between processes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from hqpipe.identify.found import JointFound, SetNumbers
from hqpipe.identify.implied import Reading, readings
from hqpipe.identify.isolability import Isolability, isolability
from hqpipe.identify.joint_answer import answer
from hqpipe.identify.joint_moves import Step, Worths
from hqpipe.identify.joint_steps import after, steps
from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.model import JointModel
from hqpipe.identify.numbers_of_others import Beside, OwnNumber, as_others_have, with_own_number
from hqpipe.identify.prior import MOST_JOINTS
from hqpipe.identify.rounds import forward_then_backward, searched, with_one_for_two
from hqpipe.identify.search import Known, Names, Search
from hqpipe.identify.set_numbers import set_numbers
from hqpipe.identify.stands_for import StandsFor, stands_for
from hqpipe.identify.visible import least_visible

_TRIED = 3  # sets that other joints have reached, the most common ones; assumption: a rare one is its joint's own

Numbers = Mapping[str, np.ndarray]
"""Effect → values of its parameters."""
Odds = Callable[[JointModel, Mapping[str, int], int], dict[str, float]]
"""ln of the prior odds of each effect of a model, from effect → how many other joints have it, and how many these are."""


class JointSearch:
    """The sets that were fitted to a joint, and the one that was reached.

    An answer comes without its model, which whoever asked has.
    """

    def __init__(self, model: JointModel, odds: Odds) -> None:
        self._model, self._odds = model, odds
        self._search: Search | None = None
        self._known: Known | None = None
        self._beside: list[Beside] = []

    def load_compiled_code(self) -> None:
        """Predict once, so that copies of this process have the compiled code."""
        fitter = Fitter(self._model)
        fitter.error(fitter.neutral)

    def first(self, alone: bool) -> Names:
        """Effects that the joint asks for by itself; alone: whether the machine has no other joint."""
        self._search = Search(self._model, self._odds(self._model, {}, 0))
        self._known = searched(self._search, alone)
        return self._known.names

    def answered(self) -> JointFound:
        """The answer."""
        return self._answer_of(self._known)

    def _answer_of(self, known: Known) -> JointFound:
        """The answer with a set that was reached; numbers are the joint's own again where they were as in the other joints
        because of an effect beside them that is a cause no more."""
        found = replace(answer(self._search, known), model=None)
        causes = {cause.effect for cause in found.causes}
        for k, beside in enumerate(self._beside):
            if beside.rival not in causes:
                beside.earlier.barred |= self._search.barred
                self._search, self._known, self._beside = beside.earlier, beside.earlier_known, self._beside[:k]
                return self._answer_of(self._without_barred())
            found = with_own_number(found, beside)
        return found

    def _without_barred(self) -> Known:
        """The set that was reached without effects that are barred by now."""
        search, known = self._search, self._known
        for name in sorted(known.names & search.barred):
            known = search.without(known, name)
        return search.improved(known)

    def reached(self) -> Numbers:
        """The effects with a name that the joint asks for, with their numbers."""
        search, known = self._search, self._known
        named = sorted(name for name in known.names if search.effects[name].named)
        return {name: known.solution.values[search.screening.places(name)] for name in named}

    def weighed_again(self, others: Sequence[Names], reached: Sequence[Numbers]) -> tuple[Names, Worths]:
        """The effects that the joint asks for beside what the others have, and what it says of steps from there.

        Args:
            others: effects of each of the other joints, which the prior then goes by. reached: what each of them has reached.
        """
        count = self._told(others)
        search = self._search
        known = self._as_another(reached)
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
        usual = frozenset(name for name in count if count[name] > MOST_JOINTS * len(others))
        if usual - known.names and known.names - usual:
            # The search may have gone astray in this joint alone: what most others have is tried as a whole.
            whole = search.grown_along(sorted(usual))
            known = whole if search.preference(whole, known) > 0.0 else known
        self._known = forward_then_backward(search, search.improved(known))
        return self._known.names, steps(search, self._known)

    def _as_another(self, reached: Sequence[Numbers]) -> Known:
        """The set of the joint, or a likelier one that another joint has reached: what joins one after the other may have led
        astray in this joint alone."""
        search, known = self._search, self._known
        found: dict[Names, Numbers] = {}
        for numbers in reached:
            found.setdefault(frozenset(numbers), numbers)
        count = Counter(frozenset(numbers) for numbers in reached)
        common = [names for names, _ in count.most_common() if not names <= known.names and search.may_have(names)]
        for names in common[:_TRIED]:
            option = search.begun_at(found[names])
            for name in sorted(known.names - names):  # what this joint has besides
                if name in search.addable(option.names):
                    larger = search.grown_by(option, name)
                    option = larger if search.gain(larger, option) > 0.0 else option
            known = option if search.likelier(option, known) else known
        return known

    def moved(self, asked: tuple[Step, Sequence[Names]]) -> tuple[Names, Worths]:
        """The effects of the joint after a step that it takes together with others, and what it says of further ones.

        Args:
            asked: the step, and the effects of each of the other joints after it.
        """
        step, others = asked
        self._told(others)
        search, known = self._search, after(self._search, self._known, step)
        self._known = search.improved(known)
        return self._known.names, steps(search, self._known)

    def told(self, others: Sequence[Names]) -> None:
        """Go by the effects of each of the other joints from now on."""
        self._told(others)

    def _told(self, others: Sequence[Names]) -> dict[str, int]:
        """Effect → how many of the other joints have it, which the prior goes by from now on."""
        count: dict[str, int] = {}
        for names in others:
            for name in names:
                count[name] = count.get(name, 0) + 1
        self._search.odds = self._odds(self._model, count, len(others))
        return count

    def with_shared(self, shared: Names, causes: Names) -> JointFound | None:
        """The answer of a joint that lacks a cause of most others, once more, as what most have need only be probable in one;
        None where it is the same.

        Args:
            shared: causes of most joints of the machine. causes: of this one.
        """
        self._search.shared = shared
        lacking = shared - causes
        return self.answered() if lacking & self._known.names else None

    def with_rare(self, asked: tuple[Names, Sequence[Names]]) -> JointFound:
        """The answer once more, with causes that most joints of the machine do not have, for which more has to speak.

        Args:
            asked: these causes, and the effects that the answer of each of the other joints has by now.
        """
        self._search.rare, others = asked
        self._told(others)
        self._known = with_one_for_two(self._search, self._known)
        return self.answered()

    def as_others_have(self, asked: tuple[Names, Sequence[OwnNumber]]) -> JointFound | None:
        """The answer with numbers as the other joints have them, and other effects beside these; None where it stays as it is.

        Args:
            asked: effects of the answer, and its causes that most joints have with other numbers.
        """
        kept, own_numbers = asked
        found: JointFound | None = None
        for own in own_numbers:
            if (beside := as_others_have(self._search, self._known, kept, own)) is not None:
                self._search, self._known = beside.search, beside.known
                self._beside.append(beside)
                found = self.answered()
                kept = frozenset(found.kept.effects)
        return found

    def without(self, effect: str) -> JointFound:
        """The answer with an effect barred from now on; one that is barred never comes back."""
        self._search.barred.add(effect)
        return self._answer_of(self._without_barred())

    def renamed(self, step: Step) -> JointFound:
        """The answer with another effect in the place of one, which from now on is only told as one that is like it."""
        search, known = self._search, self._known
        self._beside = [replace(b, rival=step.joins) if b.rival == step.leaves else b for b in self._beside]
        if step.leaves in known.names:
            known = search.without(known, step.leaves)
            if step.joins in search.addable(known.names):
                known = search.grown_by(known, step.joins)
        search.given_up.add(step.leaves)
        self._known = search.improved(known)
        return self.answered()

    def isolability(self) -> dict[str, Isolability]:
        """See `hqpipe.identify.isolability.isolability`: beforehand, from the base alone."""
        return isolability(Search(self._model, self._odds(self._model, {}, 0)))

    def visible(self, kept: Names, base: Names, rare: Names) -> dict[str, float]:
        """See `hqpipe.identify.visible.least_visible`; kept, base: effects of the sets of an answer."""
        return least_visible(self._search, self._search.known[kept], self._search.known[base], rare)

    def readings(self, kept: Names, named: Names) -> tuple[Reading, ...]:
        """See `hqpipe.identify.implied.readings`; kept, named: effects of the sets of an answer."""
        return readings(self._search, self._search.known[kept], self._search.known[named])

    def stands_for(self, kept: Names, causes: Names) -> StandsFor:
        """See `hqpipe.identify.stands_for.stands_for`; kept, causes: effects of an answer."""
        return stands_for(self._search, self._search.known[kept], causes)

    def numbers(self, effects: Names, steps: Sequence[Step]) -> tuple[SetNumbers | None, dict[Step, SetNumbers]]:
        """How sure the numbers of a set of the answer are, and those of the set after each step that it can take.

        A set that is only one of several is not held against further ones that the search did not need.

        Args:
            effects: of the set. steps: one effect of the set leaves and another joins.
        """
        search, known, found = self._search, self._search.known[effects], {}
        for step in steps:
            if step.leaves not in effects or step.joins in effects or step.joins not in search.effects:
                continue
            smaller = search.without(known, step.leaves)
            if search.effects[step.joins].excludes & smaller.names:
                continue
            numbers = set_numbers(search, search.grown_by(smaller, step.joins), fitted_only=True)
            if numbers is not None:
                found[step] = numbers
        return set_numbers(search, search.known[effects]), found
