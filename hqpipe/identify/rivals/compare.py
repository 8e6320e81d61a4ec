"""The comparison table: models beside what they must beat, on held-out trials and on stress trials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hqpipe.errors import IdentificationError, UsageError
from hqpipe.identify.free_run import WINDOW_S, Model, predict, require_channels, window_samples
from hqpipe.identify.noise import torque_noise
from hqpipe.identify.rivals.baselines import CommandedTorque, MeanTorque, Persistence, fit_stiff_pd
from hqpipe.identify.rivals.metrics import ErrorStats, error_stats, loaded_threshold
from hqpipe.logs.trajectory import LogSet, Trial

PERSISTENCE = "persistence"
ALL = "all"
HELDOUT, STRESS = "held-out", "stress"


@dataclass(frozen=True)
class ScoreRow:
    """Errors of one model that it was not fitted to, for one joint or all, in one trial or all.

    Attributes:
        logs: "held-out", the held-out trials of the log set; or "stress", a log set that holds none to fit to.
        one_step: next sample from the logged torque. free_run: whole windows, restarted from the log.
        one_step_skill, free_run_skill: 1 − RMSE / RMSE of persistence; negative is worse than persistence.
        loaded_threshold: N·m, None for all joints together (each has its own).
        noise_floor: of the measured torque, N·m (RMS over the joints).
    """

    logs: str
    model: str
    joint: str
    trial: str
    one_step: ErrorStats
    free_run: ErrorStats
    one_step_skill: float
    free_run_skill: float
    loaded_threshold: float | None
    noise_floor: float


@dataclass(frozen=True, eq=False)
class _Bench:
    """What every row needs: the torque of some trials, its scale per joint, and persistence to compare with."""

    logs: str
    trials: list[Trial]
    joints: tuple[str, ...]
    window_s: float
    scale: np.ndarray
    threshold: np.ndarray
    noise: np.ndarray

    @classmethod
    def of(cls, logs: str, trials: list[Trial], joints: tuple[str, ...], window_s: float) -> _Bench:
        effort = np.concatenate([trial.trajectory.effort for trial in trials])
        threshold = np.array([loaded_threshold(column) for column in effort.T])
        noise = np.array([torque_noise(trials, joint) for joint in joints])
        return cls(logs, trials, joints, window_s, effort.std(axis=0), threshold, noise)


def compare_models(
    log_set: LogSet, models: Mapping[str, Model], *, window_s: float = WINDOW_S, stress: LogSet | None = None
) -> list[ScoreRow]:
    """Score models on the held-out trials, one step ahead and free-running, and then on stress trials.

    Always beside them: persistence, the mean torque, a stiff PD law with gains fitted to the fit trials where
    there is a position command, and the ideal torque actuator where there is a torque command.

    Args:
        log_set: with measured effort. models: name → model. window_s: of the free run, s.
        stress: a log set of the same joints that nothing, the baselines included, is fitted to.

    Returns:
        per model: all joints and trials, then every joint, then (with several trials) every trial; the stress trials
        after all models have been through the held-out ones.

    Raises:
        IdentificationError: nothing is held out, or effort is missing.
        UsageError: a model bears the name of a baseline, or the stress trials have other joints.
    """
    trials = log_set.heldout
    if not trials:
        raise IdentificationError(f"{log_set.path}: no trial is held out; mark one with split: heldout in logset.yaml")
    if stress is not None and stress.joints != log_set.joints:
        raise UsageError(
            f"{stress.path}: joints {', '.join(stress.joints)}, expected those of {log_set.path}: {', '.join(log_set.joints)}"
        )
    for trial in [*log_set.trials, *(stress.trials if stress else ())]:
        require_channels(trial.trajectory, ("effort",), "comparing models")
    baselines = _baselines(log_set)
    if taken := [name for name in models if name in baselines]:
        raise UsageError(f"a model cannot be called '{taken[0]}': that is a baseline of the table")
    benches = [_Bench.of(HELDOUT, trials, log_set.joints, window_s)]
    if stress is not None:
        benches.append(_Bench.of(STRESS, list(stress.trials), log_set.joints, window_s))
    rows = []
    for bench in benches:
        reference = _errors(bench, Persistence())
        for name, model in {**models, **baselines}.items():
            rows += _rows(bench, name, _errors(bench, model), reference)
    return rows


def _baselines(log_set: LogSet) -> dict[str, Model]:
    first = log_set.trials[0].trajectory
    found: dict[str, Model] = {PERSISTENCE: Persistence(), "mean torque": MeanTorque.of(log_set.fit)}
    if first.position_command is not None:
        unlimited = np.full(len(log_set.joints), np.inf)
        found["stiff PD (fitted gains)"] = fit_stiff_pd(log_set.fit, unlimited)
    if first.effort_command is not None:
        found["ideal torque"] = CommandedTorque()
    return found


_Errors = list[tuple[np.ndarray, np.ndarray]]


def _errors(bench: _Bench, model: Model) -> _Errors:
    """One-step and free-running residuals (T − 1, J) of every trial."""
    found = []
    for trial in bench.trials:
        t = trial.trajectory
        window = window_samples(t.dt, bench.window_s)
        pair = [(predict(t, model, size) - t.effort)[1:] for size in (1, window)]
        found.append((pair[0], pair[1]))
    return found


def _rows(bench: _Bench, name: str, errors: _Errors, reference: _Errors) -> list[ScoreRow]:
    parts: list[tuple[str, str]] = [(ALL, ALL)]
    if len(bench.joints) > 1:
        parts += [(joint, ALL) for joint in bench.joints]
    if len(bench.trials) > 1:
        parts += [(ALL, trial.file) for trial in bench.trials]
    return [_row(bench, name, joint, trial, errors, reference) for joint, trial in parts]


def _row(bench: _Bench, name: str, joint: str, file: str, errors: _Errors, reference: _Errors) -> ScoreRow:
    joints = [j for j, known in enumerate(bench.joints) if joint in (ALL, known)]
    trials = [i for i, trial in enumerate(bench.trials) if file in (ALL, trial.file)]
    effort = np.concatenate([bench.trials[i].trajectory.effort[1:, joints] for i in trials])
    observed = np.concatenate([bench.trials[i].trajectory.recorded[1:, joints] for i in trials])

    def stats(source: _Errors, kind: int) -> ErrorStats:
        residual = np.concatenate([source[i][kind][:, joints] for i in trials])
        return error_stats(residual, effort, bench.scale[joints], bench.threshold[joints], observed)

    mine, base = [stats(errors, kind) for kind in (0, 1)], [stats(reference, kind) for kind in (0, 1)]
    skill = [1.0 - m.rmse / b.rmse if b.rmse > 0 else 0.0 for m, b in zip(mine, base, strict=True)]
    return ScoreRow(
        logs=bench.logs,
        model=name,
        joint=joint,
        trial=file,
        one_step=mine[0],
        free_run=mine[1],
        one_step_skill=skill[0],
        free_run_skill=skill[1],
        loaded_threshold=float(bench.threshold[joints[0]]) if joint != ALL else None,
        noise_floor=float(np.sqrt(np.mean(bench.noise[joints] ** 2))),
    )
