"""m_utl, the utility of an answer to whoever repairs the machine: what false, missed and indistinguishable names cost.

Metric of the diagnostic competitions (DXC): Feldman, Kurtoglu, Narasimhan, Poll, Garcia, de Kleer, Kuhn and van Gemund,
"Empirical Evaluation of Diagnostic Algorithm Performance Using a Generic Framework", Int. J. Prognostics and Health
Management 1(2), 2010; over an ambiguity set as in the synthetic track of DXC'26 (jdekleer/dxc26synth, commit 6da03bd, README).
The components of the machine are here the effects of the library, and one for whatever no effect of the library describes.
"""

from __future__ import annotations

from collections.abc import Collection
from itertools import product
from math import prod

import numpy as np

from hqpipe.benchmark.score.case import Judged

OUTSIDE = "(outside the library)"
MOST_SETS = 20_000  # of more, as many are drawn, which gives the mean to less than 1/100 of its spread
SEED = 0  # of that draw, so that equal answers have equal scores


def repair_utility(said: Collection[str], true: Collection[str], components: int) -> float:
    """Utility of one diagnosis, 1 for the right one.

    1 − n(N + 1)/(f(n + 1)) − n̄(N̄ + 1)/(f(n̄ + 1)) with n false among the N names said, n̄ missed among the N̄ = f − N others. Of N
    components tested in random order, n sought ones are found after n(N + 1)/(n + 1) tests in the mean.

    Args:
        said, true: names. components: f, how many there are.
    """
    said, true = set(said), set(true)
    false, missed, others = len(said - true), len(true - said), components - len(said)
    wasted = false * (len(said) + 1) / (false + 1) + missed * (others + 1) / (missed + 1)
    return 1.0 - wasted / components


def ambiguity_set(case: Judged) -> list[frozenset[str]]:
    """The sets of effects that an answer leaves open, equally likely: each name, or one that it cannot be told from."""
    options: dict[str, set[frozenset[str]]] = {}
    for cause in case.causes:
        others = ([entry] if isinstance(entry, str) else entry for entry in cause["confused_with"])
        names = options.setdefault(cause["effect"], {frozenset([cause["effect"]])})
        names.update(frozenset(other) for other in others)
    admitted = frozenset([OUTSIDE]) if _admits_more(case) else frozenset()
    listed = [sorted(names, key=sorted) for names in options.values()]
    if prod(len(names) for names in listed) > MOST_SETS:
        rng = np.random.default_rng(SEED)
        chosen = ([names[rng.integers(len(names))] for names in listed] for _ in range(MOST_SETS))
        return [admitted.union(*parts) for parts in chosen]
    return [admitted.union(*parts) for parts in product(*listed)]


def utility(case: Judged) -> float:
    """m_utl of a case, the mean over its ambiguity set; 0 for a diagnosis that failed.

    An effect that makes no gap counts neither way: it may be named.
    """
    if case.content is None:
        return 0.0
    needed = {e.effect for e in case.needed}
    allowed = {e.effect for e in case.namable}
    if case.unnamable:
        needed.add(OUTSIDE)
    candidates = ambiguity_set(case)
    components = len((case.library - set(case.without)) | allowed | {OUTSIDE}.union(*candidates))
    return sum(repair_utility(c, needed | (allowed & c), components) for c in candidates) / len(candidates)


def _admits_more(case: Judged) -> bool:
    """As in `Judged.admits_ignorance`."""
    return case.verdict == "unknown" or bool(case.causes and case.content["unexplained"]["above_noise"])
