"""The two-chamber model from logs of torque, position, velocity and position command."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.actuators.posterior import Posterior
from hqpipe.actuators.two_chamber import TwoChamber
from hqpipe.errors import IdentificationError
from hqpipe.identify.determined import MAX_INFLATION, inflation, single_window
from hqpipe.identify.free_run import WINDOW_S
from hqpipe.identify.noise import torque_noise
from hqpipe.identify.normal_equations import NormalEquations
from hqpipe.identify.outliers import outlier_size
from hqpipe.identify.paper_model.excitation import unexcited
from hqpipe.identify.paper_model.fit_actuator import PerJoint, groups_of, per_joint
from hqpipe.identify.posterior import Known, posterior_of
from hqpipe.identify.rivals.chamber_model import PARAMETERS, ChamberModel, fitted
from hqpipe.identify.rivals.chamber_start import first_guesses
from hqpipe.identify.sections import sections_of
from hqpipe.identify.uncertainty import uncertainty
from hqpipe.identify.windows import Windows, cut_windows, joint_data
from hqpipe.logs.trajectory import LogSet

_FRICTION = np.array([name.endswith("_friction") for name in PARAMETERS])
_LEAST_LAG = 1e-4  # s; assumption: a servo valve is slower, and below a fraction of a sample the lag is none
_LONGEST_LAG = 0.05  # s; assumption: a valve slower than this is no servo valve
_BOUND = 1e-9


@dataclass(frozen=True)
class ChamberParameter:
    """One fitted number; `ci95` covers the scatter of the estimate, not the error of the model's form.

    Attributes:
        name, unit: as in `TwoChamber.FIELDS`.
        identifiable: False where the logs leave it undetermined: its value is then the first guess, or 0, or what the
            single window says that decides it.
        at_bound: the estimate lies on a physical bound.
        held: the posterior leaves it at `value`: on a bound, or where a single window decides it.
    """

    name: str
    unit: str
    value: float
    ci95: tuple[float, float] | None
    identifiable: bool
    at_bound: bool
    held: bool = False


@dataclass(frozen=True, eq=False)
class ChamberJointFit:
    """One joint, or all that share their parameters (`joint` is then "all").

    Attributes:
        covariance: (P, P) of the parameters in the order of `PARAMETERS`; 0 where not identifiable.
        freedom: (P,) degrees of freedom of its diagonal.
        free_run_rmse: on the fit trials, N·m. noise: noise floor of their torque, N·m.
    """

    joint: str
    parameters: tuple[ChamberParameter, ...]
    covariance: np.ndarray
    freedom: np.ndarray
    free_run_rmse: float
    noise: float

    def __getitem__(self, name: str) -> ChamberParameter:
        return next(p for p in self.parameters if p.name == name)


@dataclass(frozen=True, eq=False)
class ChamberFit:
    """The model, and what is known of its numbers; `trials` are those it was fitted to.

    Its posterior leaves a parameter where it is that lies on a bound, or that a single window decides.
    """

    model: TwoChamber
    fits: tuple[ChamberJointFit, ...]
    trials: tuple[str, ...]
    window_s: float
    posterior: Posterior


@dataclass(eq=False)
class _Group:
    """Joints that share their parameters, and their fit."""

    model: ChamberModel
    free: np.ndarray
    noise: float
    x: np.ndarray
    at: NormalEquations


def fit_chambers(
    log_set: LogSet,
    *,
    window_s: float = WINDOW_S,
    scope: str = "per_joint",
    effort_limit: PerJoint = np.inf,
    speed_limit: PerJoint = np.inf,
    position_lower: PerJoint | None = None,
    position_upper: PerJoint | None = None,
) -> ChamberFit:
    """Fit the two-chamber model to the fit trials, free-running in windows; held-out trials are never touched.

    The starts translate the paper's coefficients. Every joint is fitted from them, then once more with gross errors counted
    linearly (Huber 1964). Seal friction is fitted unless the torque comes from pressures, which do not feel it.

    Args:
        log_set: with `position_command` and `effort`. window_s: length of a window, s.
        scope: "per_joint", or "shared" for one set of parameters.
        effort_limit: N·m. speed_limit: joint speed at full valve stroke without load, rad/s.
        position_lower, position_upper: joint limits, rad; the range seen in the logs if unknown. They give the middle of
            the stroke and, since a piston cannot leave its cylinder, bound the volume slope by 2 / range.

    Raises:
        IdentificationError: channels are missing, rates differ, windows are too short, or no joint moves.
        UsageError: an unknown scope, or a joint without a value.
    """
    windows = cut_windows(log_set.fit, window_s)
    settings, half = _settings(log_set, windows, effort_limit, speed_limit, position_lower, position_upper)
    names = log_set.joints
    shared = groups_of(scope, len(names))
    groups = [_group(log_set, joints, windows, settings, half) for joints in shared]
    if not any(group.free.any() for group in groups):
        raise IdentificationError(f"{log_set.path}: no joint moves in the fit trials; record some that do")
    table = np.empty((len(names), len(TwoChamber.FIELDS)))
    for joints, group in zip(shared, groups, strict=True):
        table[joints] = np.concatenate((np.tile(group.x, (len(joints), 1)), settings[joints]), axis=1)
    reports = tuple(_report(group) for group in groups)
    known = [_known(*pair, windows) for pair in zip(groups, reports, strict=True)]
    model, files = TwoChamber(names, table, windows.dt, scope), tuple(trial.file for trial in log_set.fit)
    return ChamberFit(model, reports, files, window_s, posterior_of(TwoChamber.NAME, PARAMETERS, known))


def _settings(
    log_set: LogSet,
    windows: Windows,
    effort: PerJoint,
    speed: PerJoint,
    low: PerJoint | None,
    high: PerJoint | None,
) -> tuple[np.ndarray, np.ndarray]:
    """(J, 4) columns that are not fitted, and (J,) half of each joint's range, rad."""
    names = log_set.joints
    seen = np.concatenate([trial.trajectory.position for trial in log_set.fit])
    lower = seen.min(axis=0) if low is None else per_joint(low, names, "position_lower")
    upper = seen.max(axis=0) if high is None else per_joint(high, names, "position_upper")
    limits = per_joint(speed, names, "speed_limit"), per_joint(effort, names, "effort_limit")
    columns = (limits[0], 0.5 * (lower + upper), np.full(len(names), windows.dt), limits[1])
    return np.stack(columns, axis=1), 0.5 * (upper - lower)


def _group(log_set: LogSet, joints: list[int], windows: Windows, settings: np.ndarray, half: np.ndarray) -> _Group:
    data = [joint_data(log_set.fit, log_set.joints[j]) for j in joints]
    lower, upper = np.zeros(len(PARAMETERS)), np.full(len(PARAMETERS), np.inf)
    lower[:4] = 1e-3, 1e-3, 1e-3, _LEAST_LAG
    upper[3] = _LONGEST_LAG
    upper[6] = 1.0 / max(half[joints].max(), 1e-9)
    model = ChamberModel(data, windows, settings[joints], lower, upper)
    moving = "k1" not in unexcited(data, windows)
    free = np.full(len(PARAMETERS), moving)
    free[_FRICTION] &= log_set.effort_source != "pressure"
    starts = first_guesses(data, windows, settings[joints, 3])
    first = fitted(model, free, [np.where(_FRICTION, 0.0, start) for start in starts])
    model.outlier[:] = [outlier_size(residual) for residual in model.residuals(first.values)]
    found = fitted(model, free, [first.values])
    noise = np.sqrt(np.mean([torque_noise(log_set.fit, log_set.joints[j]) ** 2 for j in joints]))
    return _Group(model, free, float(noise), found.values, model.at(found))


def _report(group: _Group) -> ChamberJointFit:
    pressed = group.free & ((group.x <= group.model.lower + _BOUND) | (group.x >= group.model.upper - _BOUND))
    known = group.free & (inflation(group.at.hessian, group.free) < MAX_INFLATION)
    # A bound counts as a number that is known, unless a single window pressed the parameter against it.
    lone = single_window(group.at.hessians, known & ~pressed) > 0.0
    lone |= pressed & (single_window(group.at.hessians, known) > 0.0)
    known &= ~lone
    inner = known & ~pressed
    spread = uncertainty(group.at, inner)
    low, high = spread.interval(group.x, group.model.lower, group.model.upper)
    parameters = tuple(
        ChamberParameter(
            name,
            TwoChamber.FIELDS[name].unit,
            float(group.x[i]),
            (float(low[i]), float(high[i])) if inner[i] else None,
            bool(known[i]),
            bool(pressed[i]),
            bool(pressed[i] or lone[i]),
        )
        for i, name in enumerate(PARAMETERS)
    )
    rmse = float(np.sqrt(np.mean(np.concatenate(group.model.residuals(group.x)) ** 2)))
    return ChamberJointFit(group.model.joint, parameters, spread.covariance, spread.freedom, rmse, group.noise)


def _known(group: _Group, report: ChamberJointFit, windows: Windows) -> Known:
    """What the fit of one group knows, for the posterior."""
    determined = np.array([p.identifiable for p in report.parameters])
    held = np.array([p.held for p in report.parameters])
    inner, joints = determined & ~held, tuple(data.joint for data in group.model.joints)
    single = [(group.x, group.at)]
    if len(joints) > 1:
        parts = [group.model.alone(j) for j in range(len(joints))]
        found = [fitted(part, inner, [group.x]) for part in parts]
        single = [(solution.values, part.at(solution)) for part, solution in zip(parts, found, strict=True)]
    sections = sections_of(single, windows, inner, group.model.lower, group.model.upper)
    return Known(joints, group.x, determined, held, report.covariance, sections, group.model.lower, group.model.upper)
