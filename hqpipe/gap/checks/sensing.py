"""The sensing layer: the channels against each other, with no model of what lies between them.

Clock, dead and unsigned channels are found when a log is read and come with it as `LogSet.warnings`; here are
the checks that compare channels in time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.logs.columns import joint_column
from hqpipe.logs.differentiate import differentiate
from hqpipe.logs.trajectory import Trajectory

LARGEST_SKEW_S = 0.02
MIN_DROP = 0.2  # assumption: shifting must remove a fifth of the squared error before it is reported
MIN_FIT = 0.8  # of the torque's variance: a joint that moves with others follows no inertia of its own
MIN_SKEW_SAMPLES = 0.5
MAX_ROWS = 10_000  # per trial: enough for a lag
MIN_LEVELS = 100  # assumption: fewer levels within ±2 standard deviations show in a fit
LATE_COST = 0.04  # of the velocity's variance (20 % of its size): a smaller lag harms no model; assumption
AGREEING = 0.6  # share of the parts that must show a lag; assumption
PARTS = 8  # of a trial, of which the scatter of a lag is taken


@dataclass(frozen=True)
class Lag:
    """How much later one channel of a joint comes than another that it must agree with.

    Attributes:
        channel, behind: names in the log format. joint: its name.
        lag_s: s, positive if `channel` is late. error_s: standard error, from the scatter of parts of the log.
        cost: share of the channel's variance that the lag costs.
    """

    channel: str
    behind: str
    joint: str
    lag_s: float
    error_s: float
    cost: float


def lags(trajectories: list[Trajectory]) -> list[Lag]:
    """Velocity behind position, to a fraction of a sample, for every joint where a lag stands out.

    Effort behind the pressures is in `hqpipe.gap.checks.cross_check`. A low-pass on the velocity is a lag, too.
    """
    found: list[Lag] = []
    if trajectories[0].velocity_source != "measured":
        return found
    slopes = [differentiate(t.position, t.dt) for t in trajectories]
    dt = trajectories[0].dt
    for j, joint in enumerate(trajectories[0].joints):
        pairs = [(x[:, [j]], t.velocity[:, j]) for x, t in zip(slopes, trajectories, strict=True)]
        lag = skew(pairs, dt)
        if lag is None:
            continue
        parts = [skew([(x[rows], y[rows])], dt) for x, y in pairs for rows in np.array_split(np.arange(len(y)), PARTS)]
        known = [part for part in parts if part is not None]
        if len(known) > 1:
            error = float(np.std(known, ddof=1) / np.sqrt(len(known)))
            found.append(Lag("velocity", "position", joint, lag, error, _cost(pairs, lag, dt)))
    return found


def _cost(pairs: list[tuple[np.ndarray, np.ndarray]], lag: float, dt: float) -> float:
    """(lag × rate of change)² over the variance: what a shift by `lag` takes from the agreement."""
    change = sum(float(np.sum(np.gradient(x[:, 0], dt) ** 2)) for x, _ in pairs)
    energy = sum(float(np.sum((x[:, 0] - x[:, 0].mean()) ** 2)) for x, _ in pairs)
    return lag**2 * change / max(energy, np.finfo(float).tiny)


def channel_warnings(trajectories: list[Trajectory]) -> list[str]:
    """Torque that lags the motion, velocity that lags the position, and coarse channels, over all trials."""
    late = {}
    for j, joint in enumerate(trajectories[0].joints):
        if trajectories[0].effort is not None:
            pairs = [(_inertia(t, j), t.effort[:, j]) for t in trajectories]
            found = skew(pairs, trajectories[0].dt, min_fit=MIN_FIT)
            if found is not None and _throughout(pairs, trajectories[0].dt, found):
                late[joint] = found
    text = f"torque against the inertial load it moves: later by {_listed(late)}; the channels may be skewed"
    behind = {entry.joint: entry.lag_s for entry in lags(trajectories) if entry.cost > LATE_COST}
    slow = f"velocity against the derivative of the position: later by {_listed(behind)}; a low-pass filter or skewed"
    return ([text] if late else []) + ([slow] if behind else []) + _coarse(trajectories)


def skew(
    pairs: list[tuple[np.ndarray, np.ndarray]], dt: float, *, min_drop: float = MIN_DROP, min_fit: float = 0.0
) -> float | None:
    """How much later a signal comes than the linear combination of others that fits it best, s.

    For every lag within ±20 ms the signal is fitted by least squares; the lag with the smallest error is
    refined to a fraction of a sample by a parabola. Offsets are fitted too, per trial.

    Args:
        pairs: per trial the explaining signals (T, F) and the signal (T,).
        dt: s.
        min_drop: share of the squared error without a shift that the shift must remove.
        min_fit: share of the variance that the best fit must reach.

    Returns:
        s, positive if late; None if no lag stands out, or it is below half a sample.
    """
    reach = min(round(LARGEST_SKEW_S / dt), min(len(y) for _, y in pairs) // 4)
    if reach < 1:
        return None
    lags = np.arange(-reach, reach + 1)
    error, energy = np.zeros(len(lags)), 0.0
    for x, y in pairs:
        rows = np.arange(reach, len(y) - reach, max(1, len(y) // MAX_ROWS))
        basis = np.linalg.qr(np.column_stack([np.ones(len(rows)), x[rows] / (x.std(axis=0) + 1e-300)]))[0]
        basis = np.ascontiguousarray(basis.T)
        for i, lag in enumerate(lags):
            shifted = y[rows + lag]
            error[i] += shifted @ shifted - np.sum((basis @ shifted) ** 2)
        energy += np.sum((y - y.mean()) ** 2) * len(rows) / len(y)
    best = int(np.argmin(error))
    inside = 0 < best < len(lags) - 1
    if not inside or error[best] > (1.0 - min_drop) * error[reach] or error[best] > (1.0 - min_fit) * energy:
        return None
    left, middle, right = error[best - 1 : best + 2]
    lag = lags[best] + 0.5 * (left - right) / (left - 2.0 * middle + right)
    return float(lag * dt) if abs(lag) >= MIN_SKEW_SAMPLES else None


def _throughout(pairs: list[tuple[np.ndarray, np.ndarray]], dt: float, lag: float) -> bool:
    """Whether most parts of the log show the lag by themselves, to a sample or a quarter of it."""
    parts = [skew([(x[rows], y[rows])], dt) for x, y in pairs for rows in np.array_split(np.arange(len(y)), PARTS)]
    near = [part is not None and abs(part - lag) < max(dt, 0.25 * abs(lag)) for part in parts]
    return float(np.mean(near)) > AGREEING


def _inertia(t: Trajectory, j: int) -> np.ndarray:
    """What the torque of a single joint works against: inertia, damping, dry friction, stiffness; (T, 4)."""
    velocity = differentiate(t.position[:, [j]], t.dt)[:, 0]  # the recorded one may be late itself
    sign = np.tanh(velocity / (0.05 * velocity.std() + 1e-300))
    return np.column_stack([np.gradient(velocity, t.dt), velocity, sign, t.position[:, j]])


def _listed(late: dict[str, float]) -> str:
    return ", ".join(f"{joint} {1e3 * value:+.1f} ms" for joint, value in late.items())


def _coarse(trajectories: list[Trajectory]) -> list[str]:
    """Channels whose steps are large against what they show."""
    found = {}
    for name in trajectories[0].channels():
        values = np.concatenate([getattr(t, name) for t in trajectories])
        for j, joint in enumerate(trajectories[0].joints):
            steps = np.abs(np.diff(values[:, j]))
            moving = steps[steps > 1e-9 * np.ptp(values[:, j])]
            spread = 4.0 * values[:, j].std()
            if len(moving) and name != "position_command" and spread < MIN_LEVELS * moving.min():
                found.setdefault(name, []).append((joint, moving.min()))
    return [
        f"{joint_column(joints[0][0], name)} moves in steps of {joints[0][1]:.3g}"
        + (f" (and {len(joints) - 1} more joints)" if len(joints) > 1 else "")
        + ": coarse against its range, small effects drown in it"
        for name, joints in found.items()
    ]
