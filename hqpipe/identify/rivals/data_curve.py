"""How much data a model needs: held-out error against seconds of fit data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.errors import IdentificationError, UsageError
from hqpipe.identify.free_run import WINDOW_S, Model, predict, window_samples
from hqpipe.identify.noise import torque_noise
from hqpipe.identify.rivals.baselines import Persistence
from hqpipe.logs.trajectory import LogSet, Trial

Fit = Callable[[LogSet], Model]
"""Makes a model from the fit trials of a log set."""


@dataclass(frozen=True)
class CurvePoint:
    """One model, fitted to the first seconds of the fit trials.

    Attributes:
        seconds: of fit data. one_step, free_run: held-out RMSE over all joints and trials, N·m; None if the fit refused.
        reason: why it did.
    """

    model: str
    seconds: float
    one_step: float | None
    free_run: float | None
    reason: str = ""


@dataclass(frozen=True)
class DataCurve:
    """Points of every model by rising seconds, and what they lie between: persistence and noise floor, N·m."""

    points: tuple[CurvePoint, ...]
    persistence: float
    noise_floor: float


def data_curve(
    log_set: LogSet, fits: Mapping[str, Fit], seconds: Sequence[float], *, window_s: float = WINDOW_S, workers: int = 1
) -> DataCurve:
    """Fit models to longer and longer beginnings of the fit trials and judge all of them on the same held-out trials.

    Args:
        log_set: with fit and held-out trials.
        fits: name → fit, each called once per length.
        seconds: lengths of fit data, s; those beyond what there is count as all of it.
        window_s: of the free run, s; the data are cut in whole windows.
        workers: fits at a time, in threads.

    Raises:
        UsageError: a length that is not positive.
        IdentificationError: nothing is held out.
    """
    if wrong := [length for length in seconds if not length > 0.0]:
        raise UsageError(f"data_seconds: expected seconds of fit data above 0, got {wrong[0]:g}")
    if not log_set.heldout:
        raise IdentificationError(f"{log_set.path}: no trial is held out; mark one with split: heldout in logset.yaml")
    there = sum(_usable(trial, window_s) for trial in log_set.fit)
    points: list[CurvePoint] = []
    for length in sorted({min(float(length), there) for length in seconds}):
        models, refused = _fitted(first_seconds(log_set, length, window_s), fits, workers)
        for name in fits:
            errors = _errors(log_set.heldout, models[name], window_s) if name in models else (None, None)
            points.append(CurvePoint(name, length, *errors, refused.get(name, "")))
    ordered = sorted(points, key=lambda point: list(fits).index(point.model))
    _, persistence = _errors(log_set.heldout, Persistence(), window_s)
    noise = np.array([torque_noise(log_set.heldout, joint) for joint in log_set.joints])
    return DataCurve(tuple(ordered), persistence, float(np.sqrt(np.mean(noise**2))))


def first_seconds(log_set: LogSet, seconds: float, window_s: float = WINDOW_S) -> LogSet:
    """The log set with only the first `seconds` of its fit trials, in whole windows; held-out trials stay as they are.

    The fit trials follow each other as they are listed, as if recording had stopped then.

    Raises:
        IdentificationError: that is less than one window.
    """
    kept: list[Trial] = []
    left = seconds
    for trial in log_set.fit:
        t = trial.trajectory
        window = window_samples(t.dt, window_s)
        windows = int(np.floor(min(left, _usable(trial, window_s)) / (window * t.dt) + 1e-6))
        if windows > 0:
            kept.append(replace(trial, trajectory=t.section(0, windows * window + 1)))
            left -= windows * window * t.dt
    if not kept:
        raise IdentificationError(
            f"{seconds:g} s of fit data hold no window of {window_s:g} s; expected at least one: raise data_seconds"
        )
    return replace(log_set, trials=(*kept, *log_set.heldout))


def _usable(trial: Trial, window_s: float) -> float:
    """s of a trial that are whole windows."""
    t = trial.trajectory
    window = window_samples(t.dt, window_s)
    return (t.samples - 1) // window * window * t.dt


def _fitted(log_set: LogSet, fits: Mapping[str, Fit], workers: int) -> tuple[dict[str, Model], dict[str, str]]:
    """Models that could be fitted, and why the others could not."""

    def attempt(fit: Fit) -> tuple[Model | None, str]:
        try:
            return fit(log_set), ""
        except IdentificationError as error:  # too little data for it: that is what the curve is to show
            return None, str(error)

    with ThreadPoolExecutor(workers) as pool:
        found = dict(zip(fits, pool.map(attempt, fits.values()), strict=True))
    models = {name: model for name, (model, _) in found.items() if model is not None}
    return models, {name: reason for name, (model, reason) in found.items() if model is None}


def _errors(trials: list[Trial], model: Model, window_s: float) -> tuple[float, float]:
    """RMSE one step ahead and free-running over all joints and trials, N·m; inf where the model diverged."""
    found = []
    for horizon in (None, window_s):
        parts = []
        for t in (trial.trajectory for trial in trials):
            window = 1 if horizon is None else window_samples(t.dt, horizon)
            parts.append((predict(t, model, window) - t.effort)[1:].ravel())
        residual = np.concatenate(parts)
        found.append(float(np.sqrt(np.mean(np.where(np.isfinite(residual), residual, np.inf) ** 2))))
    return found[0], found[1]
