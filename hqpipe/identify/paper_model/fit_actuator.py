"""The paper's four coefficients from logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.posterior import Range
from hqpipe.errors import IdentificationError, UsageError, near_match
from hqpipe.identify.determined import single_window
from hqpipe.identify.free_run import WINDOW_S
from hqpipe.identify.noise import torque_noise
from hqpipe.identify.outliers import outlier_size
from hqpipe.identify.paper_model.excitation import inseparable, unexcited
from hqpipe.identify.paper_model.problem import COEFFICIENTS, HELD, LOWER, UPPER, Problem, Solution
from hqpipe.identify.paper_model.results import Coefficient, FitResult, JointFit
from hqpipe.identify.posterior import Known, posterior_of
from hqpipe.identify.sections import sections_of
from hqpipe.identify.uncertainty import Uncertainty, uncertainty
from hqpipe.identify.windows import Windows, cut_windows, joint_data
from hqpipe.logs.trajectory import LogSet, Trial

_ON_BOUND = 1e-9
_FEW_WINDOWS = 20  # assumption: with fewer, neither coefficients nor errors are to be trusted
_FEWEST_WINDOWS = 5  # assumption: the scatter between fewer windows says nothing about an interval
_LONE = "one window decides it: {:.1%} of what is known of it; the model keeps what that says"

PerJoint = float | Mapping[str, float]


def fit_actuator(
    log_set: LogSet,
    *,
    window_s: float = WINDOW_S,
    scope: str = "per_joint",
    sprocket_radius: PerJoint = 1.0,
    effort_limit: PerJoint = np.inf,
) -> FitResult:
    """Fit k1 … k4 to the fit trials, free-running in windows; held-out trials are never touched.

    Linear least squares gives the starts. Then the squared error of the simulated windows is minimised over
    the coefficients within their physical bounds and over each window's start torque, which is known from the
    log only to within its noise. Gross errors beyond six robust standard deviations count linearly (Huber).

    Args:
        log_set: with `position_command` and `effort`. window_s: length of a window, s.
        scope: "per_joint", or "shared" for one set of coefficients.
        sprocket_radius: R of eq. (7), m, or joint → m; 1 if unknown. effort_limit: N·m, likewise.

    Raises:
        IdentificationError: channels are missing, rates differ, windows are too short, or no joint moves.
        UsageError: an unknown scope, or a joint without a value.
    """
    trials = log_set.fit
    windows = cut_windows(trials, window_s)
    radius = per_joint(sprocket_radius, log_set.joints, "sprocket_radius")
    limit = per_joint(effort_limit, log_set.joints, "effort_limit")
    k, one_step = np.zeros((2, len(log_set.joints), 4))
    fits, known = [], []
    for group in groups_of(scope, len(log_set.joints)):
        data = [joint_data(trials, log_set.joints[j]) for j in group]
        noise = np.array([torque_noise(trials, joint.joint) for joint in data])
        problem = Problem(data, windows, radius[group], limit[group])
        solution, fit, one_step[group] = _fit_group(problem, noise)
        fits.append(fit)
        if solution:
            k[group] = solution.values
        if _enough(windows):
            known.append(_known(problem, solution, fit))
    _require_any(log_set, fits)
    fixed = {"dt": windows.dt, "scope": scope, "sprocket_radius": radius, "effort_limit": limit}
    return FitResult(
        model=_hydraulic(log_set, k, fixed),
        one_step_model=_hydraulic(log_set, one_step, fixed),
        fits=tuple(fits),
        scope=scope,
        window_s=window_s,
        dt=windows.dt,
        trials=tuple(trial.file for trial in trials),
        warnings=tuple(_warnings(log_set, trials, fits)),
        posterior=posterior_of(Hydraulic.NAME, COEFFICIENTS, known) if _enough(windows) else None,
    )


def _require_any(log_set: LogSet, fits: list[JointFit]) -> None:
    if not any(c.value is not None for fit in fits for c in fit.coefficients):
        why = fits[0].coefficients[0].reason
        raise IdentificationError(f"{log_set.path}: none of k1 … k4 can be identified: {why}")


def _enough(windows: Windows) -> bool:
    """Whether there are windows enough for an interval."""
    return len(windows.bounds) >= _FEWEST_WINDOWS


def _hydraulic(log_set: LogSet, k: np.ndarray, fixed: dict[str, Any]) -> Hydraulic:
    return Hydraulic.build(log_set.joints, **dict(zip(COEFFICIENTS, k.T, strict=True)), **fixed)


def groups_of(scope: str, joints: int) -> list[list[int]]:
    """Joints that share their parameters.

    Raises:
        UsageError: an unknown scope.
    """
    scopes = {"per_joint": [[j] for j in range(joints)], "shared": [list(range(joints))]}
    if scope not in scopes:
        raise UsageError(f"scope is '{scope}'{near_match(scope, scopes)}, expected per_joint or shared")
    return scopes[scope]


def per_joint(value: PerJoint, joints: Sequence[str], name: str) -> np.ndarray:
    """(J,) of one number or joint → number; `name` is for the message.

    Raises:
        UsageError: a joint without a value.
    """
    if not isinstance(value, Mapping):
        return np.full(len(joints), float(value))
    for joint in joints:
        if joint not in value:
            raise UsageError(f"{name}: no value for joint '{joint}'{near_match(joint, value)}")
    return np.array([value[joint] for joint in joints], dtype=float)


def _fit_group(problem: Problem, noise: np.ndarray) -> tuple[Solution | None, JointFit, np.ndarray]:
    """Fit the joints of a problem; returns the solution, if they move, the report, and the one-step k (4,).

    What a single window decides keeps its value in the model.
    """
    reasons = unexcited(problem.joints, problem.windows)
    free = np.array([name not in reasons for name in COEFFICIENTS])
    one_step = problem.one_step(1) if free.any() else np.zeros(4)
    solution = None
    if free.any():
        starts = problem.starts(free)
        reasons |= inseparable(problem.evaluate(starts[0], problem.measured_starts())[0], free)
        free = np.array([name not in reasons for name in COEFFICIENTS])
    if free.any():
        solution = _two_passes(problem, [np.where(free, start, 0.0) for start in starts], free, noise)
    k = solution.values if solution else np.zeros(4)
    rmse = np.sqrt(np.mean(np.concatenate(problem.residuals(k)) ** 2))
    bounds = problem.windows.bounds
    spread = None
    if solution and _enough(problem.windows):
        lone = single_window(solution.at.hessians, free)
        reasons |= {COEFFICIENTS[i]: _LONE.format(lone[i]) for i in np.flatnonzero(lone)}
        spread = uncertainty(solution.at, free & (lone == 0.0))
    fit = JointFit(
        joint=problem.joints[0].joint if len(problem.joints) == 1 else "all",
        coefficients=_coefficients(solution, spread, free, one_step, reasons),
        free_run_rmse=float(rmse),
        noise=float(np.sqrt(np.mean(noise**2))),
        windows=len(bounds),
        samples=int((bounds[:, 1] - bounds[:, 0]).sum()) * len(problem.joints),
        covariance=spread.covariance if spread else None,
        freedom=spread.freedom if spread else None,
        persistence_rmse=float(np.sqrt(np.mean(np.concatenate(problem.held()) ** 2))),
    )
    return solution, fit, one_step


def _known(problem: Problem, solution: Solution | None, fit: JointFit) -> Known:
    """What the fit of one group knows, for the posterior; what a single window decides stays."""
    joints = tuple(data.joint for data in problem.joints)
    free = np.array([c.identifiable for c in fit.coefficients])
    held = ~free & np.array([c.value is not None for c in fit.coefficients])
    if solution is None:
        return Known(joints, np.zeros(4), free, held, np.zeros((4, 4)), (), LOWER, UPPER)
    single = [solution]
    if len(joints) > 1:
        starts = solution.starts
        single = [problem.alone(j).fit(free, [solution.values], [starts[j]]) for j in range(len(joints))]
    sections = sections_of([(part.values, part.at) for part in single], problem.windows, free, LOWER, UPPER)
    assumed = {"k4": _assumed_k4(problem, solution.values)}
    return Known(joints, solution.values, free, held, fit.covariance, sections, LOWER, UPPER, assumed)


def _assumed_k4(problem: Problem, k: np.ndarray) -> Range:
    """Range of k4 without any impact in the logs: at their largest error an opposed torque fades twice as fast at most."""
    errors = [scale * np.abs(data.error).max() for scale, data in zip(problem.scale[:, 3], problem.joints, strict=True)]
    high = float(k[1] / max(*errors, 1e-9))
    return Range(0.0, high, "assumption: at the largest error of the logs an impact at most doubles the leakage")


def _two_passes(problem: Problem, starts: Sequence[np.ndarray], free: np.ndarray, noise: np.ndarray) -> Solution:
    """Fit with the starts held to the log, then with the starts and outliers weighed by what is left over."""
    first = problem.fit(free, starts)
    for j, residual in enumerate(problem.residuals(first.values)):
        rms = np.sqrt(np.mean(residual**2))
        problem.outlier[j] = outlier_size(residual)
        problem.start_weight[j] = min(max((rms / max(noise[j], 1e-12)) ** 2, 1.0), HELD)
    return problem.fit(free, [first.values], first.starts)


def _coefficients(
    solution: Solution | None,
    spread: Uncertainty | None,
    free: np.ndarray,
    one_step: np.ndarray,
    reasons: Mapping[str, str],
) -> tuple[Coefficient, ...]:
    if spread:
        low, high = spread.interval(solution.values, LOWER, UPPER)
    found = []
    for i, name in enumerate(COEFFICIENTS):
        unit, before = Hydraulic.FIELDS[name].unit, float(one_step[i])
        if not free[i]:
            found.append(Coefficient(name, unit, None, None, before, False, reasons[name]))
            continue
        value = float(solution.values[i])
        if name in reasons:
            found.append(Coefficient(name, unit, value, None, before, False, reasons[name]))
            continue
        at_bound = bool(value <= LOWER[i] + _ON_BOUND or value >= UPPER[i] - _ON_BOUND)
        ends = (float(low[i]), float(high[i])) if spread else None
        found.append(Coefficient(name, unit, value, ends, before, at_bound=at_bound))
    return tuple(found)


def _warnings(log_set: LogSet, trials: list[Trial], fits: list[JointFit]) -> list[str]:
    found = []
    if log_set.control_mode not in (None, "position"):
        found.append(
            f"control mode is {log_set.control_mode}: the paper's model is one of position control and "
            "describes this machine only as far as the position command drives it"
        )
    if trials[0].trajectory.velocity_source == "differentiated":
        found.append("velocity was differentiated from position: k3 depends on that filter")
    for fit in fits:
        if fit.windows < _FEW_WINDOWS:
            found.append(
                f"{fit.joint}: only {fit.windows} windows to fit to, expected at least {_FEW_WINDOWS}: record more"
            )
        for c in fit.coefficients:
            if not c.identifiable:
                found.append(f"{fit.joint}: {c.name} is not identifiable: {c.reason}")
            elif c.at_bound:
                found.append(
                    f"{fit.joint}: {c.name} is on its physical bound {c.value:g}: its term plays no "
                    "part, or the model's form does not fit this joint"
                )
    return found
