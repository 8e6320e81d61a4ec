"""Joints whose torque vibrates while they slide and is calm while they stand.

Something has to feed a vibration that goes on without being commanded. What a pump feeds goes on while the joint stands as
well, and the frequency of what gear teeth feed rises with the speed. Friction that falls as the speed rises feeds a vibration
at a frequency of the machine's own, and only while the joint slides (Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica
30, 1994). A position loop that is unstable may do so too, where friction holds the joint at rest; it shows in the position, so
that the law of the actuator predicts it, which whoever names a cause has to ask for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.logs.survey.channel import COMMANDS
from hqpipe.logs.trajectory import Trajectory

WINDOW_S = 0.128  # a stroke is longer; assumption
FEWEST_ROWS = 32  # of a window, in slow logs
CYCLES = 6  # in a window, at least; a shock that rings down has fewer of its size; assumption
SLOWEST = 3  # cycles in a window, from which on a line is sought: where the strongest one has fewer than `CYCLES`, it is motion
STANDING = 0.1  # of the 95 % speed
FEWEST_WINDOWS = 10  # of a kind that its median needs; assumption
SPEEDS = 4  # ranges with as many windows each: falling friction may feed a vibration at some speeds only
SHARE = 1.0 / 3.0  # of the root mean square of the torque, that of a vibration that an engineer would hear; assumption
CALM = 1.0 / 3.0  # of the amplitude while sliding: a tenth of the power
FOLLOWS = 0.5  # power of the speed by which the frequency rises; 1 for teeth, 0 for what depends on the machine alone
MEANS = "friction that falls as the speed rises does that"
"""What an engineer should think of."""


@dataclass(frozen=True)
class Vibration:
    """A vibration of one joint's torque.

    Attributes:
        joint: its name. frequency: Hz. amplitude: N·m (N), median at the speeds where it is largest. standing: the same of what
            the torque does while the joint stands.
    """

    joint: str
    frequency: float
    amplitude: float
    standing: float

    def text(self, unit: str) -> str:
        """One clause about it; unit: of the torque."""
        return (
            f"the torque vibrates by {self.amplitude:.3g} {unit} at {self.frequency:.0f} Hz while the joint slides, and by "
            f"{self.standing:.2g} {unit} while it stands"
        )


def vibrations(trials: Sequence[Trajectory]) -> list[Vibration]:
    """The joints that vibrate while they slide, and not while they stand.

    Args:
        trials: with the same joints; those without a measured torque, or at another rate than the middle one, say nothing.
    """
    measured = [t for t in trials if t.effort is not None and t.samples > 1]
    if not measured:
        return []
    dt = sorted(t.dt for t in measured)[len(measured) // 2]
    alike = [t for t in measured if abs(t.dt - dt) < 0.01 * dt]
    found = (_vibration(alike, j, joint, dt) for j, joint in enumerate(measured[0].joints))
    return [vibration for vibration in found if vibration is not None]


def _vibration(trials: Sequence[Trajectory], j: int, joint: str, dt: float) -> Vibration | None:
    rows = max(round(WINDOW_S / dt), FEWEST_ROWS)
    speed = np.concatenate([_windows(np.abs(t.velocity[:, j]), rows) for t in trials])
    fast = float(np.quantile(np.concatenate([np.abs(t.velocity[:, j]) for t in trials]), 0.95))
    mean_speed = speed.mean(axis=1)
    stands = speed.max(axis=1) <= STANDING * fast
    slides = np.flatnonzero(mean_speed > STANDING * fast)
    if np.sum(stands) < FEWEST_WINDOWS or len(slides) < SPEEDS * FEWEST_WINDOWS:
        return None
    amplitude, line = _strongest_line(_not_commanded(trials, j, rows))
    ranges = np.array_split(slides[np.argsort(mean_speed[slides], kind="stable")], SPEEDS)
    sizes = [float(np.median(amplitude[each])) for each in ranges]
    size, standing = max(sizes), float(np.median(amplitude[stands]))
    torque = float(np.std(np.concatenate([t.effort[:, j] for t in trials])))
    if size < np.sqrt(2.0) * SHARE * torque or standing > CALM * size or size == 0.0:
        return None
    strong = slides[amplitude[slides] > 0.5 * size]
    rises = np.polyfit(np.log(mean_speed[strong]), np.log(line[strong]), 1)[0]
    cycles = float(np.median(line[strong]))
    if cycles < CYCLES or rises > FOLLOWS:
        return None
    return Vibration(joint, cycles / (rows * dt), size, standing)


def _windows(values: np.ndarray, rows: int) -> np.ndarray:
    """(W, rows) half overlapping."""
    if len(values) < rows:
        return np.zeros((0, rows))
    return np.lib.stride_tricks.sliding_window_view(values, rows)[:: rows // 2]


def _not_commanded(trials: Sequence[Trajectory], j: int, rows: int) -> np.ndarray:
    """(W, F) spectra of the torque's windows without what is in proportion to the commands, frequency by frequency."""
    commands = [name for name in COMMANDS if all(getattr(t, name) is not None for t in trials)]
    torque = _spectra([t.effort[:, j] for t in trials], rows)
    if not commands:
        return torque
    commanded = np.stack([_spectra([getattr(t, name)[:, j] for t in trials], rows) for name in commands], axis=-1)
    by_frequency = commanded.transpose(1, 0, 2)
    gains = np.linalg.pinv(by_frequency) @ torque.T[..., None]
    return torque - (by_frequency @ gains)[..., 0].T


def _spectra(signals: Sequence[np.ndarray], rows: int) -> np.ndarray:
    """(W, F) of all windows, scaled so that the absolute value at a line is its amplitude."""
    from scipy.signal import detrend
    from scipy.signal.windows import hann

    shape = hann(rows, sym=False)
    windows = np.concatenate([_windows(signal, rows) for signal in signals])
    return np.fft.rfft(detrend(windows, axis=1) * shape, axis=1) * (2.0 / np.sum(shape))


def _strongest_line(spectra: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(W,) amplitude of each window's strongest line, and its cycles in the window.

    The Hann window spreads a line over three frequencies: their powers add up to 3/2 of its own, and it lies at their mean.
    """
    power = np.abs(spectra[:, SLOWEST - 1 :]) ** 2
    line = power[:, :-2] + power[:, 1:-1] + power[:, 2:]
    window = np.arange(len(line))
    at = line.argmax(axis=1)
    strength = line[window, at]
    beside = (power[window, at + 2] - power[window, at]) / np.maximum(strength, np.finfo(float).tiny)
    return np.sqrt(strength / 1.5), SLOWEST + at + beside
