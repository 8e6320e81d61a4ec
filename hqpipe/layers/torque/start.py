"""A first look at the logs: the first-order loop that fits best, with the dead time before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from hqpipe.layers.torque.record import Record

RATES = np.geomspace(5.0, 600.0, 19)  # 1/s; assumption: from a slow hydraulic load to a fast servo valve
DELAYS_S = np.array(
    [0.0, 0.002, 0.004, 0.006, 0.009, 0.013, 0.02, 0.03, 0.045, 0.07, 0.1]
)  # that are tried; assumption
LEAST_SHARE = 0.2  # of the command that a steady torque reaches, below which it is none; assumption
ENOUGH = 10_000  # samples that a first look takes


@dataclass(frozen=True)
class Look:
    """A first-order loop through the logs.

    Attributes:
        rate: 1/s, at which an error fades. delay_s: of the command. speed_share: unit of the effort per speed.
        offset: unit of the effort.
        leak: how much of the command a steady torque lacks, over the torque.
    """

    rate: float
    delay_s: float
    speed_share: float
    offset: float
    leak: float


def first_look(record: Record) -> Look:
    """The rate and dead time at which command less effort, speed and a constant predict the effort best."""
    spans = _spans(record)
    settle = round(0.1 / record.dt)
    valid = np.concatenate([np.r_[np.zeros(settle, bool), ~record.masked[a + settle : b]][: b - a] for a, b in spans])
    effort = np.concatenate([record.effort[a:b] for a, b in spans])[valid]
    shifts = np.unique(np.round(DELAYS_S / record.dt).astype(int))
    best, look = np.inf, Look(float(RATES[len(RATES) // 2]), 0.0, 0.0, 0.0, 0.0)
    for rate in RATES:
        filtered = [_lagged(record.velocity[a:b], rate * record.dt) for a, b in spans]
        beside = np.column_stack([np.concatenate(filtered)[valid], np.ones(valid.sum())])
        for shift in shifts:
            command = np.concatenate([_lagged(_late(record.command[a:b], shift), rate * record.dt) for a, b in spans])
            columns = np.column_stack([command[valid], beside])
            numbers = np.linalg.lstsq(columns, effort, rcond=None)[0]
            left = float(np.sum((effort - columns @ numbers) ** 2))
            if left < best and numbers[0] > LEAST_SHARE:
                share, speed, offset = (float(number) for number in numbers)
                late = float(shift * record.dt)
                best, look = left, Look(float(rate), late, -speed / share, offset / share, 1.0 / share - 1.0)
    return look


def _spans(record: Record) -> list[tuple[int, int]]:
    """(first, stop) of the parts that are looked at: of each stretch its middle."""
    most = max(ENOUGH // len(record.first), 200)
    found = []
    for first, last in zip(record.first, record.last, strict=True):
        size = min(last + 1 - first, most)
        begin = first + (last + 1 - first - size) // 2
        found.append((int(begin), int(begin + size)))
    return found


def _lagged(values: np.ndarray, share: float) -> np.ndarray:
    """Values held from sample to sample behind a first-order lag; `share`: of a sample over the time constant."""
    keep = np.exp(-share)
    return lfilter([0.0, 1.0 - keep], [1.0, -keep], values, zi=[values[0]])[0]


def _late(values: np.ndarray, shift: int) -> np.ndarray:
    return values if shift == 0 else np.concatenate([np.full(min(shift, len(values)), values[0]), values[:-shift]])
