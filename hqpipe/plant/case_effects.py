"""The effects that a case can have, each as physics of the plant on the sound machine, at sizes that were measured.

A size is a parameter in the unit of diagnosis.json where plant and file speak of the same number. It is drawn within
±20 % of the table below, so that nobody can tune on a value. The table was set from the extra held-out free-run error
(100 ms windows, noise-free, the median joint) that the effect makes in all joints beside the 4.1 N·m of the sound
machine with its noise: about 2 N·m for small, 8 for typical, where the gap has doubled, 25 for large. A trot shows most
effects at a third of the size that the gantry needs. Position-dependent stiffness makes 2 to 4 N·m at best, because a
leaking chamber forgets its volume; supply droop 2, 7 and 9; viscous friction 2, 7 and 15. What needs load or flow to
show is not planted where the machine only hangs on the gantry.

A faint size is a factor on the small one, without jitter, counted from what the sound machine has of the effect, so
that nought is the sound machine.

Left out, because actuator and sensing logs of this plant cannot show them:

- `transmission_compliance`: a spring in series with the oil only lowers the stiffness, which the fit takes up.
- `load_dependent_friction`: the seals are pressed by both chambers, whose forces add up to a constant.
- `torque_scale` on all joints: without a reference the coefficients take it up. It is planted in single joints,
  legs and kinds, with the pressures logged beside a load cell.
- An encoder zero (`sensors.position_bias`): firmware and log share the encoder. `position_bias` is planted as the valve's
  null shift, by which the position that the controller works with differs from the logged one all the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hqpipe.errors import UsageError
from hqpipe.plant.case_machine import AREA_RATIO, BASE, PRESSURE
from hqpipe.plant.parameters import SUBSTEP

RADIUS = 0.06  # m, sprocket, robot.yaml
KP = 2.5  # opening per rad, robot.yaml's position loop
FIRMWARE_AREA = 8.0e-4  # m², the piston that the firmware reckons with, robot.yaml
RETURN_PRESSURE = 0.5e6  # Pa, robot.yaml
STROKE = 0.15  # m, robot.yaml
STRIBECK_SPEED = 0.02  # m/s, robot.yaml
SHORT_STROKE = 0.06  # m, ± 0.5 rad of joint travel: more than the cases use round the middle of the range
OVERDAMPED = (1.5, 2.5)  # ζ: the slower pole is 7 to 23 times slower than the other
FASTEST_HZ = 1000.0  # the spool's natural frequency, bound of the plant's schema
LEAD = SUBSTEP
"""s by which the integrated spool is ahead of its differential equation: its semi-implicit step leads by half a substep, and
the oil of a substep sees where it ends by another half. Measured with steps of a quarter: 0.04 ms."""
SPOOL_LAG = 2.0 * BASE["valve"]["damping_ratio"] / (2.0 * np.pi * BASE["valve"]["bandwidth_hz"])  # s, 2ζ/ω
OWN_LAG = SPOOL_LAG - LEAD  # s, of the sound machine
OWN_COULOMB = 2.0 * RADIUS * BASE["cylinder"]["coulomb_friction"]  # N·m, the sound seals
OWN_VISCOUS = 2.0 * RADIUS**2 * BASE["cylinder"]["viscous_friction"]  # N·m·s/rad, likewise
RELIEF = 0.5e6  # Pa, robot.yaml: what the sound relief valve closes over
HEAVY_PISTON = 2.0  # kg, robot.yaml: what the integrator needs on a short oil column
DROOPING_PUMP = 0.02  # m³/s; the trot takes 6 l/s on average and 12 at its peaks
PEAK_ERROR = (0.2, 0.1)  # rad, the largest position errors in a trot and on the gantry; measured on the sound machine
SOUND_TORQUE = RADIUS * FIRMWARE_AREA * AREA_RATIO * (PRESSURE - RETURN_PRESSURE)  # N·m, torque limit of its cylinders
SIZES = ("small", "typical", "large")
JITTER = 0.2  # sizes are drawn log-uniformly within ±20 %

Overrides = dict[str, Any]
Values = dict[str, float | None]
Build = Callable[[float, str, np.random.Generator], tuple[Overrides, Values]]


@dataclass(frozen=True)
class Recipe:
    """How an effect is planted.

    Attributes:
        name: as in diagnosis.json; for effects outside the library a name of its own.
        build: (size, effort source, generator) → overrides of one joint (or of the machine), and the parameters of
            diagnosis.json that they amount to; None where there is no such number.
        trot: small, typical and large where the machine trots, alone or beside the gantry; one number if it has no
            size.
        gantry: likewise on the gantry; None if it does not show there.
        layer: "actuator" or "sensing".
        outside: not in the library.
        machine: belongs to the whole machine.
        signed: the size is drawn with either sign.
        load_cell: torque must be measured in front of it.
        pressures: needs the chamber pressures in the log, and joints without it to compare with.
        other_area: another piston area stands for it, which logged pressures would give away as a wrong torque scale.
        jitter: sizes are drawn within this share.
        sound: the number of the machine that lacks the effect, in a trot and on the gantry; faint sizes start there.
        inverse: the effect grows with one over the number.
        faint: overrides beside a faint size, of what only larger ones need.
    """

    name: str
    build: Build
    trot: tuple[float, ...]
    gantry: tuple[float, ...] | None = None
    layer: str = "actuator"
    outside: bool = False
    machine: bool = False
    signed: bool = False
    load_cell: bool = False
    pressures: bool = False
    other_area: bool = False
    jitter: float = JITTER
    sound: tuple[float, float] = (0.0, 0.0)
    inverse: bool = False
    faint: Overrides = field(default_factory=dict)

    def draw(self, size: str | None, motion: str, rng: np.random.Generator) -> float:
        """A size for a machine that moves by `motion` ("gantry", "trot" or "both")."""
        table = self._table(motion)
        value = table[SIZES.index(size)] if size and len(table) > 1 else table[0]
        value *= float(np.exp(rng.uniform(np.log(1.0 - self.jitter), np.log(1.0 + self.jitter))))
        return -value if self.signed and rng.random() < 0.5 else value

    def draw_faint(self, factor: float, motion: str, rng: np.random.Generator) -> float:
        """The number that lies `factor` times as far from the sound machine as the small one.

        Args:
            factor: 1 gives the small size, 0 the sound machine. motion: "gantry", "trot" or "both".
        """
        small, sound = self._table(motion)[0], self.sound[motion == "gantry"]
        if self.inverse:
            value = 1.0 / (1.0 / sound + factor * (1.0 / small - 1.0 / sound))
        else:
            value = sound + factor * (small - sound)
        return -value if self.signed and rng.random() < 0.5 else value

    def _table(self, motion: str) -> tuple[float, ...]:
        table = self.gantry if motion == "gantry" else self.trot
        if table is None:
            raise UsageError(f"{self.name} does not show on the gantry alone: expected the motion trot or both")
        return table


def _set(**fields: float) -> Overrides:
    """Nested overrides from path with "__" for "."."""
    nested: Overrides = {}
    for path, value in fields.items():
        *sections, name = path.split("__")
        node = nested
        for section in sections:
            node = node.setdefault(section, {})
        node[name] = float(value)
    return nested


def command_delay(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    """To the firmware; a model without a spool counts the sound spool's own lag as delay."""
    return _set(firmware__command_delay=value), {"delay_s": value + OWN_LAG}


def valve_lag(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    """A slow spool of second order, overdamped so that one of its poles rules; 2ζ/ω less its lead counts as time constant."""
    damping = min(rng.uniform(*OVERDAMPED), np.pi * FASTEST_HZ * value)
    bandwidth = min(damping / (np.pi * value), FASTEST_HZ)
    fields = _set(valve__damping_ratio=damping, valve__bandwidth_hz=bandwidth)
    return fields, {"time_constant_s": value - LEAD}


def valve_deadband(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(valve__overlap=value * KP), {"half_width": value}


def flow_saturation(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(valve__opening_limit=value * KP), {"limit": value}


def orifice_flow(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    """A smaller cylinder at the same speed per opening and the same stiffness."""
    ratio = value / (RADIUS * FIRMWARE_AREA * (PRESSURE - RETURN_PRESSURE))
    shrink, base = ratio / AREA_RATIO, BASE["cylinder"]
    fields = _set(
        cylinder__area_a=base["area_a"] * shrink,
        cylinder__area_b=base["area_b"] * shrink,
        cylinder__dead_volume_a=base["dead_volume_a"] * shrink,
        cylinder__dead_volume_b=base["dead_volume_b"] * shrink,
        cylinder__leakage=base["leakage"] * shrink**2,
        fluid__bulk_modulus=BASE["fluid"]["bulk_modulus"] / shrink,
        valve__rated_flow=BASE["valve"]["rated_flow"] * shrink,
        sensors__pressure_noise=BASE["sensors"]["pressure_noise"] / shrink,
        sensors__pressure_resolution=BASE["sensors"]["pressure_resolution"] / shrink,
    )
    if source == "pressure":
        fields["sensors"]["effort_scale"] = ratio
    return fields, {"effort_max_nm": value}


def supply_droop(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    """A smaller pump whose relief valve closes over `value` Pa, so that the pressure falls with the flow that is drawn.

    The accumulator decides how fast; neither number of diagnosis.json follows from these alone.
    """
    fields = _set(
        supply__pump_flow=DROOPING_PUMP,
        supply__relief_override=value,
        supply__accumulator_volume=rng.uniform(2.0e-3, 20.0e-3),
    )
    return fields, {"droop": None, "recovery_s": None}


def sized_supply(supply: Overrides, pistons: Overrides, share: float) -> Overrides:
    """The supply of a machine of which some pistons draw less oil: pump and accumulator are smaller by as much, or its sag
    would be a faint one.

    Args:
        supply: of `supply_droop`. pistons: of `orifice_flow`, in one joint. share: of the joints that have these.
    """
    drawn = 1.0 - share * (1.0 - pistons["cylinder"]["area_a"] / BASE["cylinder"]["area_a"])
    sizes = {name: supply["supply"][name] * drawn for name in ("pump_flow", "accumulator_volume")}
    return {**supply, "supply": {**supply["supply"], **sizes}}


def direction_asymmetry(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(valve__asymmetry=value), {"ratio": value}


def position_dependent_stiffness(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    """A short cylinder with one small chamber, so that the stiffness ∝ 1/V_A + 1/V_B leans; its mean is kept through β.

    At mid stroke the slope of the oil is A R (V_A − V_B)/(V_A V_B) for equal areas. The chain in series with it lowers
    the slope of the two together, so no number is the same.
    """
    area, base = BASE["cylinder"]["area_a"], BASE["cylinder"]["dead_volume_a"]
    mean, sound = 0.5 * area * SHORT_STROKE, base + 0.5 * area * STROKE
    wide = base + mean
    narrow = 1.0 / (1.0 / wide + abs(value) / (area * RADIUS))
    name = "dead_volume_a" if value < 0.0 else "dead_volume_b"
    modulus = BASE["fluid"]["bulk_modulus"] * (2.0 / sound) / (1.0 / wide + 1.0 / narrow)
    fields = {
        "cylinder": {name: narrow - mean, "stroke": SHORT_STROKE, "piston_mass": HEAVY_PISTON},
        "fluid": {"bulk_modulus": modulus},
    }
    return fields, {"slope_per_rad": None}


def gain_drift(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(valve__gain_drift=value), {"rate_per_s": value}


def integral_action(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(firmware__position_pid__ki=value * KP), {"ki": value}


def coulomb_friction(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    """The seals rub behind the chain, whose stretch beside the oil's takes up part of it: no number is the same."""
    return _set(cylinder__coulomb_friction=value / (2.0 * RADIUS)), {"friction_nm": None}


def stribeck_friction(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    """The plant's curve falls as 1/(1 + (v/v_s)²), whose tail a Gaussian leaves to dry friction: no number is the same."""
    fields = _set(cylinder__stribeck_friction=value / (2.0 * RADIUS), cylinder__stribeck_velocity=STRIBECK_SPEED)
    return fields, {"static_nm": None, "velocity_rad_s": None}


def viscous_friction(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    """As for dry friction: 40 N·m·s/rad at the seals are about 32 at the load cell."""
    return _set(cylinder__viscous_friction=value / (2.0 * RADIUS**2)), {"nm_s_per_rad": None}


def backlash(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(chain__slack=value * RADIUS), {"gap": value}


def torque_bias(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(sensors__effort_bias=value), {"nm": value}


def torque_scale(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(sensors__effort_scale=value), {"ratio": value}


def position_bias(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(valve__neutral_offset=value * KP), {"rad": value}


def channel_skew(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(sensors__effort_delay=value), {"skew_s": value}


def unsigned_sensor(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(sensors__effort_unsigned=1.0), {}


def supply_ripple(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(supply__ripple_pressure=value, supply__ripple_hz=rng.uniform(7.0, 25.0)), {}


def sticking_valve(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(valve__stiction=value), {}


def crosstalk(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(valve__crosstalk=value), {}


def hysteresis(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(valve__hysteresis=value), {}


def dropped_frames(value: float, source: str, rng: np.random.Generator) -> tuple[Overrides, Values]:
    return _set(bus__drop_rate=value, bus__drop_duration=rng.uniform(0.02, 0.04)), {}


RECIPES: Mapping[str, Recipe] = {
    recipe.name: recipe
    for recipe in (
        Recipe("command_delay", command_delay, (3.0e-4, 1.8e-3, 6.0e-3), (9.0e-4, 5.0e-3, 12.0e-3)),
        Recipe(
            "valve_lag", valve_lag, (8.0e-4, 1.8e-3, 6.0e-3), (1.1e-3, 6.0e-3, 16.0e-3), sound=(SPOOL_LAG, SPOOL_LAG)
        ),
        Recipe("valve_deadband", valve_deadband, (8.0e-4, 3.2e-3, 9.0e-3), (6.0e-4, 2.6e-3, 11.0e-3)),
        # A limit acts on what exceeds it: half as far below the largest error is half the effect.
        Recipe(
            "flow_saturation",
            flow_saturation,
            (0.165, 0.145, 0.12),
            (0.07, 0.062, 0.052),
            jitter=0.05,
            sound=PEAK_ERROR,
        ),
        # The free-run error goes with one over the torque limit, from 20 kN·m to 3 (measured in a trot).
        Recipe(
            "orifice_flow",
            orifice_flow,
            (7000.0, 3000.0, 1500.0),
            other_area=True,
            sound=(SOUND_TORQUE, SOUND_TORQUE),
            inverse=True,
        ),
        Recipe("supply_droop", supply_droop, (6.0e6, 2.5e7, 4.5e7), machine=True, sound=(RELIEF, RELIEF)),
        Recipe("direction_asymmetry", direction_asymmetry, (0.008, 0.035, 0.1), (0.015, 0.06, 0.18), signed=True),
        Recipe(
            "position_dependent_stiffness",
            position_dependent_stiffness,
            (0.35, 0.8, 1.3),
            signed=True,
            # A load cell feels the heavy piston, which would be a gap of its own beside a faint slope.
            faint={"cylinder": {"piston_mass": BASE["cylinder"]["piston_mass"]}},
        ),
        Recipe("gain_drift", gain_drift, (0.004, 0.018, 0.05), (0.01, 0.04, 0.07), signed=True),
        Recipe("integral_action", integral_action, (0.015, 0.06, 0.25), (0.03, 0.13, 0.5)),
        Recipe(
            "coulomb_friction",
            coulomb_friction,
            (3.0, 14.0, 40.0),
            (3.0, 14.0, 40.0),
            load_cell=True,
            sound=(OWN_COULOMB, OWN_COULOMB),
        ),
        Recipe("stribeck_friction", stribeck_friction, (4.0, 13.0, 40.0), (4.0, 13.0, 40.0), load_cell=True),
        Recipe(
            "viscous_friction",
            viscous_friction,
            (10.0, 40.0, 100.0),
            load_cell=True,
            sound=(OWN_VISCOUS, OWN_VISCOUS),
        ),
        Recipe("backlash", backlash, (5.0e-4, 2.4e-3, 9.0e-3), (5.0e-4, 2.4e-3, 9.0e-3)),
        Recipe("torque_bias", torque_bias, (2.5, 9.0, 27.0), (2.5, 9.0, 27.0), "sensing", signed=True),
        Recipe(
            "torque_scale",
            torque_scale,
            (1.05, 1.15, 1.4),
            (1.05, 1.15, 1.4),
            "sensing",
            load_cell=True,
            pressures=True,
            jitter=0.02,
        ),
        Recipe(
            "position_bias", position_bias, (4.0e-4, 1.5e-3, 4.5e-3), (4.0e-4, 1.5e-3, 4.5e-3), "sensing", signed=True
        ),
        Recipe("channel_skew", channel_skew, (4.0e-4, 1.6e-3, 5.0e-3), (1.1e-3, 6.0e-3, 12.0e-3), "sensing"),
        Recipe("unsigned_sensor", unsigned_sensor, (1.0,), (1.0,), "sensing", jitter=0.0),
        Recipe("supply_ripple", supply_ripple, (5.0e6,), (8.0e6,), outside=True, machine=True),
        Recipe("sticking_valve", sticking_valve, (0.02,), (0.02,), outside=True),
        Recipe("crosstalk", crosstalk, (0.05,), (0.08,), outside=True, signed=True),
        Recipe("hysteresis", hysteresis, (0.01,), (0.012,), outside=True),
        Recipe("dropped_frames", dropped_frames, (1.5,), (2.0,), outside=True, machine=True),
    )
}
