"""What the host asks of the joints of a legged machine: free motions of hanging legs, treading and pressing on plates."""

from __future__ import annotations

import numpy as np

from hqpipe.benchmark.cases.legged.body import leg_terms
from hqpipe.benchmark.cases.legged.draw import STAND, TICK, LeggedMachine, LeggedTrial
from hqpipe.benchmark.cases.legged.robots import Robot
from hqpipe.benchmark.cases.motions import Range, course, smooth

BEFORE_S = 2.0  # s of the same motion before the record begins, so that it begins in the middle of operation
NAMES = {"sweep": "chirp", "moves": "pick_and_place", "steps": "steps", "slow": "slow_sweep"}
BAND_HZ = (0.3, 4.5)  # of a multisine: up to where the position loops follow; assumption
BLEND_S = 0.8  # s, over which the stand is left; assumption


def commands(machine: LeggedMachine, trial: LeggedTrial) -> np.ndarray:
    """(T, J) rad a tick, with what goes before the record."""
    robot = machine.robot
    ticks = round((trial.seconds + BEFORE_S) / TICK)
    time = np.arange(ticks) * TICK
    if trial.motion in STAND:
        found = _standing(robot, trial, time)
    else:
        found = np.column_stack([_free(robot, trial, time, j) for j in range(len(robot.joints))])
    every = machine.logger.policy_ticks
    return found[np.arange(ticks) // every * every]  # a target is held until the next one


def _free(robot: Robot, trial: LeggedTrial, time: np.ndarray, j: int) -> np.ndarray:
    """(T,) of one joint of a hanging leg."""
    pace = trial.pace
    room = Range(
        float(robot.stand[j]),
        float(robot.swing[j]),
        float(robot.speed[j]) * pace,
        float(robot.acceleration[j]) * pace**2,
    )
    rng = np.random.default_rng([trial.seed, j])
    if trial.motion == "multisine":
        return room.middle + smooth(np.clip(time / BLEND_S, 0.0, 1.0)) * multisine(time, room, rng)
    return course(NAMES[trial.motion], time, room, rng)


def multisine(time: np.ndarray, room: Range, rng: np.random.Generator) -> np.ndarray:
    """(T,) rad about the middle: five sines over `BAND_HZ`, each as large as swing and acceleration allow."""
    low, high = BAND_HZ
    edges = np.geomspace(low, high, 6)
    found = np.zeros_like(time)
    for first, last in zip(edges[:-1], edges[1:], strict=True):
        rate = 2.0 * np.pi * rng.uniform(first, last)
        size = min(room.swing, room.speed / rate, room.acceleration / rate**2) / np.sqrt(5.0)
        found += size * np.sin(rate * time + rng.uniform(0.0, 2.0 * np.pi))
    return np.clip(found, -1.2 * room.swing, 1.2 * room.swing)


def _standing(robot: Robot, trial: LeggedTrial, time: np.ndarray) -> np.ndarray:
    """(T, J) with the feet on the plates: a trot on the spot, or legs that press and give way in common and in turn.

    A leg folds by `fold` rad at the knee, half of it at the pitch joint, so that the foot moves up and down.
    """
    rng = np.random.default_rng([trial.seed, 77])
    n, count = robot.per_leg, len(robot.legs)
    found = np.tile(robot.stand, (len(time), 1))
    blend = smooth(np.clip(time / BLEND_S, 0.0, 1.0))
    rate = rng.uniform(0.7, 1.3) * trial.pace
    lift, press = rng.uniform(0.25, 0.45), rng.uniform(0.05, 0.11)
    stride, sway = rng.uniform(0.03, 0.09), rng.uniform(0.03, 0.08)
    drift = 0.15 * np.sin(2.0 * np.pi * 0.11 * time + rng.uniform(0.0, 6.0))  # no two steps are alike
    for leg in range(count):
        offset = 0.5 * ((leg + leg // 2) % 2)  # diagonal legs together; two legs in turn
        if trial.motion == "tread":
            wave = np.sin(2.0 * np.pi * (rate * time + offset + 0.3 * drift))
            fold = lift * (1.0 + drift) * np.maximum(wave, 0.0) ** 1.5 - press * np.maximum(-wave, 0.0)
            along = stride * np.cos(2.0 * np.pi * (rate * time + offset + 0.3 * drift))
        else:
            own = rng.uniform(0.5, 1.5) * rate
            wave = np.sin(2.0 * np.pi * own * time + rng.uniform(0.0, 6.0)) + 0.6 * np.sin(
                2.0 * np.pi * 2.7 * own * time
            )
            fold, along = 0.7 * press * (wave - 0.4), stride * np.sin(2.0 * np.pi * 0.37 * own * time)
        first = leg * n
        side = sway * np.sin(2.0 * np.pi * 0.5 * rate * time + leg)
        for k, change in enumerate((side, 0.5 * fold + along, -fold, 0.5 * fold - along)[:n]):
            found[:, first + k] += blend * change
    return found


def plate_height(robot: Robot) -> float:
    """Where a foot touches its plate as the robot stands, m; the feet of all legs are level."""
    n, heights = robot.per_leg, []
    for leg in range(len(robot.legs)):
        foot = np.zeros(3)
        stand = np.ascontiguousarray(robot.stand[leg * n : leg * n + n])
        scratch = (np.zeros((n, 15, 3)), np.zeros((n, n)), np.zeros(n))
        leg_terms(robot.body, leg, stand, np.zeros(n), *scratch, foot, np.zeros((3, n)))
        heights.append(foot[2])
    return float(np.mean(heights))
