"""Channels judged by their values: a velocity that is not the derivative of the position, clipped sensors, and dead ones."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from hqpipe.gap.checks.defect import Defect, of_channel
from hqpipe.gap.checks.sanity_dead import CLEAR_TRAVEL, CLIP_RUNS, dead_defects
from hqpipe.gap.checks.sanity_order import count, white_noise
from hqpipe.logs.trajectory import LogSet, Trajectory

SPANS_S = (0.02, 0.06, 0.2, 0.6)  # over which travel and integrated velocity are compared; the best one counts
ALIKE = 0.9  # squared correlation from which the slope between the two is that of their units; assumption
UNLIKE = 0.5  # squared correlation below which one is not the derivative of the other; assumption
TOLERANCE = 0.1  # of the slope: low-pass filters and encoder errors stay below it; assumption
BLOCKS = 16
SIGMAS = 5.0
UNITS = {  # slope of the integrated velocity on the travel → what it means
    180.0 / np.pi: "degrees per second (× 0.0174533)",
    np.pi / 180.0: "radians per second where the position is in degrees",
    30.0 / np.pi: "revolutions per minute (× 0.10472)",
    0.5 / np.pi: "revolutions per second (× 6.28319)",
    1000.0: "mm/s where the position is in m (× 0.001)",
    0.001: "m/s where the position is in mm",
}
UNIT_MATCH = 0.05
SAME_FACTOR = 0.05  # of a slope, by which joints and trials with the same one differ at most; assumption, as above
CLIP_RUN = 5  # samples on end at the extreme, and `CLIP_RUNS` times so; assumption
CLIP_LEVELS = 50  # a signal of fewer levels is a square wave or coarsely quantised
CLIP_SHOWN = 3  # limits in a message
CLIP_SHARE = 0.02  # of the samples: less costs little
CLIP_PILE = 10.0  # × as many samples at the extreme as on a level of the decile below it; assumption
_MEASURED = ("effort", "velocity", "pressure_a", "pressure_b")
Places = dict[tuple[str, int], dict[str, tuple[float, float]]]
"""(channel, joint) → file → what was found there, see `clip`."""
_LIMITED_DRIVE = ("current", "estimate")  # such an effort is clipped where the drive itself is


def value_defects(log_set: LogSet, skip: set[tuple[str, str]]) -> list[Defect]:
    """Wrong velocities, dead channels, clipped channels.

    Args:
        log_set: trials of one machine.
        skip: (channel, file) that other checks have found broken.
    """
    slopes: dict[int, dict[str, float | None]] = defaultdict(dict)
    clipped: Places = defaultdict(dict)
    for trial in log_set.trials:
        t, file = trial.trajectory, trial.file
        broken = {channel for channel, where_ in skip if where_ == file}
        if t.velocity_source == "measured" and not broken & {"position", "velocity"}:
            for j, slope in velocity_slopes(t).items():
                slopes[j][file] = slope
        for name, values in t.channels().items():
            if name in broken or (name == "velocity" and t.velocity_source != "measured"):
                continue
            if name in _MEASURED:
                for j in range(len(t.joints)):
                    if found := clip(values[:, j]):
                        clipped[name, j][file] = found
    return _velocity(log_set, slopes) + dead_defects(log_set, skip) + _clipped(log_set, clipped)


def velocity_slopes(t: Trajectory) -> dict[int, float | None]:
    """Joint that moves → slope of the integrated velocity on the travel, 1 where it may be ±1, None if they are unlike.

    Over spans from 20 ms to 0.6 s the displacement is compared with the integral of the velocity. Noise in both
    biases either regression towards a smaller slope; the true one lies between the regression of each on the
    other (Frisch, 1934), and only a slope outside is reported.
    """
    total = np.concatenate([np.zeros((1, len(t.joints))), np.cumsum(t.velocity, axis=0)]) * t.dt
    noise = white_noise(t.position) + count(t.position), white_noise(t.velocity) * t.dt
    best = np.full(len(t.joints), -1.0)
    found: dict[int, float | None] = {}
    for span_s in SPANS_S:
        span = max(2, round(span_s / t.dt))
        now = np.arange(0, t.samples - span, max(1, span // 2))
        if len(now) < 2 * BLOCKS:
            break
        travel = t.position[now + span] - t.position[now]
        summed = total[now + span] - total[now]
        travel, summed = travel - travel.mean(axis=0), summed - summed.mean(axis=0)
        clear = travel.std(axis=0) > CLEAR_TRAVEL * noise[0]
        clear &= summed.std(axis=0) > CLEAR_TRAVEL * noise[1] * np.sqrt(span)
        xx, xy, yy = _blocks(travel, travel), _blocks(travel, summed), _blocks(summed, summed)
        power = np.maximum(xx.sum(axis=0) * yy.sum(axis=0), np.finfo(float).tiny)
        likeness = xy.sum(axis=0) ** 2 / power
        for j in np.flatnonzero(clear & (likeness > best)):
            best[j] = likeness[j]
            found[int(j)] = _odd_slope(xx[:, j], xy[:, j], yy[:, j], float(likeness[j]))
    return {j: None if slope == 0.0 else slope for j, slope in found.items()}


def _blocks(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    edges = np.linspace(0, len(a), BLOCKS, endpoint=False).astype(int)
    return np.add.reduceat(a * b, edges, axis=0)


def _odd_slope(xx: np.ndarray, xy: np.ndarray, yy: np.ndarray, likeness: float) -> float:
    """The slope if it is clearly not ±1; 1 if it may be, 0 if the two signals are unlike."""
    if likeness < UNLIKE:
        return 0.0
    lower, upper = xy.sum() / xx.sum(), yy.sum() / xy.sum()
    each = np.array([(xy.sum() - xy) / (xx.sum() - xx), (yy.sum() - yy) / (xy.sum() - xy)])
    error = np.sqrt((BLOCKS - 1) * np.mean((each - each.mean(axis=1, keepdims=True)) ** 2, axis=1))
    low, high = sorted((abs(lower), abs(upper)))
    margin = SIGMAS * float(error.max())
    off = low - margin > 1.0 + TOLERANCE or high + margin < 1.0 - TOLERANCE
    return float(np.sign(lower) * np.sqrt(abs(lower * upper))) if off and likeness > ALIKE else 1.0


def _velocity(log_set: LogSet, slopes: dict[int, dict[str, float | None]]) -> list[Defect]:
    groups: dict[tuple[str, tuple[str, ...]], list[tuple[int, float | None]]] = defaultdict(list)
    for j, files in slopes.items():
        odd = {file: slope for file, slope in files.items() if slope != 1.0}
        known = [slope for slope in odd.values() if slope is not None]
        slope = float(np.median(known)) if known else None
        if odd:
            groups[_meaning(slope), tuple(odd)].append((j, slope))
    common = _common(slopes)
    defects = []
    for (meaning, files), members in groups.items():
        joints = tuple(log_set.joints[j] for j, _ in members)
        slope = members[0][1]
        what = "is unlike the derivative of its position"
        if slope is not None:
            what = f"is {slope:.4g} times the derivative of its position"
        fix = "correct it, or leave the column out and have it differentiated"
        if common and not meaning:
            meaning = ", as in every joint and trial that moves: the clock of the log may run at another rate "
            meaning += f"(time × {1.0 / common:.4g})"
            fix = "correct the clock if it is that, else the unit of the positions or velocities"
        what += f"{meaning}; {fix}"
        defects.append(of_channel("velocity_mismatch", "velocity", joints, files, len(log_set.trials), what))
    return defects


def _common(slopes: dict[int, dict[str, float | None]]) -> float | None:
    """The slope that all joints have in all trials in which they move; None where there is none but ±1."""
    found = [slope for files in slopes.values() for slope in files.values()]
    if not found or None in found or 1.0 in found:
        return None
    common = float(np.median(found))
    return common if common > 0.0 and np.ptp(found) < SAME_FACTOR * common else None


def _meaning(slope: float | None) -> str:
    if slope is None:
        return ""
    for factor, text in UNITS.items():
        if abs(abs(slope) / factor - 1.0) < UNIT_MATCH:
            return f": it looks like {text}"
    return ""


def clip(values: np.ndarray) -> tuple[float, float] | None:
    """Limit at which a (T,) signal is cut off, and the share of samples there; None if it is not."""
    for limit in (values.max(), values.min()):
        stuck = values == limit
        share = float(stuck.mean())
        if limit == 0.0 or share < CLIP_SHARE:
            continue
        edges = np.flatnonzero(np.diff(np.concatenate(([0], stuck.astype(np.int8), [0]))))
        runs = edges[1::2] - edges[::2]
        levels, numbers = np.unique(values, return_counts=True)
        near = np.abs(levels - limit) < 0.1 * np.ptp(values)
        near &= levels != limit
        usual = numbers[near].mean() if near.any() else 1.0
        if (runs >= CLIP_RUN).sum() >= CLIP_RUNS and len(levels) >= CLIP_LEVELS and stuck.sum() > CLIP_PILE * usual:
            return float(limit), share
    return None


def _clipped(log_set: LogSet, clipped: Places) -> list[Defect]:
    groups: dict[tuple[str, tuple[str, ...]], list[int]] = defaultdict(list)
    for (name, j), files in clipped.items():
        groups[name, tuple(files)].append(j)
    values = {trial.file: trial.trajectory for trial in log_set.trials}
    defects = []
    for (name, files), members in groups.items():
        own = name == "effort" and log_set.effort_source in _LIMITED_DRIVE
        limits = [max(clipped[name, j].values(), key=lambda item: item[1]) for j in members]
        figures = ", ".join(f"{limit:.6g} ({share:.0%} of the rows)" for limit, share in limits[:CLIP_SHOWN])
        what = f"cut off at {figures}" + (
            ": the drive's own limit, or the sensor's; widen the range if it is the sensor's"
            if own
            else ": values beyond the sensor's range are lost; widen its range"
        )
        rows = {
            (file, log_set.joints[j]): np.flatnonzero(getattr(values[file], name)[:, j] == clipped[name, j][file][0])
            for j in members
            for file in files
        }
        joints = [log_set.joints[j] for j in members]
        defects.append(
            of_channel("saturated", name, joints, files, len(log_set.trials), what, fatal=not own, rows=rows)
        )
    return defects
