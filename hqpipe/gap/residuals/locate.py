"""Where the gap lies: the share of each joint and regime, with block-bootstrap intervals."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from hqpipe.gap.residuals.bootstrap import block_weights, interval
from hqpipe.gap.residuals.tally import ALL, Tally

CONCENTRATED = 1.2  # assumption: a regime is named if it holds 20 % more of the gap than of the samples
TIME = "time_span"
MAX_PLACES = 12
MIN_SHARE = 0.02  # assumption: smaller places are left to residuals.csv


@dataclass(frozen=True)
class Place:
    """One joint in one regime.

    Attributes:
        share: of the gap, 0…1, errors counted against the joints' scales; within a family the shares of all joints and
            regimes sum to one.
        share_low, share_high: 95 % interval.
        samples: how many samples the place holds.
        rmse: free-running error there, in the unit of the joint. normalised: over the joint's scale.
        lift_low: lower end of the 95 % interval of the share over the expected share. That is what the place
            would hold if the joint's error did not care about the regime: its part of the samples.
        weight: how telling the place is, nats.
    """

    joint: str
    family: str
    regime: str
    share: float
    share_low: float
    share_high: float
    samples: int
    rmse: float
    normalised: float
    lift_low: float
    weight: float


def shares(square: np.ndarray, count: np.ndarray, floor: np.ndarray, groups: list[list[int]]) -> np.ndarray:
    """Share of the gap above the noise floor.

    Args:
        square, count: (…, J, R) summed squared residuals, over the squares of the joints' scales, and samples.
        floor: (J,) mean squared error that noise alone leaves, likewise.
        groups: columns of each family.

    Returns:
        (…, J, R), each family summing to one, or to zero where nothing exceeds the floor.
    """
    excess = np.maximum(square - floor[:, None] * count, 0.0)
    share = np.zeros_like(excess)
    for columns in groups:
        part = excess[..., columns]
        total = part.sum(axis=(-2, -1), keepdims=True)
        share[..., columns] = np.divide(part, total, out=np.zeros_like(part), where=total > 0)
    return share


def locate(sums: Tally, floor: np.ndarray, joints: tuple[str, ...], scale: np.ndarray) -> list[Place]:
    """Every joint × regime that occurs, the most telling first.

    Args:
        floor: (J,) mean squared error that noise alone leaves. scale: (J,), see `hqpipe.gap.residuals.joint_scale`.
    """
    groups = [sums.family(name) for name in sums.families]
    blocks, count_joints, regimes = sums.square.shape
    weights = block_weights(blocks)
    relative, floor = sums.square / scale[:, None] ** 2, floor / scale**2
    square = (weights @ relative.reshape(blocks, -1)).reshape(-1, count_joints, regimes)
    count = (weights @ sums.count.reshape(blocks, -1)).reshape(-1, count_joints, regimes)
    draws = shares(square, count, floor, groups)
    low, high = interval(draws)
    lift = _lift(draws, count, groups)
    total_square, total_count = sums.square.sum(axis=0), sums.count.sum(axis=0)
    share = shares(relative.sum(axis=0), total_count, floor, groups)
    expected = _expected(share[:, :1], total_count, groups)
    weight = _weights(share, expected, groups)
    places = []
    for j, joint in enumerate(joints):
        for r, (family, regime) in enumerate(sums.regimes):
            samples = total_count[j, r]
            if samples < 1.0:
                continue
            places.append(
                Place(
                    joint=joint,
                    family=family,
                    regime=regime,
                    share=float(share[j, r]),
                    share_low=float(low[j, r]),
                    share_high=float(high[j, r]),
                    samples=round(samples),
                    rmse=(rmse := float(np.sqrt(total_square[j, r] / samples))),
                    normalised=rmse / float(scale[j]),
                    lift_low=float(lift[j, r]),
                    weight=float(weight[j, r]),
                )
            )
    return sorted(places, key=lambda p: (-p.weight, p.joint, p.family, p.regime))


def _lift(draws: np.ndarray, count: np.ndarray, groups: list[list[int]]) -> np.ndarray:
    """(J, R) lower end of share over expected share, over the draws in which the joint has a gap at all."""
    lift = np.zeros(draws.shape[1:])
    for columns in groups:
        part = draws[..., columns]
        expected = _expected(part.sum(axis=-1, keepdims=True), count[..., columns], [list(range(len(columns)))])
        known = expected > 0
        ratio = np.divide(part, expected, out=np.full(part.shape, np.nan), where=known)
        ratio[0] = np.where(known.any(axis=0), ratio[0], 0.0)
        lift[:, columns] = np.nanpercentile(ratio, 2.5, axis=0)
    return lift


def _expected(joint_share: np.ndarray, count: np.ndarray, groups: list[list[int]]) -> np.ndarray:
    """(…, J, R) the joint's share divided among the regimes of each family as the samples are."""
    expected = np.zeros(count.shape)
    for columns in groups:
        part = count[..., columns]
        total = part.sum(axis=-1, keepdims=True)
        part = np.divide(part, total, out=np.zeros_like(part), where=total > 0)
        expected[..., columns] = joint_share * part
    return expected


def _weights(share: np.ndarray, expected: np.ndarray, groups: list[list[int]]) -> np.ndarray:
    """(J, R) nats: what knowing the joint tells about where the error is, plus what the regime adds.

    The joint's part is share × ln(share × J). A family adds the Kullback-Leibler divergence of its shares
    from the expected ones. The regime that contributes most carries both if it holds at least half of the
    joint's gap; the others, and a smaller one, carry them in proportion to their share.
    """
    whole = share[:, :1]
    weight = np.zeros_like(share)
    joint_part = whole * np.log(np.maximum(whole * len(share), 1.0))
    for columns in groups:
        part, prior = share[:, columns], expected[:, columns]
        ratio = np.divide(part, prior, out=np.ones_like(part), where=(part > 0) & (prior > 0))
        gain = part * np.log(ratio)
        top = gain == gain.max(axis=1, keepdims=True)
        scale = np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)
        family = np.maximum(gain.sum(axis=1, keepdims=True), 0.0)
        weight[:, columns] = (joint_part + family) * np.minimum(np.where(top, 2.0, 1.0) * scale, 1.0)
    return weight


def telling(places: list[Place], passing: Collection[str] = ()) -> list[Place]:
    """The places worth naming, most telling first.

    A regime is named only if it holds more of its joint's gap than is expected of it, for certain; the joint
    as a whole is named beside it.

    Args:
        passing: joints in which a cause acts for some time only; of them the largest time is named in any case.
    """
    named = []
    for place in places:
        if place.share < MIN_SHARE:
            continue
        if place.family == ALL or place.lift_low > CONCENTRATED:
            named.append(place)
    times = [p for p in places if p.family == TIME and p.joint in passing]
    if times and not any(p.family == TIME for p in named[:MAX_PLACES]):
        named = [*named[: MAX_PLACES - 1], max(times, key=lambda p: p.share)]
    return named[:MAX_PLACES]
