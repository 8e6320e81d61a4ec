"""What the other joints of a machine do to one joint: torque from their motion and posture, as one signal.

Links in series accelerate and tilt each other. The torque is linear in products of the motions: the simplest terms of the
Lagrangian of links in series, of which hqpipe.layers.joint_motion.coupling has more, because torques that are logged show more.
The coefficients are fitted once, beside the base and dry
friction, by least squares on the slopes of the free run; a search then asks for the resulting signal as a whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.signal import savgol_filter

from hqpipe.identify.least_squares import Solution
from hqpipe.logs.joint_kinds import PRISMATIC
from hqpipe.logs.trajectory import Trial

_NEIGHBOURS = 2  # joints before and after; assumption: a free run does not show what lies further away
_SPAN = 0.5  # of the response time, over which accelerations are smoothed: what is faster the joint does not follow
_LEAST_SPAN = 7  # samples, as of the initial state
_STILL = 1e-3  # rad/s RMS; assumption: a joint that is slower stands still
_PROBE = 0.02  # of the largest torque, by which a slope is taken; assumption
_SHARE = 0.1  # of the largest torque: spread of each term; assumption: as dry friction
_ROUNDS = 2  # of the linearisation


def coupling_columns(
    trials: Sequence[Trial], joint: str, joints: Sequence[str], kinds: dict, response_s: float
) -> np.ndarray:
    """(N, C) products of the motions of a joint and of its neighbours, trial after trial; C = 0 where none moves.

    Args:
        trials: of one split. joints: of the machine in their order. kinds: joint → kind. response_s: of the joint.
    """
    place = list(joints).index(joint)
    near = [k for k in range(len(joints)) if k != place and abs(k - place) <= _NEIGHBOURS]
    parts = [_of_trial(trial, joint, [joints[k] for k in near], kinds, response_s) for trial in trials]
    return np.vstack(parts) if parts else np.zeros((0, 0))


def moving(trials: Sequence[Trial], joint: str, joints: Sequence[str]) -> bool:
    """Whether another joint moves."""
    others = [name for name in joints if name != joint]
    speeds = [np.sqrt(np.mean(t.trajectory.velocity[:, t.trajectory.joint(o)] ** 2)) for t in trials for o in others]
    return bool(speeds) and max(speeds) > _STILL


def _motion(trial: Trial, name: str, response_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t = trial.trajectory
    q = t.position[:, t.joint(name)]
    span = max(_LEAST_SPAN, int(_SPAN * response_s / t.dt)) | 1
    span = min(span, len(q) - 1 + len(q) % 2)
    return tuple(savgol_filter(q, span, 3, deriv=d, delta=t.dt) for d in range(3))


def _of_trial(trial: Trial, joint: str, near: list[str], kinds: dict, response_s: float) -> np.ndarray:
    q, _, a = _motion(trial, joint, response_s)
    sine, cosine = (np.sin(q), np.cos(q)) if kinds.get(joint) != PRISMATIC else (q, np.ones(len(q)))
    found = []
    for name in near:
        x, w, b = _motion(trial, name, response_s)
        s, c = (np.sin(x), np.cos(x) - 1.0) if kinds.get(name) != PRISMATIC else (x, x**2)
        found += [b, b * sine, b * s, b * c, w**2, w**2 * sine, w**2 * s]
        found += [cosine * s, sine * s, cosine * c, sine * c, a * s, a * c]
    return np.column_stack(found) if found else np.zeros((len(q), 0))


def fitted_coupling(
    columns: np.ndarray,
    error_with: Callable[[np.ndarray], np.ndarray],
    solution: Solution,
    torque: float,
) -> np.ndarray:
    """(C,) coefficients of the torque from other joints.

    Args:
        columns: (N, C) of the fit trials. error_with: coupling torque (N,) → errors of the fit samples with the numbers of
            `solution`. torque: largest of the drive.
    """
    size = np.sqrt(np.mean(columns**2, axis=0))
    live = np.flatnonzero(size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300))
    result = np.zeros(columns.shape[1])
    if not len(live):
        return result
    unit = columns[:, live] / size[live]
    found, step = np.zeros(len(live)), _PROBE * torque
    noise = solution.square / max(len(solution.error), 1)
    for _ in range(_ROUNDS):
        now = error_with(unit @ found)
        slopes = np.column_stack(
            [(error_with(unit @ found + step * unit[:, k]) - now) / step for k in range(len(live))]
        )
        ridge = np.sqrt(noise) / (_SHARE * torque)
        weak = np.hstack([ridge * np.eye(len(live)), np.zeros((len(live), solution.jacobian.shape[1]))])
        stacked = np.vstack([np.hstack([slopes, solution.jacobian]), weak])
        move = np.linalg.lstsq(stacked, np.concatenate([-now, -ridge * found]), rcond=1e-9)[0][: len(live)]
        found = np.clip(found + move, -torque, torque)
    result[live] = found / size[live]
    return result
