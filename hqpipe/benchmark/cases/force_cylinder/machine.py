"""Servo-valve cylinders that are commanded in force, as those of hydraulic robots. Drawn, not yet run.

A force loop turns its error into an opening and adds what the piston's own speed needs (Boaventura et al. 2012). Without
effects it is of first order behind a fast spool: the drive evens out the areas and the pressure drops.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hqpipe.benchmark.cases.cylinder.hydraulics import AXIS, MODULUS
from hqpipe.benchmark.cases.cylinder.machine import NEVER, STIFF_PUMP, CylinderLogger, CylinderMachine
from hqpipe.benchmark.cases.electric.machine import draw_jitter, draw_trials
from hqpipe.benchmark.cases.force_cylinder.loop import LOOP
from hqpipe.benchmark.cases.motions import Range, course
from hqpipe.benchmark.cases.planted import Motion

FAMILY = "torque_cylinder"
RATES = (200.0, 250.0, 500.0, 1000.0, 1000.0)  # Hz, of the logs
MOTIONS = ("sines", "chirp", "pick_and_place", "trapezoids", "slow_sweep")
STOPS = 0.3  # share of the machines whose pistons rest on their ends between strokes; assumption
HOSES = 1.0  # volume of hoses and ports over that of the cylinder; assumption: a manifold on the body feeds the joints
KEPT_S = 1.0e-3  # s, between the rows of a motion
ROUNDING_S = 0.06  # s, each of two moving averages, so that no jump of the acceleration is asked for; assumption
TURN = 2.4  # rad that a joint turns at most, as legs do; assumption
SLOWEST = 60.0  # rad/s, of a load on its oil; assumption: robots are built stiffer than 10 Hz


@dataclass(frozen=True)
class ForceMachine(CylinderMachine):
    """A machine and its motions.

    Attributes:
        loops: (J,) of `LOOP`. force: (J,) typical N of the motion. source: as in logset.yaml. effort_noise: (J,) N RMS.
        stiffness: (J,) N/m of the oil on both sides of the piston in the middle of its stroke.
    """

    loops: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=LOOP))
    force: np.ndarray = field(default_factory=lambda: np.zeros(0))
    stiffness: np.ndarray = field(default_factory=lambda: np.zeros(0))
    effort_noise: np.ndarray = field(default_factory=lambda: np.zeros(0))
    source: str = "load_cell"


def draw_force_cylinder(rng: np.random.Generator) -> ForceMachine:
    """One to four cylinders on one pump."""
    count = int(rng.choice([1, 1, 2, 3, 4]))
    pressure = rng.uniform(1.0e7, 2.1e7)
    axes = np.zeros(count, dtype=AXIS)
    top = rng.uniform(0.4, 0.9) * rng.uniform(0.85, 1.15, count)
    stiffness = _set_cylinders(axes, pressure, top, rng)
    stops = bool(rng.random() < STOPS)
    rooms = tuple(_room(axis, speed, stops, rng) for axis, speed in zip(axes, top, strict=True))
    rotary = bool(rng.random() < 0.7)
    rate = float(rng.choice(RATES))
    trials = draw_trials(count, False, False, rate, rng, MOTIONS)
    force = _set_loads(axes, _accelerations(rooms, trials), pressure, stiffness, rng)
    flow = float(np.sum(top * axes["area_a"]))
    slope = flow / (STIFF_PUMP * pressure)
    pressures = bool(rng.random() < 0.4)
    logger = CylinderLogger(
        rate_hz=rate,
        jitter=draw_jitter(rng),
        host_hz=float(rng.choice([250.0, 500.0, 1000.0])),
        speed=bool(rng.random() < 0.7),
        pressures=pressures,
        supply=pressures and bool(rng.random() < 0.4),
        resolution=float(rng.choice([2e-6, 5e-6, 1e-5])),
        noise=float(rng.uniform(1e-6, 5e-6)),
        pressure_noise=float(rng.uniform(1e4, 4e4)),
    )
    stem = str(rng.choice(["leg", "knee", "joint", "axis"]))
    return ForceMachine(
        names=(stem,) if count == 1 else tuple(f"{stem}_{n + 1}" for n in range(count)),
        kinds=("revolute" if rotary else "prismatic",) * count,
        axes=axes,
        rooms=rooms,
        top_speed=top,
        supply=(pressure, slope, 0.01 * slope, NEVER),
        radius=max(float(rng.uniform(0.03, 0.08)), float(np.max(axes["stroke"])) / TURN),
        stops=stops,
        logger=logger,
        trials=trials,
        family=FAMILY,
        loops=_loops(axes, top, stiffness, pressure, rng),
        force=force,
        stiffness=stiffness,
        effort_noise=force * rng.uniform(0.003, 0.015),
        source="pressure" if rng.random() < 0.5 else "load_cell",
    )


def _set_cylinders(axes: np.ndarray, pressure: float, top: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Pistons and servo valves, `top` (J,) m/s at full opening; (J,) N/m of the oil in mid-stroke."""
    count = len(axes)
    bore, rod = rng.uniform(0.025, 0.05, count), rng.uniform(0.4, 0.7, count)  # m; rod over bore
    axes["area_a"] = np.pi / 4.0 * bore**2
    axes["area_b"] = axes["area_a"] * (1.0 - rod**2)
    axes["stroke"] = rng.uniform(0.1, 0.3, count)
    axes["dead_volume"] = HOSES * axes["area_a"] * axes["stroke"]
    ratio = axes["area_b"] / axes["area_a"]
    axes["coefficient"] = top * axes["area_a"] / np.sqrt(pressure / (1.0 + ratio))  # as in `cases.cylinder.machine`
    axes["return_gain"] = 1.0 / np.sqrt(ratio)
    axes["side_a"], axes["side_b"] = 1.2 * axes["stroke"], 1.5 * axes["stroke"]
    axes["load_angle"] = rng.uniform(0.2, 1.2, count)
    axes["lag"] = rng.uniform(0.001, 0.002)  # s, servo valves of 80 to 160 Hz
    axes["limit"] = 1.0
    axes["jump_from"] = NEVER
    axes["jump_gain"] = axes["hunting_hz"] = axes["meter_out"] = 1.0
    half = 0.5 * axes["stroke"]
    volume_a = axes["dead_volume"] + axes["area_a"] * half
    volume_b = axes["dead_volume"] + axes["area_b"] * half
    return MODULUS * (axes["area_a"] ** 2 / volume_a + axes["area_b"] ** 2 / volume_b)


def _accelerations(rooms: tuple[Range, ...], trials: tuple[Motion, ...]) -> np.ndarray:
    """(J,) m/s² that the motions reach in 5 % of the time of the liveliest trial."""
    found = np.zeros(len(rooms))
    for trial in trials:
        acceleration = motion(rooms, trial)[2]
        found = np.maximum(found, np.quantile(np.abs(acceleration), 0.95, axis=0))
    return found


def motion(rooms: tuple[Range, ...], trial: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(T, J) m, m/s and m/s² that the host asks for, a row a millisecond."""
    from scipy.ndimage import uniform_filter1d

    time, width = np.arange(round(trial.seconds / KEPT_S)) * KEPT_S, round(ROUNDING_S / KEPT_S)
    columns = []
    for j, room in enumerate(rooms):
        place = course(trial.names[j], time, room, np.random.default_rng([trial.seed, j]))
        columns.append(uniform_filter1d(uniform_filter1d(place, width, mode="nearest"), width, mode="nearest"))
    place = np.column_stack(columns)
    speed = np.gradient(place, KEPT_S, axis=0)
    return place, speed, np.gradient(speed, KEPT_S, axis=0)


def _set_loads(
    axes: np.ndarray, acceleration: np.ndarray, pressure: float, stiffness: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Masses that the motion shakes and weights; (J,) typical N of the motion."""
    count, full = len(axes), pressure * axes["area_a"]
    axes["load_force"] = rng.uniform(0.02, 0.08, count) * full
    mass = rng.uniform(0.15, 0.3, count) * full / acceleration
    axes["mass"] = np.minimum(mass, stiffness / SLOWEST**2)
    # Seals: next to nothing leaks, and friction is 1 % of what would hold the mass on its oil.
    natural = np.sqrt(stiffness / axes["mass"])
    axes["leakage"] = 0.01 * natural * axes["area_a"] ** 2 / stiffness
    axes["damper_lag"] = 3.0 / natural
    axes["viscous"] = 0.01 * natural * axes["mass"]
    return 0.5 * axes["load_force"] + 0.5 * axes["mass"] * acceleration


def _loops(
    axes: np.ndarray, top: np.ndarray, stiffness: np.ndarray, pressure: float, rng: np.random.Generator
) -> np.ndarray:
    count = len(axes)
    loops = np.zeros(count, dtype=LOOP)
    bandwidth = rng.uniform(120.0, 240.0) * rng.uniform(0.9, 1.1, count)  # rad/s, force loops of 19 to 38 Hz
    loops["force_gain"] = bandwidth / (stiffness * top)
    loops["speed_gain"] = rng.uniform(0.94, 1.0, count) / top
    loops["nominal"] = pressure
    half = axes["dead_volume"] + 0.5 * axes["area_a"] * axes["stroke"]
    loops["share_a"] = MODULUS * axes["area_a"] ** 2 / half / stiffness
    loops["cell_lag"], loops["speed_lag"] = 0.3e-3, 0.7e-3  # s; assumption: usual filters of 200 to 500 Hz
    outer = rng.uniform(5.0, 9.0)  # rad/s, of the host's motion control
    loops["inertia"] = axes["mass"] * rng.uniform(0.9, 1.1, count)
    loops["stiffness"], loops["damping"] = outer**2, 1.4 * outer
    loops["weight"] = rng.uniform(0.8, 1.0, count)
    loops["force_limit"] = 0.4 * pressure * axes["area_b"]
    return loops


def _room(axis: np.void, top: float, stops: bool, rng: np.random.Generator) -> Range:
    stroke = float(axis["stroke"])
    swing = stroke * (rng.uniform(0.53, 0.6) if stops else rng.uniform(0.2, 0.35))
    share = rng.uniform(0.7, 0.9)
    return Range(0.5 * stroke, swing, share * top, 40.0 * share * top)
