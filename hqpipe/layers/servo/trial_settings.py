"""Gains and loads that differ between trials without being stated: what each trial's own motion says of them.

A servo is often recorded at several gains and with several loads. Where the log set does not say which, one set of numbers for
all trials describes none of them. The equation of motion of a trial, over its gain r and with its load σ, is

    e = command − q = (σ (J q̈ + gravity) + d q̇ + F sgn q̇ + o) / r + c |e| sgn q̇ − b

with one J, gravity, d, F, o, c and b for all. It is solved by alternating least squares.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hqpipe.layers.servo.scale import Scale
from hqpipe.layers.servo.start import acceleration_of, drive_error
from hqpipe.layers.servo.tracks import Tracks
from hqpipe.logs.joint_kinds import PRISMATIC

CLEARLY = 0.5  # of the squared error of one setting for all: several settings must leave less; assumption
_NOTABLE = 0.15  # logarithm of a ratio; trials that differ by less count as one setting; assumption
_ROUNDS = 25  # of the alternation; it converges within ten
_ROWS = 4_000  # of each trial; assumption: more add nothing to two numbers
_REST = 0.05  # of the largest speed, over which the direction of dry friction turns; assumption
_FAR = 20.0  # ratio beyond which no setting lies; assumption


@dataclass(frozen=True, eq=False)
class TrialSettings:
    """Settings of R trials, as ratios to the setting of most samples.

    Attributes:
        group: (R,) number of the setting of each trial, 0 for that of most samples. gain, load: (G,) ratios of each setting.
        fitted: settings of the fit trials beside 0, whose ratios are free.
        gains, loads: whether gains, and whether loads, differ.
    """

    group: np.ndarray
    gain: np.ndarray
    load: np.ndarray
    fitted: tuple[int, ...] = ()
    gains: bool = False
    loads: bool = False

    def unseen(self, rows: np.ndarray) -> list[int]:
        """Which of the held-out trials have a setting of no fit trial: no fit says how they would move.

        Args:
            rows: indices of the held-out trials into `group`.
        """
        return [k for k, row in enumerate(rows) if self.group[row] not in (0, *self.fitted)]


def one_setting(trials: int) -> TrialSettings:
    """All trials with the same gain and load, or as stated."""
    return TrialSettings(np.zeros(trials, dtype=np.int64), np.ones(1), np.ones(1))


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of one trial: (n,) input, (n, A) what goes with the load, (n, B) what does not, (n, C) what goes with the input."""

    trial: int
    fit: bool
    samples: int
    y: np.ndarray
    load: np.ndarray
    rest: np.ndarray
    own: np.ndarray


def settings_of(
    splits: tuple[Tracks, Tracks], rows: tuple[np.ndarray, np.ndarray], scale: Scale, response_s: float
) -> TrialSettings:
    """Settings of all trials of a joint; one for all where that describes them nearly as well.

    Args:
        splits: fit and held-out. rows: indices of their trials into the numbers of `scale`. response_s: of the joint.
    """
    trials = len(scale.gain)
    free = [
        f
        for f in ((True, False), (False, True), (True, True))
        if (not f[0] or scale.gain_unstated) and (not f[1] or not scale.load)
    ]
    parts = _parts(splits[0], rows[0], scale, response_s, True) + _parts(splits[1], rows[1], scale, response_s, False)
    if not free or sum(part.fit for part in parts) < 2:
        return one_setting(trials)
    best, kept = _solved(parts, False, False), (False, False)
    for gains, loads in free:
        found = _solved(parts, gains, loads)
        if found[0] < CLEARLY * best[0]:
            best, kept = found, (gains, loads)
    if kept == (False, False):
        return one_setting(trials)
    return _grouped(parts, best[1], best[2], trials, *kept)


def _parts(tracks: Tracks, rows: np.ndarray, scale: Scale, response_s: float, fit: bool) -> list[_Rows]:
    if not len(tracks.position):
        return []
    acceleration = acceleration_of(tracks, response_s)
    pull = drive_error(tracks, scale)
    speed = np.abs(tracks.velocity).max() or 1.0
    found = []
    for number, row in enumerate(rows):
        here = np.flatnonzero((tracks.trial == number) & tracks.usable)
        if len(here) < 10:
            continue
        samples = len(here)
        here = here[:: max(1, len(here) // _ROWS)]
        q, v, a = tracks.smooth[here], tracks.velocity[here], acceleration[here]
        if scale.load:
            load = [scale.inertia[row] * a + scale.gravity[row] * np.sin(q)]
        elif scale.kind == PRISMATIC:
            load = [a, np.ones(len(here))]
        else:
            load = [a, np.sin(q), np.cos(q)]
        y, direction = scale.gain[row] * pull[here], np.tanh(v / (_REST * speed))
        rest = [scale.drag[row] * v, direction, np.ones(len(here))]
        own = [np.abs(y) * direction] if scale.duty else [np.abs(y) * direction, -scale.gain[row] * np.ones(len(here))]
        found.append(_Rows(int(row), fit, samples, y, *(np.column_stack(part) for part in (load, rest, own))))
    return found


def _solved(parts: list[_Rows], gains: bool, loads: bool) -> tuple[float, np.ndarray, np.ndarray]:
    """Mean squared residual of the fit trials, over their own mean square, and gain and load of each part."""
    gain, load = np.ones(len(parts)), np.ones(len(parts))
    mine = [k for k, part in enumerate(parts) if part.fit]
    for _ in range(_ROUNDS if gains or loads else 1):
        matrix = np.vstack(
            [np.hstack([load[k] * p.load / gain[k], p.rest / gain[k], p.own]) for k, p in enumerate(parts) if p.fit]
        )
        theta = np.linalg.lstsq(matrix, np.concatenate([parts[k].y for k in mine]), rcond=1e-9)[0]
        sums = [_sums(part, theta) for part in parts]
        for k, (y, a, b) in enumerate(sums):
            gain[k], load[k] = _own(y, a, b, gains, loads)
        gain, load = gain / np.median(gain[mine]), load / np.median(load[mine])
    left = sum(parts[k].samples * _best(*sums[k], gains, loads)[0] for k in mine)
    scale = sum(parts[k].samples * float(np.var(parts[k].y)) for k in mine)
    return left / max(scale, 1e-300), gain, load


def _sums(part: _Rows, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n,) input less what goes with it, torque that goes with the load, torque that does not."""
    first, second = part.load.shape[1], part.load.shape[1] + part.rest.shape[1]
    return part.y - part.own @ theta[second:], part.load @ theta[:first], part.rest @ theta[first:second]


def _own(y: np.ndarray, a: np.ndarray, b: np.ndarray, gains: bool, loads: bool) -> tuple[float, float]:
    """Gain and load of one trial, from its sums."""
    _, (over, share) = _best(y, a, b, gains, loads)
    low, high = 1.0 / _FAR, _FAR
    return float(np.clip(1.0 / max(over, low), low, high)), float(np.clip(share, low, high))


def _best(y: np.ndarray, a: np.ndarray, b: np.ndarray, gains: bool, loads: bool) -> tuple[float, tuple[float, float]]:
    """Mean squared residual of y = (σ a + b) / r, with 1/r and σ."""
    if gains and loads:
        solved = np.linalg.lstsq(np.column_stack([a, b]), y, rcond=1e-9)[0]
        over, share = float(solved[1]), float(solved[0] / solved[1]) if solved[1] else 1.0
    elif gains:
        over, share = float((a + b) @ y / max(float((a + b) @ (a + b)), 1e-300)), 1.0
    elif loads:
        over, share = 1.0, float(a @ (y - b) / max(float(a @ a), 1e-300))
    else:
        over, share = 1.0, 1.0
    return float(np.mean((y - over * (share * a + b)) ** 2)), (over, share)


def _grouped(
    parts: list[_Rows], gain: np.ndarray, load: np.ndarray, trials: int, gains: bool, loads: bool
) -> TrialSettings:
    """Trials of nearly the same ratios as one setting; that of most fit samples is the first."""
    points = np.log(np.column_stack([gain, load]))
    groups: list[list[int]] = []
    for k in np.argsort(points[:, 0] + points[:, 1]):
        if parts[k].fit:
            _joined(groups, points, int(k))
    groups.sort(key=lambda group: -sum(parts[k].samples for k in group))
    centre = [points[group].mean(axis=0) for group in groups]
    fitted = tuple(range(1, len(groups)))
    for k in (k for k, part in enumerate(parts) if not part.fit):  # these take part in no setting of the fit
        away = [float(np.max(np.abs(c - points[k]))) for c in centre]
        near = int(np.argmin(away))
        if away[near] < _NOTABLE:
            groups[near].append(k)
        else:
            groups.append([k])
            centre.append(points[k])
    number = np.zeros(trials, dtype=np.int64)
    for g, group in enumerate(groups):
        for k in group:
            number[parts[k].trial] = g
    ratio = np.exp(np.array(centre) - centre[0])
    if len(groups) == 1:
        return one_setting(trials)
    return TrialSettings(number, ratio[:, 0], ratio[:, 1], fitted, gains, loads)


def _joined(groups: list[list[int]], points: np.ndarray, k: int) -> None:
    """Put a trial into the first group that it is near to, or into one of its own."""
    for group in groups:
        if np.max(np.abs(points[group].mean(axis=0) - points[k])) < _NOTABLE:
            group.append(k)
            return
    groups.append([k])


def moved(settings: TrialSettings, group: int, gain: float, load: float) -> TrialSettings:
    """With other ratios of one setting."""
    own = settings.gain.copy(), settings.load.copy()
    own[0][group], own[1][group] = gain, load
    return replace(settings, gain=own[0], load=own[1])


def settings_note(joint: str, settings: TrialSettings, files: list[str], group: np.ndarray) -> str:
    """A sentence on gains and loads that differ between trials without being stated; empty where none do.

    Args:
        files: of all trials. group: (R,) setting of each of them.
    """
    what = [name for name, differs in (("gain", settings.gains), ("load", settings.loads)) if differs]
    if not what:
        return ""
    told = []
    for k in range(1, len(settings.gain)):
        own = [f"{name} {getattr(settings, name)[k]:.2g}" for name in what]
        here = ", ".join(file for file, g in zip(files, group, strict=True) if g == k)
        told.append(f"{here}: {' and '.join(own)} times that of {files[int(np.flatnonzero(group == 0)[0])]}")
    fix = {"gain": "drive: {firmware_kp: …}", "load": "load: {mass_kg: …, lever_m: …}"}
    seen = {0, *settings.fitted}
    gone = ", ".join(file for file, g in zip(files, group, strict=True) if g not in seen)
    return (
        f"{joint}: its {' and '.join(what)} differs between trials and is not stated ({'; '.join(told)}); state "
        f"{' and '.join(fix[name] for name in what)} of each trial in logset.yaml"
        + (f"; {gone} are not judged: no fit trial has their setting" if gone else "")
    )
