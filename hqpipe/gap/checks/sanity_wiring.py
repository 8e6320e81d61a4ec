"""Channels swapped between joints, and channels with their sign flipped.

Every trial is judged by itself. Where the inputs of another joint explain a column far better than those of its
own, the permutation that explains all columns best is sought (linear assignment); then every set of channels that
could have been permuted is put back in turn, and the set is named with which *all* relations of the joints
concerned fit. Joints that are driven alike explain each other as well as themselves, and are left alone.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np

from hqpipe.gap.checks.defect import Defect, of_channel, where
from hqpipe.gap.checks.relations import FOLDS, Relation, relations
from hqpipe.logs.trajectory import LogSet, Trajectory

CLEARLY = np.log(4.0)  # the error of every joint concerned must fall to a quarter, over all its relations; assumption
SIGMAS = 5.0  # and by this many standard errors (jackknife over the folds)
CANDIDATE = np.log(2.0)  # error of a single relation that makes a permutation worth trying
INFORMATIVE = 0.5  # share of the error that a relation must remove before its sign is believed; assumption
SLOW_S = 0.1  # over which torque and error are averaged: slower than the delays of a loop; assumption
OPPOSED = -0.05  # correlation of the two below which they oppose each other; a load hides most of it; assumption
MAX_SUSPECTS = 3  # joints of a trial whose sign seems flipped and that may be swapped instead
ALL_BACKWARDS = 2  # joints, none of which runs with its velocity: fewer may be wired wrongly by chance
_SETS: tuple[tuple[str, ...], ...] = (
    ("effort",),
    ("position_command",),
    ("velocity",),
    ("position",),
    ("valve_command",),
    ("effort_command",),
    ("pressure_a",),
    ("pressure_b",),
    ("position", "velocity"),
    ("pressure_a", "pressure_b"),
    ("position", "position_command"),
    ("position_command", "velocity"),
)  # the complement of a set would do as well: the smaller one is named

Gains = dict[tuple[str, ...], float]
"""Set of channels → how much the logarithm of the error falls when it is put back, mean over the joints."""


def wiring_defects(log_set: LogSet, unsigned: set[str]) -> list[Defect]:
    """Swapped and flipped channels.

    Args:
        log_set: trials of one machine.
        unsigned: joints whose effort is never negative: it may have lost its sign, and is not called flipped.
    """
    swaps: dict[tuple[int, ...], dict[str, Gains]] = defaultdict(dict)
    flips: dict[tuple[str, int], list[str]] = defaultdict(list)
    backwards = []
    for trial in log_set.trials:
        found = relations(trial.trajectory)
        kept = {j for j, joint in enumerate(log_set.joints) if joint in unsigned or not opposes(trial.trajectory, j)}
        flipped = [f for f in find_flips(found) if not (f[0] == "effort" and f[1] in kept)]
        if log_set.control_mode != "valve":  # inside a loop the valve answers the motion as much as it drives it
            flipped = [f for f in flipped if f[0] != "valve_command"]
        reverse = runs_backwards(found, flipped)
        if reverse:
            backwards.append(trial.file)
            continue
        for cycle, gains in find_swaps(trial.trajectory, found, flipped).items():
            swaps[cycle][trial.file] = gains
        for channel, j in flipped:
            flips[channel, j].append(trial.file)
    swapped = {j for cycle in swaps for j in cycle}
    flips = {key: files for key, files in flips.items() if key[1] not in swapped}
    defects = [_swapped(log_set, cycle, files) for cycle, files in swaps.items()]
    return defects + _backwards(log_set, backwards) + _flipped(log_set, _one_culprit(flips))


def find_swaps(t: Trajectory, found: list[Relation], flipped: list[tuple[str, int]]) -> dict[tuple[int, ...], Gains]:
    """Cycles of joints with permuted channels, and by how much each set of channels improves when put back.

    Column k of the set holds what belongs to the next joint of the cycle.
    """
    cycles = {cycle for relation in found for cycle in _cycles(relation)}
    suspects = {j for channel, j in flipped if channel in ("effort", "position_command")}
    if 0 < len(suspects) <= MAX_SUSPECTS:
        cycles |= {(min(i, j), max(i, j)) for i in suspects for j in range(len(t.joints)) if i != j}
    tried = {cycle: gains for cycle in cycles if (gains := _gains(t, cycle))}
    swaps: dict[tuple[int, ...], Gains] = {}
    for cycle, gains in sorted(tried.items(), key=lambda item: (-max(item[1].values()), item[0])):
        if not {j for other in swaps for j in other} & set(cycle):
            swaps[cycle] = gains
    return swaps


def _cycles(relation: Relation) -> list[tuple[int, ...]]:
    """Cycles of the best assignment of inputs to targets in which every target gains clearly, both ways round."""
    from scipy.optimize import linear_sum_assignment

    cost = np.log(relation.left + 1e-12)
    chosen = linear_sum_assignment(cost)[1]
    found: list[tuple[int, ...]] = []
    seen: set[int] = set()
    for start in range(len(cost)):
        cycle, j = [], start
        while j not in seen:
            seen.add(j)
            cycle.append(j)
            j = int(chosen[j])
        if len(cycle) > 1 and all(cost[j, j] - cost[j, chosen[j]] > CANDIDATE for j in cycle):
            found += dict.fromkeys([tuple(cycle), (cycle[0], *cycle[:0:-1])])
    return found


def _gains(t: Trajectory, cycle: tuple[int, ...]) -> Gains:
    """Sets of channels with which, put back along the cycle, the relations of every joint fit clearly better."""
    part = t.for_joints([t.joints[j] for j in cycle])
    back = np.roll(np.arange(len(cycle)), 1)
    before = _score(part)
    gains: Gains = {}
    for channels in _SETS:
        derived = part.velocity_source != "measured"
        if any(getattr(part, name) is None for name in channels) or derived and "velocity" in channels:
            continue
        follows = ("velocity",) if derived and "position" in channels else ()
        moved = {name: getattr(part, name)[:, back] for name in (*channels, *follows)}
        gain = before - _score(replace(part, **moved))
        mean = gain.mean(axis=0)
        error = np.sqrt((FOLDS - 1) * np.mean((gain - mean) ** 2, axis=0))
        if (mean > CLEARLY).all() and (mean > SIGMAS * error).all():
            gains[channels] = float(mean.mean())
    return gains


def _score(part: Trajectory) -> np.ndarray:
    """(F, J) logarithm of the error of each joint, summed over its relations, without one fold each."""
    return np.sum([relation.own_without() for relation in relations(part)], axis=0)


def runs_backwards(found: list[Relation], flipped: list[tuple[str, int]]) -> bool:
    """Whether all velocities oppose the motion, and commands or torques disagree as well: time runs backwards."""
    pairs = [relation for relation in found if relation.channels[:2] == ("velocity", "position")]
    if not pairs:
        return False
    sure = np.diagonal(pairs[0].left) < INFORMATIVE
    against = (pairs[0].sign < 0).all(axis=0)
    others = {j for channel, j in flipped if channel not in ("velocity",)}
    return bool(sure.sum() >= ALL_BACKWARDS and against[sure].all() and others)


def opposes(t: Trajectory, j: int) -> bool:
    """Whether the slow part of a joint's torque pushes against its position error, or its torque command."""
    demand = t.effort_command if t.effort_command is not None else t.position_command
    if demand is None or t.effort is None:
        return False
    wanted = demand[:, j] if t.effort_command is not None else demand[:, j] - t.position[:, j]
    every = max(1, round(SLOW_S / t.dt))
    count = t.samples // every
    if count < 2:
        return False
    x, y = (v[: count * every].reshape(count, every).mean(axis=1) for v in (wanted, t.effort[:, j]))
    x, y = x - x.mean(), y - y.mean()
    return bool(x @ y < OPPOSED * np.sqrt((x @ x) * (y @ y)))


def _one_culprit(flips: dict[tuple[str, int], list[str]]) -> dict[tuple[str, int], list[str]]:
    """A joint whose position is flipped in one trial has no flipped velocity or command in the others."""
    merged = dict(flips)
    for j in {j for channel, j in flips if channel == "position"}:
        for channel in ("velocity", "position_command", "valve_command"):
            merged["position", j] = sorted({*merged["position", j], *merged.pop((channel, j), [])})
    return merged


def find_flips(found: list[Relation]) -> list[tuple[str, int]]:
    """(channel, joint) whose sign is flipped, from the relations in which the sign is known."""
    flipped: dict[str, set[int]] = {}
    kept: dict[str, set[int]] = {}
    for relation in found:
        name = "/".join(relation.channels[:2])
        sure = np.diagonal(relation.left) < INFORMATIVE
        flipped[name] = set(np.flatnonzero(sure & (relation.sign < 0).all(axis=0)).tolist())
        kept[name] = set(np.flatnonzero(sure & (relation.sign > 0).all(axis=0)).tolist())
    none: set[int] = set()
    velocity = flipped.get("velocity/position", none)
    command = flipped.get("position/position_command", none)
    valve = flipped.get("position/valve_command", none)
    moved = {"position": velocity & (command | (valve - kept.get("position/position_command", none)))}
    moved["velocity"] = velocity - moved["position"]
    moved["position_command"] = command - moved["position"]
    moved["valve_command"] = valve - moved["position"]
    pull = flipped.get("effort/position_command", none) - moved["position"] - moved["position_command"]
    demand = flipped.get("effort/effort_command", none)
    moved["effort"] = pull & (demand | (pull - kept.get("effort/effort_command", none)))
    moved["effort"] |= demand - kept.get("effort/position_command", none)
    moved["effort_command"] = demand - moved["effort"]
    return [(channel, j) for channel, joints in moved.items() for j in sorted(joints)]


def _swapped(log_set: LogSet, cycle: tuple[int, ...], files: dict[str, Gains]) -> Defect:
    totals: dict[tuple[str, ...], float] = defaultdict(float)
    for gains in files.values():
        for channels, gain in gains.items():
            totals[channels] += gain
    channels = max(totals, key=lambda name: totals[name])
    ratio = np.exp(np.median([gains[channels] for gains in files.values() if channels in gains]))
    names = tuple(log_set.joints[j] for j in cycle)
    turn = f"{names[0]} and {names[1]}" if len(names) == 2 else " → ".join((*names, names[0]))
    text = (
        f"{' and '.join(channels)} of {turn} swapped {where(tuple(files), len(log_set.trials))}"
        + (" (or all their other channels)" if len(channels) > 1 else "")
        + ": put back, the squared errors with which these joints' channels explain each other fall by a factor "
        f"of {ratio:.3g} in all; rename the columns"
    )
    one = channels[0] if len(channels) == 1 else None
    return Defect("swapped", tuple(files), names, one, text, fatal=True, channels=channels)


def _backwards(log_set: LogSet, files: list[str]) -> list[Defect]:
    if not files:
        return []
    text = (
        f"the rows run backwards in time {where(tuple(files), len(log_set.trials))}: every velocity opposes the "
        "motion, and joints move before they are commanded; restore the order in which the rows were recorded"
    )
    samples = {trial.file: trial.trajectory.samples for trial in log_set.trials}
    order = {file: np.arange(samples[file])[::-1] for file in files}
    return [Defect("rows_out_of_order", tuple(files), (), None, text, fatal=True, order=order)]


def _flipped(log_set: LogSet, flips: dict[tuple[str, int], list[str]]) -> list[Defect]:
    grouped: dict[tuple[str, tuple[str, ...]], list[str]] = defaultdict(list)
    for (channel, j), files in flips.items():
        grouped[channel, tuple(files)].append(log_set.joints[j])
    against = {
        "velocity": "runs against the derivative of its position",
        "position": "runs against its velocity and its command",
        "position_command": "is answered by a motion away from it (or position and velocity are flipped)",
        "valve_command": "is answered by a motion away from it",
        "effort": "pulls away from the command",
        "effort_command": "is answered by a torque of the other sign",
    }
    defects = []
    for (channel, files), joints in grouped.items():
        what = f"{against[channel]}: its sign is flipped; multiply it by −1"
        defects.append(of_channel("sign_flipped", channel, joints, files, len(log_set.trials), what))
    return defects
