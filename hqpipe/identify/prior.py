"""How probable effects are before the logs are seen, and how far joints of one machine have the same ones.

Of each effect the share of joints that have it is unknown and has a beta distribution; how many joints have it is then
beta-binomial. Given what the other joints have, an effect that they have is more probable in this one, and one that they lack
less.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import betaln

from hqpipe.identify.model import Effect, JointModel
from hqpipe.identify.thresholds import EXPECTED, EXPECTED_LIKE

MOST_JOINTS = 0.5  # share of joints from which on what more of them say is what the machine has: their majority
_COMMON = 0.5  # of the joints have a common effect, by its definition; no other effect is expected in more


def prior_odds(model: JointModel, others: Mapping[str, int], joints: int) -> dict[str, float]:
    """ln of the prior odds of each effect in one joint.

    Args:
        others: effect → how many of the other joints have it. joints: how many other joints there are.
    """
    found = {}
    for effect in model.effects:
        share = expected_share(model, others.get(effect.name, 0), joints, effect.common)
        found[effect.name] = float(np.log(share / (1.0 - share)))
    return found


def expected_share(model: JointModel, having: int, joints: int, common: bool = False) -> float:
    """Probability that a joint has an effect, given the other joints of the machine.

    Args:
        model: of the joint. having: how many of the `joints` others have it. common: as of `Effect`.
    """
    return (EXPECTED_LIKE * _before(model, common) + having) / (EXPECTED_LIKE + joints)


def log_prior(model: JointModel, effect: Effect, having: np.ndarray, joints: int) -> np.ndarray:
    """ln of the prior probability that exactly these joints of a machine have an effect, for every count (K,) of them.

    Args:
        model: of one of the joints. having: (K,) how many of the `joints` have it.
    """
    share = _before(model, effect.common)
    with_it, without = EXPECTED_LIKE * share, EXPECTED_LIKE * (1.0 - share)
    return betaln(with_it + having, without + joints - having) - betaln(with_it, without)


def _before(model: JointModel, common: bool) -> float:
    """Share of joints that are expected to have an effect."""
    return _COMMON if common else min(EXPECTED / max(len(model.effects), 1), _COMMON)
