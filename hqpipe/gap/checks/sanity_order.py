"""Rows out of order, and rows that repeat the one before.

A position is the double integral of a force, and forces, pressures and speeds follow from what was before:
successive samples of a moving joint resemble each other. Rows put into a random order do not, at any lag. What tells
them from a sensor that shows nothing but its own noise is that the values agree with something else: with the other
channels of the same row, with the joint's motion in the other channels, or with the same channel in another trial.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hqpipe.gap.checks.defect import Defect, of_channel, where
from hqpipe.logs.trajectory import LogSet, Trajectory

LAGS = (1, 2, 3, 5, 8, 16, 32, 64, 128)
SIGMAS = 5.0  # serial correlation of T independent rows has the standard deviation 1/√T; over all columns one in 10⁴
MIN_COUNTS = 3.0  # standard deviation in steps of the sensor: a signal of fewer is its own rounding
ROUNDING = 1e-12  # of a channel's values: a constant one, as its mean rounds
SMOOTH = 0.8  # serial correlation above which a channel counts as sampled motion; assumption
AGREEMENT = 0.3  # correlation that noise does not reach, of two sensors or of one with itself; assumption
CARRIES = 0.5  # of a channel's usual size, below which a trial may hold its noise only; assumption
CLEARER = 10.0  # × the white noise of the same channel in another trial; assumption
JUMP_ROWS = 5.0  # a position step this many times that of the speed around it; assumption
JUMP_SIGMAS = 20.0  # and this many times the usual disagreement of position and velocity; assumption
NEIGHBOURS = 3  # rows on both sides among which the greatest speed is taken
SOUND_ROWS = 50  # over which travel and velocity are compared: more than rows are usually displaced; assumption
SOUND = 0.5  # share of the usual ratio of the two by which three quarters of the fast rows may differ; assumption
ROW_ERROR = 0.2  # standard error, in rows, up to which the row's step tells how far it lies from its neighbour
MIN_ROWS = 100
MIN_JOINTS = 3  # that must tell a row's place together: two agree by chance
DISORDER = 0.02  # share of rows that step backwards; assumption: impacts make fewer
COMMAND_REACH_S = 1.0  # s within which a joint answers its command; assumption: heavy machines need tenths
HELD_SHARE = 1e-3  # of the moving rows; assumption
MIN_HELD = 10  # times; fewer may be chance
HELD_FATAL = 0.5  # of the moving rows: the log then holds less than half of the rate that its clock claims
HELD_SPAN = 8  # rows on both sides over which a channel must travel
HELD_TRAVEL = 3.0  # steps of the sensor per row, so that rounding cannot repeat a sample
_DRIVEN = (
    "position_command",
    "effort_command",
    "valve_command",
)  # held between the ticks of a slower controller, rightly
_SAME_ORIGIN = ("effort", "pressure_a", "pressure_b", "valve_command")  # may share the noise of one sensor


def order_defects(log_set: LogSet) -> list[Defect]:
    """Shuffled rows or channels, jumps in the order, and held samples."""
    found: list[Defect] = []
    smooth, usual = _noise_elsewhere(log_set), _usual_size(log_set)
    shuffled: dict[str, dict[str, list[str]]] = {}
    whole: list[str] = []
    for trial in log_set.trials:
        columns = _shuffled(trial.trajectory, smooth, usual)
        carried = {name for name, _ in columns}
        if len(carried - set(_SAME_ORIGIN)) > 1:
            whole.append(trial.file)
            continue
        for name, j in columns:
            shuffled.setdefault(name, {}).setdefault(trial.file, []).append(log_set.joints[j])
    if whole:
        found.append(_whole_trial(tuple(whole), len(log_set.trials), "no row resembles the one before it"))
    for name, files in shuffled.items():
        found.append(_one_channel(name, files, len(log_set.trials)))
    broken = {file for name in ("position", "velocity") for file in shuffled.get(name, {})} | set(whole)
    jumbled = {
        t.file: disorder for t in log_set.trials if t.file not in broken and (disorder := _disorder(t.trajectory))
    }
    for jumps in (True, False):  # each is mended, and proven, in its own way
        if alike := {file: d for file, d in jumbled.items() if (d.order is None) == jumps}:
            defect = _whole_trial(tuple(alike), len(log_set.trials), next(iter(alike.values())).text)
            rows = {(file, None): d.rows for file, d in alike.items()} if jumps else {}
            order = {} if jumps else {file: d.order for file, d in alike.items()}
            found.append(replace(defect, rows=rows, order=order))
    return found + _held(log_set, set(whole) | set(jumbled), shuffled)


def _whole_trial(files: tuple[str, ...], total: int, what: str) -> Defect:
    text = (
        f"rows out of order {where(files, total)}: {what}; restore the rows in the order in which they were "
        "recorded, together with their time"
    )
    return Defect("rows_out_of_order", files, (), None, text, fatal=True)


def _one_channel(name: str, files: dict[str, list[str]], total: int) -> Defect:
    joints = tuple(dict.fromkeys(joint for listing in files.values() for joint in listing))
    what = (
        "no sample resembles the one before it, although the joint moves smoothly: the rows of this channel are out of "
        "order, or it holds noise only; record it again"
    )
    cells = frozenset((file, joint) for file, listing in files.items() for joint in listing)
    return of_channel("rows_out_of_order", name, joints, tuple(files), total, what, cells=cells)


@dataclass(frozen=True, eq=False)
class _Disorder:
    """What shows that rows are displaced: jumps at some rows, or an order in which they would not step backwards."""

    text: str
    rows: np.ndarray
    order: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class _Serial:
    """Per joint: serial correlation at the first lag, its greatest size over all lags, and usable at all."""

    first: np.ndarray
    greatest: np.ndarray
    alive: np.ndarray

    def independent(self, samples: int) -> np.ndarray:
        """(J,) True where no correlation is left at any lag, and there are rows enough to see a slight one."""
        chance = SIGMAS / np.sqrt(samples)
        return self.alive & (self.greatest < chance) & (chance < AGREEMENT)


def _serial(values: np.ndarray) -> _Serial:
    centred = values - values.mean(axis=0)
    power = np.mean(centred**2, axis=0)
    lags = [lag for lag in LAGS if lag < len(values) // 4]
    safe = np.maximum(power, np.finfo(float).tiny)
    r = np.array([np.mean(centred[lag:] * centred[:-lag], axis=0) / safe for lag in lags])
    alive = np.ptp(values, axis=0) > ROUNDING * np.abs(values).max(axis=0)
    alive &= np.sqrt(power) > MIN_COUNTS * count(values)
    return _Serial(r[0], np.abs(r).max(axis=0), alive)


def count(values: np.ndarray) -> np.ndarray:
    """(J,) small step between successive values of (T, J): one count of a digital sensor, ~0 for floats.

    It is the first percentile of the steps, so that a few odd ones, as at a clipped peak, do not count.
    """
    steps = np.abs(np.diff(values, axis=0))
    least = 1e-12 * np.ptp(values, axis=0)
    found = np.zeros(values.shape[1])
    for j in range(values.shape[1]):
        moving = steps[steps[:, j] > least[j], j]
        if len(moving):
            rank = len(moving) // 100
            found[j] = np.partition(moving, rank)[rank]
    return found


def white_noise(values: np.ndarray) -> np.ndarray:
    """(J,) standard deviation of what third differences leave of (T, J); those of white noise have 20 σ²."""
    third = np.diff(values, 3, axis=0)
    return np.sqrt(np.median(third**2, axis=0) / 0.455 / 20.0)  # the median of a squared normal number is 0.455 σ²


def _noise_elsewhere(log_set: LogSet) -> dict[str, np.ndarray]:
    """Per channel (trials, J): white noise where the channel is smooth, infinite where it is not."""
    found = {}
    for name in log_set.trials[0].trajectory.channels():
        rows = []
        for trial in log_set.trials:
            values = getattr(trial.trajectory, name)
            noise = np.maximum(white_noise(values), count(values))  # at rest a coarse sensor shows no noise
            rows.append(np.where(_serial(values).first > SMOOTH, noise, np.inf))
        found[name] = np.array(rows)
    return found


def _usual_size(log_set: LogSet) -> dict[str, np.ndarray]:
    """Per channel (J,) median over the trials of its standard deviation."""
    trials = [trial.trajectory for trial in log_set.trials]
    return {name: np.median([getattr(t, name).std(axis=0) for t in trials], axis=0) for name in trials[0].channels()}


def _shuffled(t: Trajectory, elsewhere: dict[str, np.ndarray], usual: dict[str, np.ndarray]) -> list[tuple[str, int]]:
    """(channel, joint) whose rows are independent although they carry a signal.

    Args:
        elsewhere: channel → (trials, J) noise of the smooth ones. usual: channel → (J,) its size; a channel that shows far
            less has nothing to carry.
    """
    channels = t.channels()
    if t.velocity_source != "measured":
        del channels["velocity"]
    serial = {name: _serial(values) for name, values in channels.items()}
    loose = {name: s.independent(t.samples) for name, s in serial.items()}
    if not any(flags.any() for flags in loose.values()):
        return []
    moving = serial["position"].alive & (serial["position"].first > SMOOTH)
    found = []
    for name, flags in loose.items():
        spread = channels[name].std(axis=0)
        known = spread > CLEARER * np.median(elsewhere[name], axis=0)
        for j in np.flatnonzero(flags):
            told = known[j] or _agrees(channels, loose, name, j)
            told = told or (spread[j] > CARRIES * usual[name][j] and _contradicts(t, name, j, moving[j]))
            if told and not (moving[j] and _belongs(t, channels, loose, name, j)):
                found.append((name, int(j)))
    return found


def _belongs(t: Trajectory, channels: dict[str, np.ndarray], loose: dict[str, np.ndarray], name: str, j: int) -> bool:
    """Whether a column of independent rows follows the smooth channels of its joint: noisy, or slowly logged, but in order.

    A torque that changes faster than it is logged resembles no sample before it, and follows the motion none the less. Ranks
    are compared, for a few great values of both would meet by chance.
    """
    from scipy.stats import rankdata

    reach = _reach(t)
    mine = rankdata(channels[name][1:, j])
    for other in (other for other, flags in loose.items() if other != name and not flags[j]):
        smooth = channels[other][:, j]
        change = np.diff(smooth)
        for signal in (smooth[1:], change, np.abs(change), np.sign(change)):
            if _likeness(mine, rankdata(signal), reach) > SIGMAS / np.sqrt(t.samples):
                return True
    return False


def _agrees(channels: dict[str, np.ndarray], loose: dict[str, np.ndarray], name: str, j: int) -> bool:
    """Whether a column agrees, row by row, with another column of independent rows that has its own sensor."""
    x = channels[name][:, j] - channels[name][:, j].mean()
    least = max(AGREEMENT, SIGMAS / np.sqrt(len(x)))
    for other, flags in loose.items():
        own_command = {name, other} == {"position", "position_command"}
        kept = np.array([i for i in np.flatnonzero(flags) if i != j or own_command], dtype=int)
        if len(kept):
            y = channels[other][:, kept] - channels[other][:, kept].mean(axis=0)
            if (np.abs(x @ y) > least * np.linalg.norm(x) * np.linalg.norm(y, axis=0)).any():
                return True
    return False


def _contradicts(t: Trajectory, name: str, j: int, moving: bool) -> bool:
    """Whether the joint's other channels say that this one should be smooth."""
    if name == "position":
        size = t.position[:, j].std()
        command = t.position_command
        driven = command is not None and _serial(command[:, [j]]).first[0] > SMOOTH
        return bool(driven and 0.1 * command[:, j].std() < size < 10.0 * command[:, j].std())
    if name == "velocity":
        travelled = np.abs(np.diff(t.position[:: max(1, round(0.02 / t.dt)), j])).mean() / max(0.02, t.dt)
        return bool(moving and travelled > 0.1 * np.abs(t.velocity[:, j]).mean())
    if name in ("position_command", "valve_command"):
        return bool(moving) and _ignored(t, name, j)
    return bool(moving) and name not in _DRIVEN  # noise may be commanded on purpose


def _ignored(t: Trajectory, name: str, j: int) -> bool:
    """Whether a joint moves as if its random command, which is no small dither, did not exist."""
    command, position = getattr(t, name)[1:, j], t.position[1:, j]
    if name == "position_command" and command.std() < 0.1 * position.std():
        return False
    answers = (position, np.diff(t.position[:, j]))
    return not any(_likeness(answer, command, _reach(t)) > SIGMAS / np.sqrt(t.samples) for answer in answers)


def _reach(t: Trajectory) -> int:
    """Rows within which one channel of a joint answers another."""
    return min(round(COMMAND_REACH_S / t.dt), t.samples // 4)


def _likeness(answer: np.ndarray, given: np.ndarray, reach: int) -> float:
    """Greatest correlation, by size, of (T,) with what was given up to `reach` rows before."""
    length = 2 ** int(np.ceil(np.log2(2 * len(given))))
    spectrum = np.fft.rfft(_unit(answer), length) * np.conj(np.fft.rfft(_unit(given), length))
    return float(np.abs(np.fft.irfft(spectrum, length)[: reach + 1]).max())


def _unit(values: np.ndarray) -> np.ndarray:
    """(T,) without its mean, of length 1."""
    return (values - values.mean()) / (np.linalg.norm(values - values.mean()) + np.finfo(float).tiny)


def _disorder(t: Trajectory) -> _Disorder | None:
    """Steps of the position that contradict the velocity around them."""
    sound = _sound(t)
    if not sound.any():
        return None
    step, speed = np.diff(t.position[:, sound], axis=0), t.velocity[:, sound]
    expected = 0.5 * (speed[1:] + speed[:-1]) * np.diff(t.time)[:, None]
    expected *= np.sum(expected * step, axis=0) / np.sum(expected**2, axis=0)  # a wrong unit is another defect
    error = step - expected
    usual = 1.4826 * np.median(np.abs(error), axis=0) + count(t.position[:, sound]) + np.finfo(float).tiny
    reach = _greatest_near(np.abs(expected))
    jump = (np.abs(error) > JUMP_SIGMAS * usual) & (np.abs(step) > JUMP_ROWS * reach + JUMP_SIGMAS * usual)
    moving = int((np.sqrt(np.mean(expected**2, axis=0)) > usual).sum())
    rows = np.flatnonzero(jump.sum(axis=1) >= min(2, moving)) if moving else np.array([], dtype=int)
    if len(rows) and not _repeats(t, rows).all():
        text = f"the positions jump at row {rows[0] + 1} ({len(rows)} such rows) by more than the speed there allows"
        return _Disorder(text, rows + 1)
    return _backwards(step, expected)


def _sound(t: Trajectory) -> np.ndarray:
    """(J,) joints whose position follows their velocity over many rows, whatever happens from row to row."""
    span = min(SOUND_ROWS, t.samples // 8)
    total = np.concatenate([np.zeros((1, len(t.joints))), np.cumsum(t.velocity, axis=0)]) * t.dt
    summed, travel = total[span:-1] - total[: -span - 1], t.position[span:] - t.position[:-span]
    sound = np.zeros(len(t.joints), dtype=bool)
    for j in range(len(t.joints)):
        fast = np.abs(summed[:, j]) > np.median(np.abs(summed[:, j]))
        if fast.any():
            ratio = travel[fast, j] / summed[fast, j]
            middle = np.median(ratio)
            sound[j] = np.quantile(np.abs(ratio - middle), 0.75) < SOUND * middle
    return sound


def _backwards(step: np.ndarray, expected: np.ndarray) -> _Disorder | None:
    """Rows that all joints together say lie before their predecessor.

    A row that is s rows away from the one before moves every joint by s times what its velocity says; the scatter
    of the joints about one s tells how well it is known. Fewer than three joints do not tell.
    """
    moved = expected.std(axis=0) > 0
    if moved.sum() < MIN_JOINTS:
        return None
    weight = expected[:, moved] / np.mean(expected[:, moved] ** 2, axis=0)
    size = np.sum(weight * expected[:, moved], axis=1) + np.finfo(float).tiny
    rows = np.sum(weight * step[:, moved], axis=1) / size
    left = weight / np.where(expected[:, moved] == 0, 1.0, expected[:, moved])
    scatter = np.sum(left * (step[:, moved] - rows[:, None] * expected[:, moved]) ** 2, axis=1)
    error = np.sqrt(scatter / (moved.sum() - 1) / size)
    said = weight * expected[:, moved]  # how much each joint has to say of a row; one that rests says nothing
    voices = size**2 / (np.sum(said**2, axis=1) + np.finfo(float).tiny)
    clear = (error < ROW_ERROR * np.maximum(1.0, np.abs(rows))) & (voices > MIN_JOINTS - 1)
    if clear.sum() < MIN_ROWS:
        return None
    back = clear & (rows < -0.5)
    share = float(back.sum() / clear.sum())
    if share <= DISORDER:
        return None
    place = np.concatenate([[0.0], np.cumsum(np.where(back, rows, 1.0))])
    text = f"{share:.0%} of the rows step backwards in all joints at once"
    return _Disorder(text, np.flatnonzero(back) + 1, np.argsort(place, kind="stable"))


def _greatest_near(values: np.ndarray) -> np.ndarray:
    from scipy.ndimage import maximum_filter1d

    return maximum_filter1d(values, 2 * NEIGHBOURS + 1, axis=0)


def _repeats(t: Trajectory, rows: np.ndarray) -> np.ndarray:
    """(rows,) True where the position stood still just before: a held sample that catches up, no disorder."""
    before = np.diff(t.position, axis=0)[np.maximum(rows - 1, 0)]
    return (before == 0).all(axis=1)


def _held(log_set: LogSet, skip: set[str], shuffled: dict[str, dict[str, list[str]]]) -> list[Defect]:
    """Channels that repeat samples while they travel."""
    found: dict[str, dict[str, tuple[list[int], float]]] = {}
    for trial in log_set.trials:
        t = trial.trajectory
        if trial.file in skip or t.samples < 4 * HELD_SPAN:
            continue
        for name, values in t.channels().items():
            derived = name == "velocity" and t.velocity_source != "measured"
            if name in _DRIVEN or derived or trial.file in shuffled.get(name, {}):
                continue
            share = held_share(values)
            if (share > HELD_SHARE).any():
                joints = [int(j) for j in np.flatnonzero(share > HELD_SHARE)]
                found.setdefault(name, {})[trial.file] = joints, float(share.max())
    defects = []
    for name, files in found.items():
        joints = tuple(log_set.joints[j] for j in dict.fromkeys(j for js, _ in files.values() for j in js))
        share = max(value for _, value in files.values())
        what = (
            f"{share:.1%} of the rows repeat the sample before while the signal travels: frames were dropped or the "
            "sensor is slower than the log; record at its rate"
        )
        cells = frozenset((file, log_set.joints[j]) for file, (js, _) in files.items() for j in js)
        total, fatal = len(log_set.trials), share > HELD_FATAL
        defects.append(of_channel("held_samples", name, joints, tuple(files), total, what, fatal=fatal, cells=cells))
    return defects


def held_share(values: np.ndarray) -> np.ndarray:
    """(J,) share of the moving rows of (T, J) that repeat the row before and are caught up with at once.

    A joint that sticks also repeats its position, but then sets off slowly; a held sample is followed by one
    step that makes up for all that were lost. Steps small enough for rounding to repeat a sample do not count.
    """
    unit, span = count(values), HELD_SPAN
    step = np.diff(values, axis=0)
    index = np.arange(len(step))[:, None]
    last = np.maximum.accumulate(np.where(step != 0, index, -1), axis=0)
    run = index - 1 - np.vstack([np.full((1, step.shape[1]), -1), last[:-1]])  # zero steps just before this one
    before, after = values[span:-span] - values[: -2 * span], values[2 * span :] - values[span:-span]
    rate = np.minimum(np.abs(before), np.abs(after)) / span
    moving = (before * after > 0) & (rate > HELD_TRAVEL * unit) & (unit > 0)
    middle = slice(span - 1, span - 1 + len(before))
    inside = (values[middle] < values.max(axis=0)) & (values[middle] > values.min(axis=0))  # else it is clipped
    caught = moving & inside & (run[middle] > 0) & (np.abs(step[middle]) > (run[middle] + 0.5) * rate)
    rounded = (moving & (step[middle] != 0) & (np.abs(step[middle]) < 1.5 * unit)).sum(axis=0)  # chance does as often
    same = (moving & (step[middle] == 0)).sum(axis=0)
    real = (caught.sum(axis=0) >= MIN_HELD) & (same > rounded + SIGMAS * np.sqrt(rounded + 1.0))
    held = np.where(caught, np.minimum(run[middle], span), 0).sum(axis=0)
    return np.where(real, held / np.maximum(moving.sum(axis=0), 1), 0.0)
