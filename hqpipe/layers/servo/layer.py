"""The servo layer: which joints of a log set it can judge, and their models."""

from __future__ import annotations

from collections.abc import Collection
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from hqpipe.errors import IdentificationError
from hqpipe.identify.least_squares import Fitter, Solution
from hqpipe.identify.model import LayerJoints, positions
from hqpipe.identify.search import base_solution
from hqpipe.layers.servo.candidates import Size, base_of, effects_of
from hqpipe.layers.servo.joint import ServoJoint, Setting, Split, samples_of
from hqpipe.layers.servo.scale import Scale, duty_of, scale_note, scale_of
from hqpipe.layers.servo.start import LARGEST, Start, drive_error, start_of
from hqpipe.layers.servo.trial_settings import CLEARLY, TrialSettings, moved, one_setting, settings_of
from hqpipe.layers.servo.tracks import (
    LEAST_WINDOW,
    Tracks,
    response_time,
    smoothing,
    thinned,
    tracks_of,
    windows_of,
)
from hqpipe.logs.columns import joint_column
from hqpipe.logs.survey.end_stop import EndStop, end_stops
from hqpipe.logs.survey.signal import noise, resolution
from hqpipe.logs.trajectory import LogSet, Trial

RESPONSES = 5.0  # a window is this many response times long: what is left of a first-order response is e⁻⁵, 0.7 %
LONGEST_WINDOW = 2.0  # s; assumption: longer windows leave too few of them
RUN_IN = 2.0  # response times before a window: what an initial state that is off leaves of it has died out where a loop is closed
_LEAST_WINDOWS = 4  # of the fit trials; assumption: fewer initial states are no sample
_FINE = 25.0  # substeps of a response time; Verlet is then exact to about 1e-3
_MOST_SUBSTEPS = 8
_UNSURE_RATIO = 0.3  # logarithm, by which a ratio from a regression may be off; assumption
_DIFFERS = 1.05  # ratio of the gains of two trials that tells a bias from a constant torque; assumption
_CLEARLY = 0.7  # of the squared error; assumption: less of a gain may be what both models lack
_MOST_STEPS = 12_500  # substeps of one call on the fit trials, about 0.8 ms
_HELDOUT = 4  # times that for the held-out trials, which are run once for every answer
_MOVES = 20.0  # steps of the sensor, or standard deviations of its noise, that the travel must have; assumption
_UNSURE = 2.0  # times what a regression has for the gain; friction that it does not know makes the gain look smaller
_ROUNDING = 1e-9  # of the largest value: a smaller one is the rounding of a difference; assumption
_SLOW = 2.0  # response times: time constant of the slow share of the torque; assumption


@dataclass(frozen=True, eq=False)
class _Prepared:
    """One joint before its windows are cut."""

    joint: str
    scale: Scale
    tracks: tuple[Tracks, Tracks]
    rows: tuple[np.ndarray, np.ndarray]
    response_s: float
    travel: float
    sensor_noise: float


class Servo:
    """Free run of the position from its command, or from duty and voltage."""

    NAME = "servo"

    def lacking(self, log_set: LogSet) -> list[str]:
        """Columns without which nothing can be judged."""
        trials = [trial.trajectory for trial in log_set.trials]
        commanded = all(t.position_command is not None for t in trials)
        duty = any(all(duty_of(t, joint) is not None for t in trials) for joint in log_set.joints)
        return [] if commanded or duty else [joint_column("<name>", "position_command")]

    def joints(self, log_set: LogSet, window_s: float | None = None, without: Collection[str] = ()) -> LayerJoints:
        """Models of all joints that can be judged.

        Args:
            window_s: s, length of a free run; None for five response times of the slowest joint.
            without: names of effects to leave out.

        Raises:
            IdentificationError: no joint can be judged.
        """
        ready: list[_Prepared] = []
        left: dict[str, str] = {}
        stops = end_stops([(trial.file, trial.trajectory) for trial in log_set.trials])
        for joint in log_set.joints:
            found = _prepare(log_set, joint, stops)
            if isinstance(found, str):
                left[joint] = found
            else:
                ready.append(found)
        length, reason = _window(ready, window_s) if ready else (0.0, "")
        models = []
        for item in ready:
            model = _model(item, length, without)
            if isinstance(model, str):
                left[item.joint] = model
            else:
                models.append(model)
        if not models:
            reasons = "; ".join(f"{joint}: {why}" for joint, why in left.items())
            raise IdentificationError(
                f"{log_set.path}: no joint can be judged from its position ({reasons})",
                file=log_set.path,
                fix="record the position command, or duty and voltage, of joints that move, at a steady rate",
            )
        return LayerJoints(
            layer=self.NAME,
            metric="free_run_rmse",
            window_s=length,
            window_reason=reason,
            models=tuple(models),
            left=left,
            warnings=_stop_warnings(stops),
        )


def _stop_warnings(stops: list[EndStop]) -> tuple[str, ...]:
    return tuple(
        f"{stop.joint} stands at an end stop at {stop.position:.4g} in {', '.join(stop.files)}: these samples are left out"
        for stop in stops
    )


def _prepare(log_set: LogSet, joint: str, stops: list[EndStop]) -> _Prepared | str:
    """Signals and scale of one joint, or why it cannot be judged."""
    trials = list(log_set.trials)
    duty = all(duty_of(trial.trajectory, joint) is not None for trial in trials)
    if not duty and any(trial.trajectory.position_command is None for trial in trials):
        return f"neither {joint_column(joint, 'position_command')} nor {joint_column(joint, 'duty')} in every trial"
    q = np.concatenate([t.trajectory.position[:, t.trajectory.joint(joint)] for t in trials])
    travel = float(np.ptp(q))
    sensor = _sensor_noise(trials, joint)
    if travel <= _MOVES * max(sensor, 1e-12 * float(np.abs(q).max())):
        return f"it moves by {travel:.2g} only"
    scale = scale_of(trials, joint, log_set.kinds.get(joint))
    here = [stop for stop in stops if stop.joint == joint]
    rows = [
        np.array([i for i, trial in enumerate(trials) if trial.split == split], int) for split in ("fit", "heldout")
    ]
    long = [[i for i in part if trials[i].trajectory.samples > smoothing(trials[i].trajectory.dt)] for part in rows]
    tracks = [tracks_of([trials[i] for i in part], part, joint, scale, here, travel) for part in long]
    if not len(tracks[0].position):
        return "no fit trial is long enough"
    if np.ptp(tracks[0].inputs) == 0.0:
        return f"its {'duty' if scale.duty else 'command'} never changes in the fit trials"
    follows = None if np.isnan(tracks[0].command).any() else tracks[0].command
    response = response_time(tracks[0], follows)
    kept = tuple(np.array(part, dtype=np.int64) for part in long)
    return _Prepared(joint, scale, (tracks[0], tracks[1]), (kept[0], kept[1]), response, travel, sensor)


def _sensor_noise(trials: list[Trial], joint: str) -> float:
    """Standard deviation of the noise of the position sensor: white noise, or that of its steps (uniform, step / √12)."""
    found = []
    for trial in trials:
        q = trial.trajectory.position[:, trial.trajectory.joint(joint)]
        step = resolution(q)
        found.append(max(noise(q, step) or 0.0, (step or 0.0) / np.sqrt(12.0)))
    return float(np.median(found))


def _window(ready: list[_Prepared], stated: float | None) -> tuple[float, str]:
    """Length of a window, s, and why."""
    dt = max(float(np.median(item.tracks[0].dt)) for item in ready)
    if stated is not None:
        length = max(stated, LEAST_WINDOW * dt)
        reason = "as asked for" if length == stated else f"{LEAST_WINDOW} samples, more than the {stated:g} s asked for"
        return length, reason
    slowest = max(ready, key=lambda item: item.response_s)
    length = max(min(RESPONSES * slowest.response_s, LONGEST_WINDOW), LEAST_WINDOW * dt)
    reason = f"{RESPONSES:g} times the {1e3 * slowest.response_s:.0f} ms by which {slowest.joint} follows its input"
    if length == LEAST_WINDOW * dt:
        reason = f"{LEAST_WINDOW} samples, more than {reason}"
    elif length == LONGEST_WINDOW:
        reason = f"at most {LONGEST_WINDOW:g} s; {slowest.joint} follows its input by {1e3 * slowest.response_s:.0f} ms"
    return length, reason


def _model(item: _Prepared, length: float, without: Collection[str]) -> ServoJoint | str:
    """The model of one joint, or why there is none."""
    dt = float(np.median(item.tracks[0].dt))
    samples = max(int(round(length / dt)), LEAST_WINDOW)
    run_in = 0 if item.scale.duty else int(round(RUN_IN * item.response_s / dt))
    substeps = int(np.clip(np.ceil(_FINE * dt / item.response_s), 1, _MOST_SUBSTEPS))
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
            plain = _built(item, splits, runs, without, _settled(plain, solution))
    if item.scale.duty:
        return plain
    error = _damping_error(plain)
    return error if _with_friction(error).square < _CLEARLY * solution.square else plain


def _splits(item: _Prepared, samples: int, run_in: int, substeps: int) -> tuple[Split, Split]:
    found = []
    for tracks, rows, most in zip(item.tracks, item.rows, (1, _HELDOUT), strict=True):
        windows = windows_of(tracks, samples, run_in)
        windows = thinned(windows, max(most * _MOST_STEPS // ((run_in + samples) * substeps), _LEAST_WINDOWS))
        kept, judged = samples_of(tracks, windows, samples, run_in)
        found.append(Split(tracks, windows, rows, kept, judged, np.zeros(len(tracks.position))))
    return found[0], found[1]


def _built(
    item: _Prepared,
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
        slow_s=_SLOW * item.response_s,
        torque=float(np.abs(torque).max()) * (_UNSURE if scale.free_gain else 1.0),
        sensor_noise=item.sensor_noise,
    )
    gains = scale.gain * gain
    differ = settings.gains or float(gains.max()) > _DIFFERS * float(gains.min())
    base, effects = base_of(scale, start, size, settings), effects_of(scale, size, differ, without)
    notes = tuple(note for note in (scale_note(item.joint, scale), _settings_note(item, settings)) if note)
    return ServoJoint(item.joint, scale, base, effects, setting, splits, notes, settings)


def _settings_note(item: _Prepared, settings: TrialSettings) -> str:
    """A sentence on gains and loads that differ between trials without being stated."""
    if not (settings.gains or settings.loads):
        return ""
    what = [name for name, differs in (("gain", settings.gains), ("load", settings.loads)) if differs]
    files = np.array([name for tracks in item.tracks for name in tracks.files])
    group = np.concatenate([settings.group[rows] for rows in item.rows])
    told = []
    for k in range(1, len(settings.gain)):
        ratios = [f"{name} {ratio[k]:.2g}" for name, ratio in (("gain", settings.gain), ("load", settings.load))]
        own = [text for text in ratios if text.split()[0] in what]
        told.append(f"{', '.join(files[group == k])}: {' and '.join(own)} times that of {files[group == 0][0]}")
    fix = " or ".join({"gain": "drive: {firmware_kp: …}", "load": "load: {mass_kg: …, lever_m: …}"}[name] for name in what)
    return f"{item.joint}: its {' and '.join(what)} differs between trials without being stated ({'; '.join(told)}); state {fix}"


def _with_friction(model: ServoJoint) -> Solution:
    """The fit of the base with dry friction and a bias, which nearly every servo has."""
    fitter = Fitter(model)
    base = base_solution(fitter)
    names = [effect.name for effect in model.effects if effect.name in ("coulomb_friction", "position_bias")]
    free = positions(model, names)
    start = base.values.copy()
    own = free[len(model.base) :]
    start[own] = fitter.neutral[own] + 0.1 * fitter.spread[own]
    return fitter.fit(free, start, base.square / max(len(base.error), 1))


def _settled(model: ServoJoint, solution: Solution) -> TrialSettings:
    """Settings at the ratios of a fit; those that no fit trial has, at the ratios by which the held-out trials run best."""
    settings = model.settings
    at = {p.name: float(solution.values[k]) for k, p in enumerate(model.base)}
    for k in settings.fitted:
        gain, load = at.get(f"gain_ratio_{k}", settings.gain[k]), at.get(f"gravity_ratio_{k}", settings.load[k])
        settings = moved(settings, k, gain, load)
    probe = copy(model)
    for k in sorted(set(range(1, len(settings.gain))) - set(settings.fitted)):
        for differs, gain, load in ((settings.gains, 1.0, 0.0), (settings.loads, 0.0, 1.0)):

            def square(step: float, k: int = k, gain: float = gain, load: float = load) -> float:
                own = settings.gain[k] * np.exp(gain * step), settings.load[k] * np.exp(load * step)
                probe.settings = moved(settings, k, float(own[0]), float(own[1]))
                error = probe.error(solution.values, True)
                return float(error @ error)

            if differs:
                minimize_scalar(square, bounds=(-_UNSURE_RATIO, _UNSURE_RATIO), method="bounded", options={"maxiter": 12})
                settings = probe.settings
    return settings


def _damping_error(model: ServoJoint) -> ServoJoint:
    """The same joint with a drive that damps the speed of the error, and not that of the joint."""
    return ServoJoint(
        model.joint,
        model.scale,
        model.base,
        model.effects,
        model.setting,
        model.splits,
        model.notes,
        model.settings,
        True,
    )


def _torque(item: _Prepared, start: Start, gain: np.ndarray) -> np.ndarray:
    """(N,) torque that the drive is asked for in the fit trials; `gain`: ratios of all trials."""
    fit, scale, rows = item.tracks[0], item.scale, item.rows[0]
    torque = start.gain * (scale.gain * gain)[rows][fit.trial] * drive_error(fit, scale)
    if scale.duty:
        return torque
    # Of the position error, the damping takes most while the joint follows its command.
    return torque - start.drag * scale.drag[rows][fit.trial] * fit.velocity


def _size(item: _Prepared, start: Start, torque: np.ndarray, window_s: float) -> Size:
    """How large torque, speed and the rest are in the fit trials of a joint."""
    fit, scale, rows = item.tracks[0], item.scale, item.rows[0]
    return Size(
        torque=_largest(torque),
        speed=_largest(fit.velocity),
        travel=item.travel,
        dt=float(np.median(fit.dt)),
        window_s=window_s,
        gain=start.gain * float(np.median(scale.gain[rows])),
        inertia=float(np.median(scale.inertia[rows])),
    )


def _largest(values: np.ndarray) -> float:
    """Largest size of a signal but for glitches; of one that is zero nearly throughout, the largest of all."""
    size = np.abs(values)
    usual, most = float(np.quantile(size, LARGEST)), float(size.max())
    return usual if usual > _ROUNDING * most else most
