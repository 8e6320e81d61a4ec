"""Parameters of the base and of the effects, with the sizes that a data sheet would give."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hqpipe.identify.model import Effect, Parameter
from hqpipe.layers.joint_motion.columns import Columns
from hqpipe.layers.joint_motion.output import Output

FRICTION = 0.2  # of the rms torque: friction of geared joints is a tenth to a fifth (Armstrong-Hélouvry 1994)
STRIBECK = 0.1  # of the rms torque: half of the dry friction, as in the worked cases of Canudas de Wit et al. (1995)
STRIBECK_SPEED = 0.1  # of the rms speed; assumption: friction falls over the slowest tenth
LOAD_FRICTION = 0.1  # of the transmitted torque: gears of 0.9 efficiency
ELASTIC = 0.2  # of the rms torque over the travel; assumption: a spring that balances more is stated with the machine
ASYMMETRY = 0.3  # assumption: seals and worm gears differ by direction by tens of per cent
SKEW_S = 0.005  # one cycle of a bus at 200 Hz; one sample of a slower log
MOST_CYCLES = 10.0  # of such a bus, or of the log; assumption: later channels are seen by eye
DRIFT = 0.05  # over a trial: torque constant of a magnet motor, −0.1 to −0.2 %/K (datasheets), over some tens of kelvin
SCALE = 0.1  # torque constants are stated within 10 %
SHAPE = 0.2  # of the rms torque; assumption: as large as friction, so that no name is preferred for its size

DIRECT = {  # effect → (parameter, unit, group of its column)
    "coulomb_friction": ("friction_nm", "N·m", "coulomb"),
    "viscous_friction": ("nm_s_per_rad", "N·m·s/rad", "viscous"),
    "spring": ("nm_per_rad", "N·m/rad", "spring"),
    "load_dependent_friction": ("coefficient", "1", "load"),
}
SHAPES = {  # generic shape → (group of its columns, signal)
    "position_shape": ("position", "position"),
    "velocity_shape": ("velocity", "velocity"),
    "acceleration_shape": ("acceleration", "acceleration and position"),
    "friction_by_time": ("halves", "time"),
    "ripple_shape": ("ripple", "position"),
    "hysteresis_shape": ("hysteresis", "way since the last reversal"),
}


@dataclass(frozen=True)
class Scale:
    """Sizes of a joint's signals in the fit trials.

    Attributes:
        torque: root mean square about the mean. largest: that the drive puts out in these logs.
        speed: root mean square, rad/s. travel: standard deviation, rad. seconds: length of a trial. step: s, of the log.
    """

    torque: float
    largest: float
    speed: float
    travel: float
    seconds: float
    step: float


def base_parameters(
    output: Output, columns: Columns, start: Mapping[str, float], most: float, step: float
) -> tuple[Parameter, ...]:
    """Inertia, constant torque and, for a joint that turns, gravity; with a known load its angle only.

    The coefficient of cos(q − mean) − 1 is the gravity in the mean posture, which the drive holds: it is bounded by `most`.
    Over a small travel nothing else keeps it from taking up any bend of the residual.

    So has every log a time between torque and position within a sample: commands are held for one, and channels are read one
    after another.

    Args:
        start: name → value of a first fit. most: largest torque of the drive in these logs, N·m. step: s, of the log.
    """

    def free(name, unit, low=-np.inf, high=np.inf):
        return Parameter(name, output.unit_of(unit), float(np.clip(start[name], low, high)), np.inf, low, high)

    timing = Parameter("timing_s", "s", 0.0, step / np.sqrt(12.0), -0.5 * step, 0.5 * step)  # anywhere in a sample
    if "gravity_angle_rad" in start:
        return free("offset_nm", "N·m"), free("gravity_angle_rad", "rad"), timing
    found = [free("inertia_kg_m2", "kg·m²", 0.0), free("offset_nm", "N·m")]
    if columns["gravity"]:
        found.append(free("gravity_sin_nm", "N·m"))
    if len(columns["gravity"]) > 1:
        found.append(free("gravity_cos_nm", "N·m", -most, most))
    return *found, timing


def effects_of(
    output: Output, columns: Columns, scale: Scale, size: np.ndarray, known_load: bool, keeps: Callable[[str], bool]
) -> tuple[Effect, ...]:
    """All candidates that `keeps` lets pass.

    Args:
        size: (K,) root mean square of the columns.
    """
    found = [*_direct(output, scale), *_indirect(output, columns, scale)]
    if known_load:
        found += [
            Effect("armature", (Parameter("kg_m2", output.unit_of("kg·m²"), 0.0, output.inertia, 0.0),)),
            Effect("torque_scale", (Parameter("ratio", "1", 0.0, SCALE, -0.9, 9.0),)),
        ]
    found += _shapes(output, columns, scale, size)
    return tuple(effect for effect in found if keeps(effect.name))


def _direct(output: Output, scale: Scale) -> list[Effect]:
    """Effects whose number is the coefficient of a column."""
    sizes = {
        "coulomb_friction": FRICTION * scale.torque,
        "viscous_friction": FRICTION * scale.torque / scale.speed,
        "spring": ELASTIC * scale.torque / scale.travel,
        "load_dependent_friction": LOAD_FRICTION,
    }
    found = []
    for name, (own, unit, _) in DIRECT.items():
        most = 1.0 if unit == "1" else np.inf  # friction of the whole load: the gear locks itself
        number = Parameter(own, output.unit_of(unit), 0.0, sizes[name], 0.0, most)
        found.append(Effect(name, (number,), common=name in ("coulomb_friction", "viscous_friction")))
    return found


def _indirect(output: Output, columns: Columns, scale: Scale) -> list[Effect]:
    """Named effects in whose numbers the torque is not linear, and the drift."""
    lowest, top = columns.speeds[0], columns.speeds[-1]
    slow = float(np.clip(STRIBECK_SPEED * scale.speed, lowest, top))
    static = Parameter("static_nm", output.unit_of("N·m"), 0.0, STRIBECK * scale.torque, 0.0)
    speed = Parameter(
        "velocity_rad_s", output.unit_of("rad/s"), slow, slow, lowest, top, _within(slow, lowest, top), shape=True
    )
    drift = Parameter("rate_per_s", "1/s", 0.0, DRIFT / scale.seconds)
    return [
        Effect("stribeck_friction", (static, speed)),
        Effect("direction_asymmetry", (Parameter("ratio", "1", 0.0, ASYMMETRY, -1.0, 1.0),)),
        Effect("channel_skew", (_skew(scale),)),
        Effect("torque_by_time", (drift,), named=False, signal="time"),
    ]


def _shapes(output: Output, columns: Columns, scale: Scale, size: np.ndarray) -> list[Effect]:
    """Generic shapes whose columns there are."""
    found = []
    for name, (group, signal) in SHAPES.items():
        if not columns[group]:
            continue
        # A gravity is no larger than what the drive holds, however small the travel over which it is seen.
        most = scale.largest if output.turns and group == "position" else np.inf
        own = tuple(
            Parameter(f"coefficient_{i + 1}", output.unit, 0.0, min(SHAPE * scale.torque / max(size[k], 1e-300), most))
            for i, k in enumerate(columns[group])
        )
        found.append(Effect(name, own, named=False, signal=signal))
    return found


def _within(value: float, low: float, high: float) -> tuple[float, ...]:
    return tuple(float(v) for v in np.unique(np.clip([0.3 * value, value, 3.0 * value], low, high)))


def _skew(scale: Scale) -> Parameter:
    size = max(SKEW_S, scale.step)
    most = MOST_CYCLES * size
    return Parameter("skew_s", "s", 0.0, size, -most, most)
