"""Hydraulic cylinders without effects: speed in proportion to the valve command, after a short lag, beside a neutral offset.

The orifices and the unequal areas are there. What they would add is small by the choice of the machine: the load takes 1 to 4 %
of the supply's force, the drive evens out the areas, and the pump answers a fall of its pressure at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from hqpipe.benchmark.cases.cylinder.hydraulics import AXIS, MODULUS
from hqpipe.benchmark.cases.electric.machine import draw_jitter, draw_trials
from hqpipe.benchmark.cases.motions import Range
from hqpipe.benchmark.cases.planted import Motion

STEP = 1.0e-4  # s
RATES = (50.0, 100.0, 100.0, 200.0, 250.0)  # Hz, of the logs
NEVER = 1.0e9  # command or time that is not reached
STIFF_PUMP = 0.004  # share of the pressure by which a sound supply falls at the full flow of one cylinder; assumption
MOTIONS = ("sines", "chirp", "pick_and_place", "trapezoids", "steps", "slow_sweep")


@dataclass(frozen=True)
class CylinderLogger:
    """What is recorded, and how well.

    Attributes:
        rate_hz, jitter, host_hz: as in `cases.electric.machine.Logger`. speed, pressures, supply: recorded or not.
        resolution, noise: m, of the position. pressure_noise: Pa RMS.
    """

    rate_hz: float
    jitter: float
    host_hz: float
    speed: bool
    pressures: bool
    supply: bool
    resolution: float
    noise: float
    pressure_noise: float


@dataclass(frozen=True)
class CylinderMachine:
    """A machine and its motions.

    Attributes:
        names, kinds: of the joints. axes: (J,) of `AXIS`. rooms: m, where each piston moves.
        top_speed: (J,) m/s at full opening. supply: Pa, m³/(s·Pa), m³/Pa, m³/s, as in `run_cylinders`.
        radius: m of the pinion on the rack of a joint that turns. stops: the host drives the pistons onto their ends.
        sensing: what is wrong with channels.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    axes: np.ndarray
    rooms: tuple[Range, ...]
    top_speed: np.ndarray
    supply: tuple[float, float, float, float]
    radius: float
    stops: bool
    logger: CylinderLogger
    trials: tuple[Motion, ...]
    sensing: dict[str, float] = field(default_factory=dict)
    family: str = "cylinder"

    def radius_of(self, j: int) -> float:
        return self.radius if self.kinds[j] == "revolute" else 1.0


def draw_cylinder(rng: np.random.Generator) -> CylinderMachine:
    """One to four cylinders on one pump."""
    count = int(rng.choice([1, 1, 2, 3, 4]))
    pressure = rng.uniform(1.5e7, 2.5e7)
    axes = np.zeros(count, dtype=AXIS)
    top = rng.uniform(0.12, 0.4) * rng.uniform(0.85, 1.15, count)
    _set_cylinders(axes, pressure, top, rng)
    axes["neutral"] = rng.uniform(-0.03, 0.03, count)
    axes["lag"] = rng.uniform(0.008, 0.02)
    axes["loop_gain"] = rng.uniform(1.5, 4.0) / top
    axes["feedforward"] = rng.choice([0.0, 0.8, 1.0]) / top
    axes["sent_limit"] = 1.0
    axes["limit"] = axes["jump_from"] = NEVER
    axes["jump_gain"] = axes["hunting_hz"] = axes["meter_out"] = 1.0
    stops = bool(rng.random() < 0.15)
    rooms = tuple(_room(axis, speed, stops, rng) for axis, speed in zip(axes, top, strict=True))
    flow = float(np.sum(top * axes["area_a"]))
    slope = flow / (STIFF_PUMP * pressure)
    rotary = bool(rng.random() < 0.3)
    rate = float(rng.choice(RATES))
    pressures = bool(rng.random() < 0.4)
    logger = CylinderLogger(
        rate_hz=rate,
        jitter=draw_jitter(rng),
        host_hz=rate if rate >= 100.0 else 100.0,
        speed=bool(rng.random() < 0.4),
        pressures=pressures,
        supply=pressures and bool(rng.random() < 0.4),
        resolution=float(rng.choice([2e-5, 5e-5, 1e-4])),
        noise=float(rng.uniform(1e-5, 5e-5)),
        pressure_noise=float(rng.uniform(2e4, 8e4)),
    )
    stem = str(rng.choice(["cylinder", "boom", "axis", "joint"]))
    return CylinderMachine(
        names=(stem,) if count == 1 else tuple(f"{stem}_{n + 1}" for n in range(count)),
        kinds=("revolute" if rotary else "prismatic",) * count,
        axes=axes,
        rooms=rooms,
        top_speed=top,
        supply=(pressure, slope, 0.01 * slope, NEVER),  # the sound pump answers within 10 ms
        radius=float(rng.uniform(0.1, 0.25)),
        stops=stops,
        logger=logger,
        trials=draw_trials(count, False, False, rate, rng, MOTIONS),
    )


def _set_cylinders(axes: np.ndarray, pressure: float, top: np.ndarray, rng: np.random.Generator) -> None:
    """Pistons, loads and valves; `top` (J,) m/s at full opening."""
    count = len(axes)
    bore, rod = rng.uniform(0.04, 0.09, count), rng.uniform(0.4, 0.7, count)  # m; rod over bore
    axes["area_a"] = np.pi / 4.0 * bore**2
    axes["area_b"] = axes["area_a"] * (1.0 - rod**2)
    axes["stroke"] = rng.uniform(0.3, 0.7, count)
    axes["dead_volume"] = 0.1 * axes["area_a"] * axes["stroke"]
    ratio = axes["area_b"] / axes["area_a"]
    # Steady speed of the unloaded piston: extending v = K √(p/(1+r))/A; retracting √r times that, which the drive evens out.
    axes["coefficient"] = top * axes["area_a"] / np.sqrt(pressure / (1.0 + ratio))
    axes["return_gain"] = 1.0 / np.sqrt(ratio)
    axes["side_a"], axes["side_b"] = 1.2 * axes["stroke"], 1.5 * axes["stroke"]
    axes["load_angle"] = rng.uniform(0.6, 1.2, count)
    load_axes(axes, rng.uniform(0.01, 0.04, count) * pressure * axes["area_a"], rng.uniform(1.0, 2.0, count))


def load_axes(axes: np.ndarray, force: np.ndarray, lever: np.ndarray) -> None:
    """Hang loads on the linkages.

    Args:
        force: (J,) N on the cylinder. lever: (J,) of the load's arm over the cylinder's, which makes its mass feel heavier.
    """
    axes["load_force"] = force
    axes["mass"] = 20.0 + np.abs(force) / 9.81 * lever
    volume = axes["dead_volume"] + 0.5 * axes["area_a"] * axes["stroke"]
    softness = volume / (2.0 * MODULUS)
    natural = np.sqrt(axes["area_a"] ** 2 / (softness * axes["mass"]))  # rad/s, oil column under the load
    axes["leakage"] = 0.01 * natural * softness  # seals: next to nothing
    # Valves and hoses damp an oil column to 0.3; as dynamic pressure feedback, so that a steady load leaks nothing; assumption.
    axes["damper"] = 2.0 * 0.3 * natural * softness
    axes["damper_lag"] = 3.0 / natural
    axes["viscous"] = 0.03 * natural * axes["mass"]


def _room(axis: np.void, top: float, stops: bool, rng: np.random.Generator) -> Range:
    stroke = float(axis["stroke"])
    swing = stroke * (rng.uniform(0.53, 0.6) if stops else rng.uniform(0.2, 0.4))
    share = rng.uniform(0.5, 0.8)
    return Range(0.5 * stroke, swing, share * top, 4.0 * share * top)


def with_settings(machine: CylinderMachine, settings: dict[str, dict[str, float]]) -> CylinderMachine:
    """The machine with fields of its axes, of its supply or of its channels set, joint by joint."""
    axes, supply, sensing = machine.axes.copy(), list(machine.supply), dict(machine.sensing)
    for name, fields in settings.items():
        j = machine.names.index(name)
        for key, value in fields.items():
            if key == "load_share":
                one = axes[j : j + 1]
                load_axes(one, np.array([value * supply[0]]) * one["area_a"], np.array([2.0]))
            elif key in AXIS.names:
                axes[key][j] = value
            elif key in ("pump_slope", "pump_capacity"):
                supply[1 if key == "pump_slope" else 2] = value
            else:
                sensing[f"{key}/{j}"] = value
    return replace(machine, axes=axes, supply=(supply[0], supply[1], supply[2], supply[3]), sensing=sensing)


def at_viscosity(machine: CylinderMachine, factor: float) -> CylinderMachine:
    """The machine with oil of another viscosity: seals drag more and leak less by as much."""
    axes = machine.axes.copy()
    axes["viscous"] *= factor
    for name in ("leakage", "worn"):
        axes[name] /= factor
    return replace(machine, axes=axes)
