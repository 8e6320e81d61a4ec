"""The model of one servo joint: its numbers, its windows, and the error of a free run in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.identify.model import Effect, Parameter, Samples
from hqpipe.layers.servo import kernel
from hqpipe.layers.servo.candidates import (
    CONSTANT_SHAPE,
    COUPLING_SHAPE,
    DIRECTION_SHAPE,
    POSITION_SHAPE,
    SLOW_SHAPE,
    SPEED_SHAPE,
    TIME_SHAPE,
    WITHIN,
)
from hqpipe.layers.servo.scale import Scale
from hqpipe.layers.servo.tracks import Tracks, Windows, state_noise
from hqpipe.layers.servo.trial_settings import TrialSettings

_FAR = 10.0  # times the travel, beyond which a run has diverged and its error counts no more
_COLUMN = {
    ("", "offset"): kernel.OFFSET,
    (CONSTANT_SHAPE, "torque"): kernel.OFFSET,
    ("", "command_lead_s"): kernel.COMMAND_LEAD,
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
    ("torque_limit", "back_emf_share"): kernel.BACK_EMF_SHARE,
    ("voltage_sag", "ohm"): kernel.SAG,
    ("position_bias", "rad"): kernel.BIAS,
    (DIRECTION_SHAPE, "ratio"): kernel.ASYMMETRY,
    (TIME_SHAPE, "rate_per_s"): kernel.DRIFT,
    (POSITION_SHAPE, "degree_1"): kernel.SHAPE_1,
    (POSITION_SHAPE, "degree_2"): kernel.SHAPE_2,
    (SPEED_SHAPE, "coefficient"): kernel.SQUARE,
    (SLOW_SHAPE, "share"): kernel.SLOW,
    (COUPLING_SHAPE, "share"): kernel.COUPLING,
}
_TOLERANCES = {
    "inertia": ("armature", "kg_m2"),
    "gain_tolerance": ("gain_error", "ratio"),
    "drag_tolerance": ("viscous_friction", "nm_s_per_rad"),
}
"""Tolerance of what is stated → the effect that is the same number: where that is present, the tolerance counts no more."""


@dataclass(frozen=True, eq=False)
class Split:
    """One split: its signals, windows, and the numbers of its trials; `kept` says which of the simulated samples are judged,
    `coupling` (N,) is the torque from other joints."""

    tracks: Tracks
    windows: Windows
    rows: np.ndarray
    kept: np.ndarray
    samples: Samples
    coupling: np.ndarray


@dataclass(frozen=True)
class Setting:
    """Length of a window and of the run-in before it, substeps of a sample; middle and half width of the travel; largest speed;
    s from row to row of the log, of which samples may have left some out; time constant of the slow share, s; largest torque,
    of which a limit cuts off a share; noise of the position sensor."""

    samples: int
    run_in: int
    substeps: int
    middle: float
    reach: float
    speed: float
    row_s: float
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
        settings: TrialSettings,
        damps_error: bool = False,
    ) -> None:
        """`splits`: fit and held-out. `settings`: gains and loads of the trials that are not stated. `damps_error`: the drive
        damps the speed of the error, not that of the joint."""
        self.joint, self.scale, self.base, self.effects = joint, scale, base, effects
        self.unit, self.damps_error = scale.angle, damps_error
        self.setting, self.notes, self.settings = setting, notes, settings
        self.splits = splits
        self.fit, self.heldout = (split.samples for split in splits)
        self.dt = float(np.median(splits[0].tracks.dt))
        named = [("", parameter) for parameter in base]
        named += [(effect.name, parameter) for effect in effects for parameter in effect.parameters]
        self._place = {(effect, parameter.name): k for k, (effect, parameter) in enumerate(named)}
        self._shared = [(k, _COLUMN[key]) for key, k in self._place.items() if key in _COLUMN]
        self._cuts = [self._place[key] for key in [("torque_limit", "share_cut_off")] if key in self._place]
        self._most = {p.name: WITHIN * p.high for p in base if p.name in _TOLERANCES and np.isfinite(p.high)}
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

    def error(self, values: np.ndarray, heldout: bool = False, coupling: float | None = None) -> np.ndarray:
        """(N,) predicted less measured position; see `hqpipe.identify.model.JointModel`.

        Args:
            coupling: share of the torque from other joints; None for that of `values`.
        """
        split = self.splits[int(heldout)]
        if len(split.samples.output) == 0:
            return np.empty(0)
        return self._predicted(values, split, coupling=coupling) - split.samples.output

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
        found += [p for p in self.base if p.name == name]  # an effect may stand for a change of the base, as a payload
        return name, value, found[0].unit

    def referred_to(self, values: np.ndarray, other: ServoJoint) -> np.ndarray:
        """(P,) the same torque limit as a share of the largest torque of another record."""
        moved = np.array(values, dtype=np.float64)
        for k in self._cuts:
            if values[k] > 0.0:
                moved[k] = max(1.0 - self.setting.torque * (1.0 - values[k]) / other.setting.torque, 0.0)
        return moved

    def _predicted(
        self,
        values: np.ndarray,
        split: Split,
        position: float = 0.0,
        velocity: float = 0.0,
        coupling: float | None = None,
    ) -> np.ndarray:
        """(N,) position at the judged samples; `position`, `velocity`: by which it starts off; `coupling`: as in `error`."""
        numbers, trials = self._numbers(np.asarray(values, dtype=np.float64), split)
        if coupling is not None:
            numbers[kernel.COUPLING] = coupling
        setting, tracks, windows = self.setting, split.tracks, split.windows
        constants = np.array(
            [
                float(not self.scale.duty),
                self.scale.stall or setting.torque,
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
            split.coupling,
            setting.run_in + setting.samples,
            setting.substeps,
        )
        run = run.ravel()[split.kept]
        far = _FAR * setting.reach
        return np.clip(np.nan_to_num(run, nan=setting.middle + far), setting.middle - far, setting.middle + far)

    def _numbers(self, values: np.ndarray, split: Split) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the kernel: those that all trials share, and those of each trial."""
        scale, setting, rows = self.scale, self.setting, split.rows
        numbers = np.zeros(len(kernel.NAMES))
        numbers[kernel.STRIBECK] = 1.0
        for k, column in self._shared:
            numbers[column] += values[k] - (column == kernel.STRIBECK)
        cut = numbers[kernel.INVERSE_LIMIT]
        numbers[kernel.INVERSE_LIMIT] = 1.0 / (setting.torque * (1.0 - cut)) if cut > 0.0 else 0.0
        numbers[kernel.SAG] /= scale.winding_ohm or 1.0
        if not scale.duty:
            # A delay is the same as less lead: beside one, commands count in the middle between two rows.
            lead = min(max(numbers[kernel.COMMAND_LEAD], 0.0), setting.row_s)
            numbers[kernel.COMMAND_LEAD] = lead if numbers[kernel.DELAY] == 0.0 else 0.5 * setting.row_s
        numbers[kernel.DAMPS_ERROR] = float(self.damps_error)
        own = {name: values[k] for (effect, name), k in self._place.items() if not effect}
        own |= {name: min(max(own[name], -most), most) for name, most in self._most.items()}
        for tolerance, key in _TOLERANCES.items():
            if scale.load or tolerance != "inertia":
                effect = values[self._place[key]] if key in self._place else 0.0
                own[tolerance] = own.get(tolerance, 0.0) if effect == 0.0 else effect * (key[0] != "viscous_friction")
        gain, inertia, gravity = self._ratios(own, rows)
        trials = np.empty((len(rows), 8))
        trials[:, kernel.INERTIA] = (scale.inertia[rows] + own["inertia"]) * inertia
        trials[:, kernel.GAIN] = scale.gain[rows] * own.get("gain", 1.0) * (1.0 + own.get("gain_tolerance", 0.0)) * gain
        trials[:, kernel.DRAG] = scale.drag[rows] * own.get("drag", 1.0) * (1.0 + own.get("drag_tolerance", 0.0))
        trials[:, kernel.LOAD_GRAVITY] = scale.gravity[rows]
        trials[:, kernel.MOUNTING] = own.get("mounting_rad", 0.0)
        trials[:, kernel.GRAVITY_SIN] = own.get("gravity_sin", 0.0) * gravity
        trials[:, kernel.GRAVITY_COS] = own.get("gravity_cos", 0.0) * gravity
        trials[:, kernel.STEP] = split.tracks.dt
        return numbers, trials

    def _ratios(self, own: dict[str, float], rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(R,) gain, inertia and gravity of trials over those of the first setting."""
        settings = self.settings
        gain, inertia, gravity = settings.gain.copy(), settings.load.copy(), settings.load.copy()
        for ratios, name in ((gain, "gain_ratio"), (inertia, "inertia_ratio"), (gravity, "gravity_ratio")):
            for k in settings.fitted:
                ratios[k] = own.get(f"{name}_{k}", ratios[k])
        group = settings.group[rows]
        return gain[group], inertia[group], gravity[group]

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


def samples_of(tracks: Tracks, windows: Windows, samples: int, run_in: int) -> tuple[np.ndarray, Samples]:
    """Which samples of the runs are judged, (M · (run_in + W)) bool, and those samples: usable ones after the run-in."""
    index = windows.start[:, None] + np.arange(1, run_in + samples + 1)
    kept = tracks.usable[index]
    kept[:, :run_in] = False
    kept = kept.ravel()
    index = index.ravel()[kept]
    held = np.repeat(tracks.position[windows.start + run_in], run_in + samples)[kept]
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
