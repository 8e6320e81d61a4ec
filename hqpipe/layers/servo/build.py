"""The model of one joint: settings of its trials, what its drive damps, windows, and what other joints do to it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from hqpipe.identify.base_solution import base_solution
from hqpipe.identify.least_squares import Fitter, Solution
from hqpipe.identify.model import positions
from hqpipe.layers.servo.candidates import Size, base_of, effects_of, other_joints
from hqpipe.layers.servo.chosen_windows import chosen
from hqpipe.layers.servo.coupling import coupling_columns, fitted_coupling, moving
from hqpipe.layers.servo.joint import ServoJoint, Setting, Split, samples_of
from hqpipe.layers.servo.prepare import Prepared
from hqpipe.layers.servo.rows import FINE, LEAST_WINDOW
from hqpipe.layers.servo.scale import scale_note
from hqpipe.layers.servo.start import LARGEST, Start, drive_error, start_of
from hqpipe.layers.servo.tracks import windows_of
from hqpipe.layers.servo.trial_settings import CLEARLY, TrialSettings, moved, one_setting, settings_note, settings_of

RUN_IN = 2.0  # response times before a window, in which the error of an initial state dies out where a loop is closed
_LEAST_WINDOWS = 4  # of the fit trials; assumption: fewer initial states are no sample
_MOST_SUBSTEPS = 8
_CUTS = (0.3, 0.6)  # shares of the largest torque, from which a limit is tried; assumption
_DIFFERS = 1.05  # ratio of the gains of two trials that tells a bias from a constant torque; assumption
_CLEARLY = 0.7  # of the squared error; assumption: less of a gain may be what both models lack
_MOST_STEPS = 12_500  # substeps of one call on the fit trials, about 0.8 ms
_HELDOUT = 4  # times that for the held-out trials, which are run once for every answer
_UNSURE = 2.0  # times what a regression has for the gain; friction that it does not know makes the gain look smaller
_ROUNDING = 1e-9  # of the largest value: a smaller one is the rounding of a difference; assumption
_SLOW = 2.0  # response times: time constant of the slow share of the torque; assumption


def joint_model(item: Prepared, length: float, without: Collection[str]) -> ServoJoint | str:
    """The model of one joint, or why there is none."""
    dt = float(np.median(item.tracks[0].dt))
    samples = max(int(round(length / dt)), LEAST_WINDOW)
    run_in = 0 if item.scale.duty else int(round(RUN_IN * item.response_s / dt))
    substeps = int(np.clip(np.ceil(FINE * dt / item.response_s), 1, _MOST_SUBSTEPS))
    splits = _splits(item, samples, run_in, substeps)
    if len(splits[0].windows.start) < _LEAST_WINDOWS:
        return (
            f"the fit trials hold {len(splits[0].windows.start)} windows of {length:.2g} s, expected {_LEAST_WINDOWS}"
        )
    runs = (samples, run_in, substeps)
    plain = _built(item, splits, runs, without, one_setting(len(item.scale.gain)))
    solution = _with_friction(plain)
    settings = settings_of(item.tracks, item.rows, item.scale, item.response_s)
    if settings.gains or settings.loads:
        several = _built(item, splits, runs, without, settings)
        found = _with_friction(several)
        if found.square < CLEARLY * solution.square:
            plain, solution = several, found
            known = _splits(item, samples, run_in, substeps, plain.settings.unseen(item.rows[1]))
            plain = _built(item, known, runs, without, _settled(plain, solution))
    if not item.scale.duty:
        error = _rebuilt(plain, damps_error=True)
        found = _with_friction(error)
        if found.square < _CLEARLY * solution.square and _damps_error(plain, solution, error, found):
            plain, solution = error, found
    if not moving(item.trials[0], item.joint, item.joints):
        return plain
    return _coupled(item, plain, solution, without)


def _damps_error(speed: ServoJoint, of_speed: Solution, error: ServoJoint, of_error: Solution) -> bool:
    """Whether a drive that damps the speed of the error is still the better model when its torque may be limited."""
    squares = []
    for model, solution in ((speed, of_speed), (error, of_error)):
        fitter = Fitter(model)
        free = positions(model, ["coulomb_friction", "position_bias", "torque_limit"])
        cut = positions(model, ["torque_limit"])[len(model.base) :][:1]
        starts = []
        for share in _CUTS if len(cut) else ():
            start = solution.values.copy()
            start[cut] = share
            starts.append(start)
        noise = solution.square / max(len(solution.error), 1)
        squares.append(min(solution.square, fitter.fit(free, starts, noise).square if starts else np.inf))
    return squares[1] < _CLEARLY * squares[0]


def _rebuilt(model: ServoJoint, **changed: Any) -> ServoJoint:
    """The same joint with some of its parts changed."""
    parts = ("joint", "scale", "base", "effects", "setting", "splits", "notes", "settings", "damps_error")
    return ServoJoint(**({name: getattr(model, name) for name in parts} | changed))


def _coupled(item: Prepared, model: ServoJoint, solution: Solution, without: Collection[str]) -> ServoJoint:
    """The joint with the torque from other joints as something that may stand beside its base."""
    columns = [coupling_columns(part, item.joint, item.joints, item.kinds, item.response_s) for part in item.trials]
    probe = copy(model)

    def error_with(torque: np.ndarray) -> np.ndarray:
        probe.splits = (replace(model.splits[0], coupling=torque), model.splits[1])
        return probe.error(solution.values, coupling=1.0)

    weights = fitted_coupling(columns[0], error_with, solution, model.setting.torque)
    splits = tuple(
        replace(split, coupling=part @ weights) if len(part) else split
        for split, part in zip(model.splits, columns, strict=True)
    )
    effects = tuple(e for e in (*model.effects, other_joints()) if e.name not in without)
    return _rebuilt(model, splits=splits, effects=effects)


def _splits(
    item: Prepared, samples: int, run_in: int, substeps: int, unseen: Sequence[int] = ()
) -> tuple[Split, Split]:
    """Windows of the fit and the held-out trials; `unseen`: held-out trials that are not judged."""
    found = []
    for tracks, rows, most in zip(item.tracks, item.rows, (1, _HELDOUT), strict=True):
        windows = windows_of(tracks, samples, run_in)
        if tracks is item.tracks[1]:
            windows = windows.of(~np.isin(windows.trial, unseen))
        count = max(most * _MOST_STEPS // ((run_in + samples) * substeps), _LEAST_WINDOWS)
        windows = chosen(tracks, windows, samples, run_in, count)
        kept, judged = samples_of(tracks, windows, samples, run_in)
        found.append(Split(tracks, windows, rows, kept, judged, np.zeros(len(tracks.position))))
    return found[0], found[1]


def _built(
    item: Prepared,
    splits: tuple[Split, Split],
    runs: tuple[int, int, int],
    without: Collection[str],
    settings: TrialSettings,
) -> ServoJoint:
    """The model of a joint whose trials have these settings; `runs`: samples of a window and of its run-in, substeps."""
    fit, scale = item.tracks[0], item.scale
    dt, (samples, run_in, substeps) = float(np.median(fit.dt)), runs
    gain, load = settings.gain[settings.group], settings.load[settings.group]
    start = start_of(fit, item.rows[0], scale, item.response_s, dt / substeps, item.travel, gain, load)
    torque = _torque(item, start, gain)
    size = _size(item, start, torque, samples * dt)
    setting = Setting(
        samples=samples,
        run_in=run_in,
        substeps=substeps,
        middle=float(fit.position.min() + fit.position.max()) / 2.0,
        reach=item.travel / 2.0,
        speed=size.speed,
        row_s=item.row_s,
        slow_s=_SLOW * item.response_s,
        torque=float(np.abs(torque).max()) * (_UNSURE if scale.free_gain else 1.0),
        sensor_noise=item.sensor_noise,
    )
    gains = scale.gain * gain
    differ = settings.gains or float(gains.max()) > _DIFFERS * float(gains.min())
    base, effects = base_of(scale, start, size, settings), effects_of(scale, size, differ, without)
    files = [name for tracks in item.tracks for name in tracks.files]
    told = settings_note(item.joint, settings, files, np.concatenate([settings.group[rows] for rows in item.rows]))
    notes = tuple(note for note in (scale_note(item.joint, scale), told) if note)
    return ServoJoint(item.joint, scale, base, effects, setting, splits, notes, settings)


def _with_friction(model: ServoJoint) -> Solution:
    """The fit of the base with dry friction and a bias, which nearly every servo has."""
    fitter = Fitter(model)
    base = base_solution(fitter)
    names = [effect.name for effect in model.effects if effect.name in ("coulomb_friction", "position_bias")]
    free = positions(model, names)
    start = base.values.copy()
    own = free[len(model.base) :]
    start[own] = fitter.neutral[own] + 0.1 * fitter.spread[own]
    return fitter.fit(free, [start], base.square / max(len(base.error), 1))


def _settled(model: ServoJoint, solution: Solution) -> TrialSettings:
    """Settings at the ratios of a fit."""
    settings = model.settings
    at = {p.name: float(solution.values[k]) for k, p in enumerate(model.base)}
    for k in settings.fitted:
        gain, load = at.get(f"gain_ratio_{k}", settings.gain[k]), at.get(f"gravity_ratio_{k}", settings.load[k])
        settings = moved(settings, k, float(gain), float(load))
    return settings


def _torque(item: Prepared, start: Start, gain: np.ndarray) -> np.ndarray:
    """(N,) torque that the drive is asked for in the fit trials; `gain`: ratios of all trials."""
    fit, scale, rows = item.tracks[0], item.scale, item.rows[0]
    torque = start.gain * (scale.gain * gain)[rows][fit.trial] * drive_error(fit, scale)
    if scale.duty:
        return torque
    # Of the position error, the damping takes most while the joint follows its command.
    return torque - start.drag * scale.drag[rows][fit.trial] * fit.velocity


def _size(item: Prepared, start: Start, torque: np.ndarray, window_s: float) -> Size:
    """How large torque, speed and the rest are in the fit trials of a joint."""
    fit, scale, rows = item.tracks[0], item.scale, item.rows[0]
    return Size(
        torque=_largest(torque),
        speed=_largest(fit.velocity),
        travel=item.travel,
        dt=item.row_s,
        window_s=window_s,
        gain=start.gain * float(np.median(scale.gain[rows])),
        inertia=float(np.median(scale.inertia[rows])),
        drag=float(np.median(scale.drag[rows])),
    )


def _largest(values: np.ndarray) -> float:
    """Largest size of a signal but for glitches; of one that is zero nearly throughout, the largest of all."""
    size = np.abs(values)
    usual, most = float(np.quantile(size, LARGEST)), float(size.max())
    return usual if usual > _ROUNDING * most else most
