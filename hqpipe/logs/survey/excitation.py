"""How each joint was moved: what an identification has to work with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.logs.survey.channel import COMMANDS
from hqpipe.logs.trajectory import Trajectory

_TURNING = (
    0.02  # of the travel, by which a joint must come back for a reversal; keeps the noise of the sensor out; assumption
)
_RESTING = 0.05  # of the 95 % speed; of a sine 3 % of the time is spent below
_SEGMENT_S = 4.0  # of the spectrum: 0.25 Hz apart
_POWER = 0.95
_LIVELY = 0.1  # of the largest range; the spectrum of a command that hardly moves says nothing


@dataclass(frozen=True)
class Excitation:
    """The motion of one joint over all trials.

    Attributes:
        travel: from its smallest to its largest position, rad. reversals: changes of direction, of motions
            beyond 2 % of the travel.
        speed_rms, speed_95: root mean square and 95 % quantile of the speed, rad/s.
        rest_share: share of the samples slower than 5 % of `speed_95`.
        command: channel that the bandwidth belongs to, a command or else the position.
        bandwidth_hz: frequency below which 95 % of the power of the command lies, in the trial where it is highest; None for
            one that does not move.
    """

    joint: str
    travel: float
    reversals: int
    speed_rms: float
    speed_95: float
    rest_share: float
    command: str
    bandwidth_hz: float | None


def excitations(trials: Sequence[Trajectory], mode_channel: str | None = None) -> list[Excitation]:
    """Judge the motion of every joint.

    Args:
        trials: with the same joints. mode_channel: the command that counts; by default the first one of the format.
    """
    recorded = [name for name in COMMANDS if all(getattr(t, name) is not None for t in trials)]
    channel = mode_channel if mode_channel in recorded else next(iter(recorded), "position")
    return [_excitation(trials, j, joint, channel) for j, joint in enumerate(trials[0].joints)]


def _excitation(trials: Sequence[Trajectory], j: int, joint: str, channel: str) -> Excitation:
    position = np.concatenate([t.position[:, j] for t in trials])
    speed = np.abs(np.concatenate([t.velocity[:, j] for t in trials]))
    fast = float(np.quantile(speed, 0.95))
    return Excitation(
        joint=joint,
        travel=float(np.ptp(position)),
        reversals=sum(_reversals(t.position[:, j], _TURNING * float(np.ptp(position))) for t in trials),
        speed_rms=float(np.sqrt(np.mean(speed**2))),
        speed_95=fast,
        rest_share=float(np.mean(speed <= _RESTING * fast)),
        command=channel,
        bandwidth_hz=_bandwidth([(getattr(t, channel)[:, j], t.dt) for t in trials]),
    )


def _reversals(position: np.ndarray, least: float) -> int:
    """Turning points of a position (T,) from which it comes back by more than `least`, to half of that."""
    if least == 0.0:
        return 0
    level = np.floor(position / (0.5 * least))  # few levels, so that little is left to go through one by one
    level = level[np.concatenate(([True], np.diff(level) != 0))]
    turns, direction, extreme = 0, 0, level[0]
    for value in level.tolist():
        if (value - extreme) * direction > 0:
            extreme = value
        elif abs(value - extreme) > 2.0:
            turns += direction != 0
            direction, extreme = (1 if value > extreme else -1), value
    return turns


def _bandwidth(signals: Sequence[tuple[np.ndarray, float]]) -> float | None:
    """Hz, the largest of (signal (T,), dt) that move."""
    spread = [float(np.ptp(values)) for values, _ in signals]
    lively = [signal for signal, size in zip(signals, spread, strict=True) if size > _LIVELY * max(spread)]
    return max((_upper_frequency(*signal) for signal in lively), default=None)


def _upper_frequency(values: np.ndarray, dt: float) -> float:
    """Frequency below which 95 % of the power about the mean lies, Hz; power is taken as even within a line of the spectrum."""
    from scipy.signal import welch

    rows = min(len(values), max(8, round(_SEGMENT_S / dt)))
    frequency, power = welch(values - values.mean(), 1.0 / dt, nperseg=rows, detrend="constant")
    share = np.cumsum(power) / power.sum()
    return float(np.interp(_POWER, share, frequency))
