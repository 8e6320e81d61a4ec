"""Sensors that stand still while their joint moves."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from hqpipe.gap.checks.defect import Defect, of_channel
from hqpipe.gap.checks.sanity_order import count, white_noise
from hqpipe.logs.differentiate import differentiate
from hqpipe.logs.trajectory import LogSet, Trajectory

FROZEN_ROWS = 20  # a shorter run of one value is rounding or a pause; assumption
FROZEN_FACTOR = 10.0  # × the travel of the partner in the longest usual run of one value; assumption
FROZEN_SHARE = 0.2  # of the partner's standard deviation, likewise
FROZEN_COUNTS = 20.0  # of the position, that the joint travels meanwhile: stiction holds it within less; assumption
STILL_SHARE = 0.02  # of the samples: less costs little
CLIP_RUNS = 3  # runs at the limit of a channel that is clipped and not dead; assumption
CLEAR_TRAVEL = (
    5.0  # × the noise of a travel or a speed: what is less shows no motion, and need not agree with others; assumption
)
DEAD = "the joint's other channels move: the sensor or its line is dead there; cut the trial, or drop the channel"
STUCK = "its command moves: the joint sticks or is held, or the sensor is dead; log the speed, which tells them apart"


def dead_defects(log_set: LogSet, skip: set[tuple[str, str]]) -> list[Defect]:
    """Channels that stand still while others say that the joint moves.

    A command says it of a position only beside a measured speed: a joint that sticks does not follow its command. Where no
    speed was measured nothing is left out for it.

    Args:
        log_set: trials of one machine. skip: (channel, file) that other checks have found broken.
    """
    trials = {trial.file: trial.trajectory for trial in log_set.trials}
    unit = _usual_count(log_set)
    found: dict[tuple[str, int, bool], dict[str, np.ndarray]] = defaultdict(dict)
    for file, t in trials.items():
        measured = t.velocity_source == "measured"
        for name in t.channels():
            if (name, file) in skip or (name == "velocity" and not measured):
                continue
            for j, rows in _still(t, name, unit).items():
                found[name, j, name != "position" or measured][file] = rows
    groups: dict[tuple[str, bool, tuple[str, ...]], list[int]] = defaultdict(list)
    for (name, j, dead), files in found.items():
        groups[name, dead, tuple(files)].append(j)
    defects = []
    for (name, dead, files), members in groups.items():
        rows = {(file, log_set.joints[j]): found[name, j, dead][file] for j in members for file in files}
        share = max(len(there) / trials[file].samples for (file, _), there in rows.items())
        what = f"stands still for {share:.0%} of the rows while {DEAD if dead else STUCK}"
        joints = [log_set.joints[j] for j in members]
        defects.append(of_channel("constant", name, joints, files, len(trials), what, fatal=dead, rows=rows))
    return defects


def _usual_count(log_set: LogSet) -> np.ndarray:
    """(J,) count of the position, the median of the trials that show one; of a joint that never does, the largest of all."""
    counts = np.array([count(trial.trajectory.position) for trial in log_set.trials])
    known = [np.median(column[column > 0.0]) if (column > 0.0).any() else 0.0 for column in counts.T]
    return np.where(np.array(known) > 0.0, known, max(known))


def _partners(t: Trajectory, name: str, least: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Channels none of which changes much while `name` stands still, and by how much they must at least, (J,).

    A command may rest, so it has none. A speed of a few counts is none: what it adds up to says nothing.

    Args:
        least: (J,) travel of the position that counts.
    """
    nothing = np.zeros(len(t.joints))
    command = [] if t.position_command is None else [(t.position_command, least)]
    if name == "position":
        clear = np.where(np.abs(t.velocity) > CLEAR_TRAVEL * count(t.velocity), t.velocity, 0.0)
        speed = [(np.cumsum(clear, axis=0) * t.dt, least)] if t.velocity_source == "measured" else []
        return speed + command
    if name == "velocity":
        return [(differentiate(t.position, t.dt), nothing), (t.position, least)]
    error = [(t.position_command - t.position, least)] if command else [(t.position, least)]
    return error if name in ("effort", "pressure_a", "pressure_b") else []


def _still(t: Trajectory, name: str, unit: np.ndarray) -> dict[int, np.ndarray]:
    """Joint → (K,) rows in which the channel stands still while its partners travel as they never do else.

    Args:
        unit: (J,) one count of the position.
    """
    found: dict[int, np.ndarray] = {}
    counted = count(t.position)
    least = FROZEN_COUNTS * np.where(counted > 0.0, counted, unit)  # a dead encoder shows no count of its own
    values, partners = getattr(t, name), _partners(t, name, least)
    for j in range(len(t.joints) if partners else 0):
        edges = np.flatnonzero(np.diff(values[:, j]) != 0)
        start, stop = np.concatenate([[0], edges + 1]), np.concatenate([edges, [t.samples - 1]])
        long = stop - start >= FROZEN_ROWS
        if not long.any():
            continue
        held = values[start, j]
        for limit in (values[:, j].min(), values[:, j].max()):
            returns = (held == limit).sum() >= CLIP_RUNS  # to its limit: such a channel is clipped, not dead
            if returns or (len(held) > 1 and name not in ("position", "velocity")):
                long &= held != limit
        for partner, least_way in partners:
            long &= _travels(partner[:, j], start, long, least_way[j])
        if name == "position" and t.velocity_source == "measured":
            for k in np.flatnonzero(long):
                rows = slice(start[k], stop[k] + 1)
                long[k] = _shows_motion(t.velocity[rows, j], t.recorded[rows, j], t.dt, least[j])
        if long.any() and (stop - start + 1)[long].sum() > STILL_SHARE * t.samples:
            still = [np.arange(a, b + 1) for a, b in zip(start[long], stop[long], strict=True)]
            found[j] = np.concatenate(still)
    return found


def _shows_motion(speed: np.ndarray, recorded: np.ndarray, dt: float, least: float) -> bool:
    """Whether a speed is that of a joint that moves in some part of a run, and not what its sensor reads at rest.

    Parts are the run, its halves, their halves and so on: a motion to and fro adds up to no more in a long part than in a short
    one, but noise does.

    Args:
        speed, recorded: (T,). dt: s. least: way that counts.
    """
    steps = np.abs(np.diff(speed[recorded]))
    usual = np.median(steps[steps > 0.0]) if steps.any() else 0.0
    parts = 1
    while len(speed) >= parts * FROZEN_ROWS:
        cuts = zip(np.array_split(speed, parts), np.array_split(recorded, parts), strict=True)
        if any(_is_motion(part, seen, dt, least, usual) for part, seen in cuts):
            return True
        parts *= 2
    return False


def _is_motion(speed: np.ndarray, recorded: np.ndarray, dt: float, least: float, step: float) -> bool:
    """Whether a speed (T,) goes through more than a few steps, and adds up to more than at rest.

    There it is an offset, and noise or a count that toggles. A constant adds up to any way, so that it is taken off, and a
    joint at constant speed is not found. White noise of σ adds up to σ·dt·√T; third differences leave 20 σ² of it, of a rare
    count 20 times its variance too. What was interpolated has no noise of its own.
    """
    seen = speed[recorded]
    if len(seen) <= 3 or np.ptp(speed) <= 2.0 * CLEAR_TRAVEL * step:
        return False
    way = np.ptp(np.cumsum(speed - speed.mean())) * dt
    noise = np.sqrt(np.mean(np.diff(seen, 3) ** 2) / 20.0) * dt * len(speed) / np.sqrt(len(seen))
    return bool(way > max(least, CLEAR_TRAVEL * noise))


def _travels(partner: np.ndarray, start: np.ndarray, long: np.ndarray, least: float) -> np.ndarray:
    """(runs,) True where the partner travels within a run of one value as it does in no usual run."""
    travel = np.maximum.reduceat(partner, start) - np.minimum.reduceat(partner, start)
    usual = np.quantile(travel[~long], 0.99) if (~long).sum() > FROZEN_ROWS else 0.0
    noise = white_noise(partner[:, None])[0]
    return travel > max(FROZEN_FACTOR * usual, FROZEN_SHARE * partner.std(), 2.0 * CLEAR_TRAVEL * noise, least)
