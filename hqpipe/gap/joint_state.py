"""One joint of a machine in the diagnosis: which effects it is asked for, its search, and where it stands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import norm

from hqpipe.effects.layout import slot
from hqpipe.errors import UsageError, near_match
from hqpipe.gap.changes import ABSENT, CANDIDATES, CHANGES, FACTORS, SCALE
from hqpipe.gap.joint_data import JointData
from hqpipe.gap.search import JointResult, JointSearch, Support
from hqpipe.gap.set_fit import JointFitter, SetFit

SIGNIFICANCE = 0.05  # that any effect at all is named on logs without one
Progress = Callable[[float, float, str], None]


@dataclass(frozen=True, eq=False)
class JointState:
    """Where the diagnosis of a joint stands.

    Attributes:
        search: its search. base, chosen: fits without and with effects.
        support: of the chosen effects. dropped: effect → why it was not accepted.
    """

    search: JointSearch
    base: SetFit
    chosen: SetFit
    support: tuple[Support, ...]
    dropped: dict[str, str] = field(default_factory=dict)

    @property
    def joint(self) -> str:
        return self.search.fitter.data.joint

    @property
    def data(self) -> JointData:
        return self.search.fitter.data

    def first_number(self, effect: str) -> float:
        """The first number of a chosen effect, in the fit's own form."""
        return self.search.fitter.first_number(self.chosen, effect)

    def of_machine(self, fit: SetFit) -> np.ndarray:
        """Held-out squared errors of a fit in the places of the machine's windows."""
        return self.data.heldout.of_machine(fit.heldout)

    def choose(self, fit: SetFit) -> JointState:
        """The joint with another set chosen."""
        if fit is self.chosen:
            return self
        return JointState(self.search, self.base, fit, self.search.with_support(fit), self.dropped)

    def closure(self, floor: float) -> float:
        """Share of the squared held-out error above the noise floor that the chosen set removes."""
        before = self.base.error - floor
        return (self.base.error - self.chosen.error) / before if before > 0 else 0.0


def library(
    mode: str,
    effort_source: str | None,
    joints: int,
    without: Sequence[str] = (),
    changes: bool = False,
) -> tuple[str, ...]:
    """Effects that logs of this kind can show.

    Args:
        changes: whether an earlier record is there, so that changes of the coefficients can show too.

    Raises:
        UsageError: `without` names an effect that does not exist.
    """
    for name in without:
        if name not in CANDIDATES:
            known = ", ".join(CANDIDATES)
            raise UsageError(f"without: no effect '{name}'{near_match(name, CANDIDATES)} (known: {known})")
    shown = {name for name, effect in CANDIDATES.items() if mode in effect.modes and (changes or name not in CHANGES)}
    shown |= {SCALE} if changes and mode == "position" else set()
    return tuple(
        name
        for name, effect in CANDIDATES.items()
        if name in shown
        and effect.parameters
        and joints >= effect.least_joints
        and (effect.effort_sources is None or effort_source in effect.effort_sources)
        and name not in without
    )


def _askable(name: str, data: JointData) -> bool:
    """Whether a joint can be asked for an effect: a coefficient that was nothing has no ratio."""
    if data.then is None or name not in FACTORS:
        return name not in data.barred
    lead = FACTORS[name][0]
    return name not in data.barred and data.then.row[slot("base", lead)] > ABSENT * data.natural[lead]


def search_joints(
    data: Sequence[JointData], names: Sequence[str], workers: int = 1, progress: Progress | None = None
) -> list[JointState]:
    """Search every joint, `workers` at a time; the result does not depend on their number."""
    questions = max(len(data) * len(names), 1)
    significance = float(norm.isf(SIGNIFICANCE / questions))
    searches = [JointSearch(JointFitter(d), [n for n in names if _askable(n, d)], significance) for d in data]

    def one(search: JointSearch) -> JointResult:
        return search.run()

    states = []
    with ThreadPoolExecutor(max(workers, 1)) as pool:
        for done, (search, result) in enumerate(zip(searches, pool.map(one, searches), strict=True), start=1):
            states.append(JointState(search, result.base, result.best, result.support))
            if progress:
                progress(done, len(searches), f"{result.joint}: {result.tried} sets of effects fitted")
    return states
