"""The model of one servo joint: its numbers, its windows, and the error of a free run in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.identify.model import Effect, Parameter, Samples
from hqpipe.layers.servo import kernel
from hqpipe.layers.servo.candidates import (
    DIRECTION_SHAPE,
    POSITION_SHAPE,
    SLOW_SHAPE,
    SPEED_SHAPE,
    TIME_SHAPE,
)
from hqpipe.layers.servo.scale import Scale
from hqpipe.layers.servo.tracks import Tracks, Windows, state_noise

_FAR = 10.0  # times the travel, beyond which a run has diverged and its error counts no more
_COLUMN = {
    ("", "gravity_sin"): kernel.GRAVITY_SIN,
    ("", "gravity_cos"): kernel.GRAVITY_COS,
    ("", "offset"): kernel.OFFSET,
    ("", "command_lead_s"): kernel.COMMAND_RATE,
    ("", "duty_delay_s"): kernel.DELAY,
    ("command_delay", "delay_s"): kernel.DELAY,
    ("coulomb_friction", "friction_nm"): kernel.COULOMB,
    ("stribeck_friction", "static_nm"): kernel.STATIC,
    ("stribeck_friction", "velocity_rad_s"): kernel.STRIBECK,
    ("viscous_friction", "nm_s_per_rad"): kernel.VISCOUS,
    ("load_dependent_friction", "coefficient"): kernel.LOAD_FRICTION,
    ("backlash", "gap"): kernel.GAP,
    ("transmission_compliance", "compliance"): kernel.COMPLIANCE,
    ("torque_limit", "share_cut_off"): kernel.INVERSE_LIMIT,
    ("voltage_sag", "ohm"): kernel.SAG,
    ("position_bias", "rad"): kernel.BIAS,
    (DIRECTION_SHAPE, "ratio"): kernel.ASYMMETRY,
    (TIME_SHAPE, "rate_per_s"): kernel.DRIFT,
    (POSITION_SHAPE, "degree_1"): kernel.SHAPE_1,
    (POSITION_SHAPE, "degree_2"): kernel.SHAPE_2,
    (SPEED_SHAPE, "coefficient"): kernel.SQUARE,
    (SLOW_SHAPE, "share"): kernel.SLOW,
}
_TRIAL = {
    "inertia": 0,
    "armature": 0,
    "gain": 1,
    "drag": 2,
    "gain_error": 3,
    "gain_tolerance": 3,
    "drag_tolerance": 4,
}
"""What changes the numbers of single trials: index into inertia, gain, drag, and what stated gain and drag are off by."""


@dataclass(frozen=True, eq=False)
class Split:
    """One split: its signals, windows, and the numbers of its trials; `kept` says which of the (M · W) samples are judged."""

    tracks: Tracks
    windows: Windows
    rows: np.ndarray
    kept: np.ndarray
    samples: Samples


@dataclass(frozen=True)
class Setting:
    """Length of a window, substeps of a sample; middle and half width of the travel; largest speed; time constant of the slow
    share, s; largest torque, of which a limit cuts off a share; noise of the position sensor."""

    samples: int
    substeps: int
    middle: float
    reach: float
    speed: float
    slow_s: float
    torque: float
    sensor_noise: float


class ServoJoint:
    """A `hqpipe.identify.model.JointModel`."""

    def __init__(
        self,
        joint: str,
        scale: Scale,
        base: tuple[Parameter, ...],
        effects: tuple[Effect, ...],
        setting: Setting,
        splits: tuple[Split, Split],
        notes: tuple[str, ...],
        damps_error: bool = False,
    ) -> None:
        """`splits`: fit and held-out. `damps_error`: the drive damps the speed of the error, not that of the joint."""
        self.joint, self.scale, self.base, self.effects = joint, scale, base, effects
        self.unit, self.damps_error = scale.angle, damps_error
        self.setting, self.notes = setting, notes
        self._splits = splits
        self.fit, self.heldout = (split.samples for split in splits)
        self.dt = float(np.median(splits[0].tracks.dt))
        named = [("", parameter) for parameter in base]
        named += [(effect.name, parameter) for effect in effects for parameter in effect.parameters]
        self._slots = [_slot(effect, parameter.name) for effect, parameter in named]
        self._cuts = [k for k, slot in enumerate(self._slots) if slot == (True, kernel.INVERSE_LIMIT)]
        self._neutral = np.array([parameter.neutral for _, parameter in named])
        self.noise = tuple(self._noise(split) for split in splits)

    @property
    def changes(self) -> dict[str, tuple[str, ...]]:
        """Cause → base parameters that change with it; where none bends over the position, a weight is a constant torque."""
        if self.scale.load:
            return {}  # of each record the load is known
        names = [p.name for p in self.base]
        weight = [name for name in names if name.startswith("gravity")] or ["offset"]
        return {"payload": ("inertia", *weight)}

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        """(N,) predicted less measured position; see `hqpipe.identify.model.JointModel`."""
        split = self._splits[int(heldout)]
        if len(split.samples.output) == 0:
            return np.empty(0)
        return self._predicted(values, split) - split.samples.output

    def reported(self, effect: str, name: str, value: float) -> tuple[str, float, str]:
        """Name, value and unit under which a number that was fitted is answered.

        A torque limit is fitted as the share of the largest torque that it cuts off, and a spring as one over its stiffness,
        so that they can be absent; a gain as what it is off by, and answered as its ratio to the stated one.
        """
        if (effect, name) == ("torque_limit", "share_cut_off"):
            return "effort_max_nm", self.setting.torque * (1.0 - value) if value > 0.0 else np.inf, self.scale.torque
        if (effect, name) == ("gain_error", "ratio"):
            return name, 1.0 + value, "1"
        if (effect, name) == ("transmission_compliance", "compliance"):
            unit = f"{self.scale.torque}/{self.scale.angle}" if self.scale.si else "1"
            return "stiffness_nm_per_rad", 1.0 / value if value > 0.0 else np.inf, unit
        found = [p for e in self.effects if e.name == effect for p in e.parameters if p.name == name]
        found += [p for p in self.base if not effect and p.name == name]
        return name, value, found[0].unit

    def referred_to(self, values: np.ndarray, other: ServoJoint) -> np.ndarray:
        """(P,) the same torque limit as a share of the largest torque of another record."""
        moved = np.array(values, dtype=np.float64)
        for k in self._cuts:
            if values[k] > 0.0:
                moved[k] = max(1.0 - self.setting.torque * (1.0 - values[k]) / other.setting.torque, 0.0)
        return moved

    def _predicted(self, values: np.ndarray, split: Split, position: float = 0.0, velocity: float = 0.0) -> np.ndarray:
        """(N,) position at the judged samples, with initial states off by `position` and `velocity`."""
        numbers, trials = self._numbers(np.asarray(values, dtype=np.float64), split)
        setting, tracks, windows = self.setting, split.tracks, split.windows
        constants = np.array(
            [
                float(not self.scale.duty),
                self.scale.stall or 1.0,
                setting.middle,
                setting.reach,
                setting.speed,
                1.0 if self.scale.load else 2.0,
                setting.slow_s,
            ]
        )
        run = kernel.simulate(
            numbers,
            constants,
            trials,
            windows.trial,
            windows.start,
            windows.first,
            tracks.time[windows.start],
            tracks.smooth[windows.start] + position,
            tracks.velocity[windows.start] + velocity,
            tracks.smooth,
            tracks.velocity,
            tracks.inputs,
            tracks.rate,
            setting.samples,
            setting.substeps,
        )
        run = run.ravel()[split.kept]
        far = _FAR * setting.reach
        return np.clip(np.nan_to_num(run, nan=setting.middle + far), setting.middle - far, setting.middle + far)

    def _numbers(self, values: np.ndarray, split: Split) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the kernel: those that all trials share, and those of each trial."""
        numbers = np.zeros(len(kernel.NAMES))
        numbers[kernel.STRIBECK] = 1.0
        own = np.array([0.0, 1.0, 1.0, 0.0, 0.0])  # see `_TRIAL`
        for (shared, column), value in zip(self._slots, values, strict=True):
            if shared:
                numbers[column] = value
            elif column in (1, 2):
                own[column] = value
            else:
                own[column] += value
        inertia, gain, drag, gain_off, drag_off = own
        scale, rows = self.scale, split.rows
        cut = numbers[kernel.INVERSE_LIMIT]
        numbers[kernel.INVERSE_LIMIT] = 1.0 / (self.setting.torque * (1.0 - cut)) if cut > 0.0 else 0.0
        numbers[kernel.SAG] /= scale.winding_ohm or 1.0
        trials = np.empty((len(rows), 5))
        trials[:, kernel.INERTIA] = scale.inertia[rows] + inertia
        trials[:, kernel.GAIN] = scale.gain[rows] * gain * (1.0 + gain_off)
        trials[:, kernel.DRAG] = scale.drag[rows] * drag * (1.0 + drag_off)
        if self.damps_error:
            numbers[kernel.COMMAND_RATE] += np.median(trials[:, kernel.DRAG] / trials[:, kernel.GAIN])
        trials[:, kernel.LOAD_GRAVITY] = scale.gravity[rows]
        trials[:, kernel.STEP] = split.tracks.dt
        return numbers, trials

    def _noise(self, split: Split) -> float:
        """Root mean square that the noise of the position sensor leaves: that of the sample, and of the initial state."""
        if len(split.samples.output) == 0:
            return 0.0
        sensor = self.setting.sensor_noise
        position, velocity = (sensor * share for share in state_noise(self.dt))
        sound = self._predicted(self._neutral, split)
        moved = self._predicted(self._neutral, split, position=position) - sound
        faster = self._predicted(self._neutral, split, velocity=velocity) - sound
        return float(np.sqrt(sensor**2 + np.mean(moved**2) + np.mean(faster**2)))


def _slot(effect: str, name: str) -> tuple[bool, int]:
    """Whether a parameter is shared by all trials, and its column."""
    if (effect, name) in _COLUMN:
        return True, _COLUMN[effect, name]
    return False, _TRIAL[effect or name]


def samples_of(tracks: Tracks, windows: Windows, samples: int) -> tuple[np.ndarray, Samples]:
    """Which samples of the windows are judged, (M · W) bool, and those samples."""
    index = (windows.start[:, None] + np.arange(1, samples + 1)).ravel()
    kept = tracks.usable[index]
    index = index[kept]
    held = np.repeat(tracks.position[windows.start], samples)[kept]
    found = Samples(
        files=tracks.files,
        trial=tracks.trial[index],
        time=tracks.time[index],
        position=tracks.smooth[index],
        velocity=tracks.velocity[index],
        output=tracks.position[index],
        held=held,
    )
    return kept, found
