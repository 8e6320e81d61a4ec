"""How a walk looks in the joints: tracking, torque distribution and the spectrum of the motion, and how far two lie apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.errors import UsageError

QUANTILES = (0.05, 0.25, 0.50, 0.75, 0.95)  # of the torque
# Edges of the octave bands, Hz. The lowest lies below a step frequency of 1–3 Hz; above the highest the velocity filters of
# the machines (100 Hz in robot.yaml) begin to act on the log and not on the simulator.
BANDS_HZ = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
SEGMENT_S = 2.0  # of the averaged periodograms: resolves 0.5 Hz, half of the lowest band
LEAST_S = 2.0 * SEGMENT_S  # two halves, each with one segment, for the distance of a log to itself
# Band power below which a joint stands still, (rad/s)²: one encoder count of 5e-5 rad at 1 Hz, squared; it keeps ratios finite.
STILL = 1e-7


@dataclass(frozen=True, eq=False)
class Walk:
    """One walk, on the machine or in the simulator.

    Attributes:
        rate_hz: of the rows.
        position_command, position, velocity, effort: (T, J) rad, rad, rad/s, N·m.
        body_velocity: (T, 3) forward and sideways (m/s) and turning rate (rad/s) in the base frame; None if not recorded.

    Raises:
        UsageError: the arrays do not have the same rows and joints, or a value is not finite.
    """

    rate_hz: float
    position_command: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    body_velocity: np.ndarray | None = None

    def __post_init__(self) -> None:
        shape = np.shape(self.position)
        for name in ("position_command", "position", "velocity", "effort", "body_velocity"):
            value = getattr(self, name)
            expected = (shape[0], 3) if name == "body_velocity" else shape
            if value is None and name == "body_velocity":
                continue
            if np.ndim(value) != 2 or np.shape(value) != expected:
                raise UsageError(f"walk: {name} has shape {np.shape(value)}, expected {expected} as (samples, columns)")
            if not np.isfinite(value).all():
                raise UsageError(f"walk: {name} holds a value that is not finite; cut the trial before it")

    @property
    def seconds(self) -> float:
        return len(self.position) / self.rate_hz

    def section(self, start_s: float, stop_s: float) -> Walk:
        """The rows from `start_s` up to `stop_s`."""
        rows = slice(round(start_s * self.rate_hz), round(stop_s * self.rate_hz))
        body = None if self.body_velocity is None else self.body_velocity[rows]
        joints = (self.position_command, self.position, self.velocity, self.effort)
        return Walk(self.rate_hz, *(values[rows] for values in joints), body)


def band_power(velocity: np.ndarray, rate_hz: float) -> np.ndarray:
    """Power of the joint motion in octaves, from averaged periodograms (Welch 1967; Hann, half overlapping, mean removed).

    Args:
        velocity: (T, J) rad/s, at least one segment of 2 s.

    Returns:
        (B, J) (rad/s)², one row per interval of `BANDS_HZ`.
    """
    from scipy.signal import welch

    length = round(SEGMENT_S * rate_hz)
    frequency, density = welch(velocity, rate_hz, nperseg=length, axis=0, detrend="constant")
    band = np.digitize(frequency, BANDS_HZ) - 1
    power = np.zeros((len(BANDS_HZ) - 1, velocity.shape[1]))
    for row in range(len(power)):
        power[row] = density[band == row].sum(axis=0) * rate_hz / length
    return power


def spectral_distance(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(J,) log-spectral distance of two band powers (B, J), dB: RMS over the bands of the difference in level."""
    level = [10.0 * np.log10(power + STILL) for power in (first, second)]
    return np.sqrt(np.mean((level[0] - level[1]) ** 2, axis=0))


def torque_distance(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(J,) 1-Wasserstein distance of two torque samples (T, J) and (T', J), N·m: mean shift from quantile to quantile."""
    from scipy.stats import wasserstein_distance

    return np.array([wasserstein_distance(a, b) for a, b in zip(first.T, second.T, strict=True)])


@dataclass(frozen=True, eq=False)
class WalkFigures:
    """Walks of one machine or one model beside the logged ones with the same commands.

    Everything is NaN where no walk was left to compare, e.g. because all fell.

    Attributes:
        walks, falls: counts. seconds: compared, all walks together, s.
        tracking_rmse: (J,) of position command minus position, rad.
        torque_quantiles: (Q, J) N·m at `QUANTILES`.
        band_power: (B, J) (rad/s)², mean over the walks.
        body_velocity: (W, 3) mean of every walk: m/s, m/s, rad/s; NaN where the walk has none.
        torque_distance: (J,) N·m, spectral_distance: (J,) dB, both to the log, mean over the walks. For the log itself: of
            the first half of every walk to the second, what would be reached by a model as good as the machine itself.
    """

    walks: int
    falls: int
    seconds: float
    tracking_rmse: np.ndarray
    torque_quantiles: np.ndarray
    band_power: np.ndarray
    body_velocity: np.ndarray
    torque_distance: np.ndarray
    spectral_distance: np.ndarray


def walk_figures(pairs: Sequence[tuple[Walk | None, Walk]], falls: int) -> WalkFigures:
    """Compare walks with the logged ones.

    Args:
        pairs: a walk and the logged one with the same command, each without its first seconds and at least one segment
            long; None for a walk of which nothing is left.
        falls: how many of them ended in a fall.
    """
    kept = [(walk, logged) for walk, logged in pairs if walk is not None]
    walks = [walk for walk, _ in kept]
    joints = pairs[0][1].position.shape[1]
    if not walks:
        nothing = np.full(joints, np.nan)
        quantiles, power = (np.full((n, joints), np.nan) for n in (len(QUANTILES), len(BANDS_HZ) - 1))
        return WalkFigures(
            len(pairs), falls, 0.0, nothing, quantiles, power, np.full((len(pairs), 3), np.nan), nothing, nothing
        )
    error = np.concatenate([walk.position_command - walk.position for walk in walks])
    powers = [band_power(walk.velocity, walk.rate_hz) for walk in walks]
    logged_powers = [band_power(logged.velocity, logged.rate_hz) for _, logged in kept]
    return WalkFigures(
        walks=len(pairs),
        falls=falls,
        seconds=sum(walk.seconds for walk in walks),
        tracking_rmse=np.sqrt(np.mean(error**2, axis=0)),
        torque_quantiles=np.quantile(np.concatenate([walk.effort for walk in walks]), QUANTILES, axis=0),
        band_power=np.mean(powers, axis=0),
        body_velocity=np.array([_mean_velocity(walk) for walk, _ in pairs]),
        torque_distance=np.mean([torque_distance(walk.effort, logged.effort) for walk, logged in kept], axis=0),
        spectral_distance=np.mean(
            [spectral_distance(ours, theirs) for ours, theirs in zip(powers, logged_powers, strict=True)], axis=0
        ),
    )


def log_figures(walks: Sequence[Walk], falls: int) -> WalkFigures:
    """The logged walks themselves; their distances are those of each walk's first half to its second.

    Args:
        walks: without their first seconds, at least `LEAST_S` long.
    """
    whole = walk_figures([(walk, walk) for walk in walks], falls)
    halves = [(walk.section(0.0, 0.5 * walk.seconds), walk.section(0.5 * walk.seconds, walk.seconds)) for walk in walks]
    apart = walk_figures(halves, falls)
    return WalkFigures(
        **{
            **vars(whole),
            "torque_distance": apart.torque_distance,
            "spectral_distance": apart.spectral_distance,
        }
    )


def _mean_velocity(walk: Walk | None) -> np.ndarray:
    if walk is None or walk.body_velocity is None:
        return np.full(3, np.nan)
    return walk.body_velocity.mean(axis=0)
