"""The withheld-effect cases: always the same, in fixed shares, on a machine that the paper's model describes."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from hqpipe.errors import UsageError
from hqpipe.identify.free_run import free_run
from hqpipe.identify.paper_model.fit_actuator import fit_actuator
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial
from hqpipe.plant import Plant, PlantConfig
from hqpipe.plant import case_effects as effects
from hqpipe.plant.case_machine import TORQUE_NOISE, interval_velocity, logged
from hqpipe.plant.case_motion import Trot, joint_angles
from hqpipe.plant.cases import EXCLUSIVE, FAINT, JOINTS, KINDS, Case, cases, sound_machine
from hqpipe.plant.excitation import excitation
from hqpipe.plant.hydraulics import move_spool
from hqpipe.plant.parameters import build_schedule, check_stability
from hqpipe.plant.plant import SUBSTEP

MANY = cases(300, 5)
FAINT_ONES = cases(102, 5, ("faint",))


def paths(node: dict, prefix: str = "") -> set[str]:
    return set().union(
        *(
            paths(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}"}
            for key, value in node.items()
        )
    )


def rounded(parameters: dict[str, float | None]) -> dict[str, str | None]:
    return {name: None if value is None else f"{value:.9g}" for name, value in parameters.items()}


def test_same_seed_same_cases_and_another_seed_others():
    assert cases(30, 5) == cases(30, 5)
    assert [case.planted for case in cases(30, 5)] != [case.planted for case in cases(30, 6)]


def test_kinds_come_in_their_shares_and_shuffled():
    assert Counter(case.kind for case in MANY) == {kind: round(300 * share) for kind, share in KINDS.items()}
    assert len(set(case.kind for case in MANY[:20])) > 2


def test_the_usual_mixture_is_drawn_as_ever():
    # Cases are made over days and by several people: the same command must go on giving the same ones, up to the last
    # digits of an exponential, which processors round differently.
    drawn = [
        [(p.effect, p.size, p.joints, p.span, rounded(p.parameters)) for p in case.planted]
        for case in cases(120, 20262)
    ]
    assert hashlib.sha256(json.dumps(drawn).encode()).hexdigest()[:16] == "3877c8f45cc76301"
    assert all(planted.factor is None for case in MANY for planted in case.planted)


def test_a_supply_is_as_large_as_the_pistons_that_it_feeds():
    """Smaller cylinders draw less oil, so that a large pump would hardly sag."""
    seen = Counter()
    for case in cases(300, 5, ("mixture",)):
        planted = {one.effect: one for one in case.planted}
        if "supply_droop" in planted:
            pump = planted["supply_droop"].overrides["supply"]["pump_flow"] / effects.DROOPING_PUMP
            pistons = planted.get("orifice_flow")
            seen[pistons and len(pistons.joints)] += 1
            share = len(pistons.joints) / len(JOINTS) if pistons else 0.0
            small = pistons.overrides["cylinder"]["area_a"] / effects.BASE["cylinder"]["area_a"] if pistons else 1.0
            assert pump == pytest.approx(1.0 - share + share * small)
    assert {None, len(JOINTS)} <= set(seen)


@pytest.mark.parametrize("count", [1, 7, 41])
def test_any_number_of_cases(count):
    found = cases(count, 0)
    assert [case.name for case in found] == [f"case_{i:03d}" for i in range(count)]


def test_every_effect_occurs_alone_in_every_size_and_outside_ones_only_outside():
    single = {(p.effect, p.size) for case in MANY if case.kind == "single" for p in case.planted}
    for recipe in effects.RECIPES.values():
        if not recipe.outside and not recipe.pressures:
            sizes = effects.SIZES if len(recipe.trot) > 1 else (None,)
            assert {(recipe.name, size) for size in sizes} <= single
    assert {p.outside for case in MANY if case.kind == "outside" for p in case.planted} == {True}
    assert {p.outside for case in MANY if case.kind != "outside" for p in case.planted} == {False}


def test_kinds_can_be_asked_for():
    assert {case.kind for case in FAINT_ONES} == {"faint"}
    assert Counter(case.kind for case in cases(40, 1, ("none", "faint"))) == {"none": 8, "faint": 32}
    assert {case.kind for case in cases(20, 1, list(KINDS))} == set(KINDS)
    with pytest.raises(UsageError, match="--kind faintt.* did you mean 'faint'"):
        cases(3, 1, ("faintt",))


def test_faint_cases_take_every_effect_with_a_size_in_turn():
    planted = [case.planted for case in FAINT_ONES]
    assert all(len(effects_) == 1 and effects_[0].joints == JOINTS for effects_ in planted)
    counts = Counter(p.effect for (p,) in planted)
    sized = {r.name for r in effects.RECIPES.values() if not r.outside and len(r.trot) > 1} - {"torque_scale"}
    assert counts == dict.fromkeys(sized, len(FAINT_ONES) // len(sized))
    factors = np.log2([p.factor for (p,) in planted])
    assert factors.min() >= np.log2(FAINT[0]) and factors.max() <= np.log2(FAINT[1])
    assert np.histogram(factors, bins=5, range=(-4.0, 1.0))[0].min() >= 10  # log-uniform: 20 in each on average


@pytest.mark.parametrize("name", [r.name for r in effects.RECIPES.values() if len(r.trot) > 1 and not r.outside])
def test_faint_sizes_lie_between_the_sound_machine_and_twice_the_small_size(name):
    recipe = effects.RECIPES[name]
    for motion in ("trot", "gantry")[: 2 if recipe.gantry else 1]:
        small = (recipe.gantry if motion == "gantry" else recipe.trot)[0]
        drawn = [abs(recipe.draw_faint(f, motion, np.random.default_rng(1))) for f in (1e-9, 0.25, 0.5, 1.0, 2.0)]
        sound = recipe.sound[motion == "gantry"]
        assert drawn[3] == pytest.approx(small)
        assert drawn[0] == pytest.approx(sound, rel=1e-6, abs=1e-6)
        steps = np.diff(1.0 / np.array(drawn) if recipe.inverse else drawn)
        assert steps[1:] == pytest.approx(steps[0] * np.array([1.0, 2.0, 4.0]), rel=1e-6)


def test_a_limit_and_a_torque_limit_are_larger_where_the_effect_is_fainter():
    rng = np.random.default_rng(0)
    for name in ("flow_saturation", "orifice_flow"):
        faint, small = (effects.RECIPES[name].draw_faint(factor, "trot", rng) for factor in (0.1, 1.0))
        assert faint > small


def test_faint_effects_start_from_what_the_sound_machine_has():
    rng, base = np.random.default_rng(0), sound_machine()
    built = {
        name: effects.RECIPES[name].build(effects.RECIPES[name].sound[0], "load_cell", rng)[0]
        for name in ("coulomb_friction", "viscous_friction", "orifice_flow", "valve_lag")
    }
    for name, section, field in (
        ("coulomb_friction", "cylinder", "coulomb_friction"),
        ("viscous_friction", "cylinder", "viscous_friction"),
        ("orifice_flow", "cylinder", "area_a"),
        ("orifice_flow", "valve", "rated_flow"),
        ("valve_lag", "valve", "bandwidth_hz"),
    ):
        assert built[name][section][field] == pytest.approx(base[section][field])


def test_a_faint_slope_keeps_the_light_piston():
    for case in FAINT_ONES:
        (planted,) = case.planted
        if planted.effect == "position_dependent_stiffness":
            assert planted.overrides["cylinder"]["piston_mass"] == sound_machine()["cylinder"]["piston_mass"]


def test_mixtures_are_two_to_four_distinct_effects_that_share_no_field():
    mixtures = [case.planted for case in MANY if case.kind == "mixture"]
    assert {len(planted) for planted in mixtures} == {2, 3, 4}
    for planted in mixtures:
        for one, other in combinations(planted, 2):
            assert one.effect != other.effect
            assert {one.effect, other.effect} not in EXCLUSIVE
            assert not paths(one.overrides) & paths(other.overrides)


def test_places_are_narrow():
    for case in MANY:
        if case.kind == "place":
            (planted,) = case.planted
            assert (len(planted.joints) in (1, 3, 4)) != (planted.span is not None)


def test_friction_is_measured_in_front_of_the_load_cell_and_torque_scale_beside_pressures():
    for case in MANY:
        recipes = [effects.RECIPES[p.effect] for p in case.planted]
        if any(recipe.load_cell for recipe in recipes):
            assert case.effort_source == "load_cell"
        if any(recipe.pressures for recipe in recipes):
            assert case.pressures
    assert {case.effort_source for case in MANY if not case.planted} == {"pressure", "load_cell"}


def test_every_machine_is_one_that_the_plant_accepts(robot):
    for case in (*MANY, *FAINT_ONES):
        for motion in case.trials():
            check_stability(build_schedule(robot, PlantConfig(case.machine(motion.seconds))), robot, SUBSTEP)


def test_leaving_every_effect_out_gives_the_sound_machine():
    for case in MANY[:60]:
        assert case.machine(7.0, [p.effect for p in case.planted]) == sound_machine(case.effort_source)


def test_one_effect_of_a_mixture_can_be_left_out():
    case = next(case for case in MANY if case.kind == "mixture")
    left, *others = case.planted
    assert case.machine(7.0, [left.effect]) == Case(**{**vars(case), "planted": tuple(others)}).machine(7.0)


@pytest.mark.parametrize("name", list(effects.RECIPES))
@pytest.mark.parametrize("motion", ["gantry", "trot", "both"])
def test_sizes_are_drawn_round_their_table(name, motion):
    recipe, rng = effects.RECIPES[name], np.random.default_rng(0)
    table = recipe.gantry if motion == "gantry" else recipe.trot
    for index, middle in enumerate(table or ()):
        drawn = [recipe.draw(effects.SIZES[index], motion, rng) for _ in range(40)]
        assert all(1.0 - recipe.jitter <= abs(value) / middle <= 1.0 + recipe.jitter for value in drawn)
        assert {value < 0.0 for value in drawn} == ({True, False} if recipe.signed else {False})
        assert recipe.jitter == 0.0 or len(set(drawn)) == len(drawn)


def test_what_needs_load_is_refused_on_the_gantry():
    with pytest.raises(UsageError, match="does not show on the gantry"):
        effects.RECIPES["orifice_flow"].draw("small", "gantry", np.random.default_rng(0))


def test_constants_are_those_of_the_robot(robot):
    hydraulics = robot.hydraulics
    assert set(robot.joints) == set(JOINTS)
    assert robot.sprocket_radius == pytest.approx(effects.RADIUS)
    assert hydraulics["firmware"]["position_pid"]["kp"] == effects.KP
    assert hydraulics["cylinder"]["area_a"] == effects.FIRMWARE_AREA
    assert hydraulics["cylinder"]["stroke"] == effects.STROKE
    assert hydraulics["supply"]["return_pressure"] == effects.RETURN_PRESSURE


def test_a_spool_is_ahead_of_its_equation_by_one_substep():
    ratio, hz, rate = 1.5, 200.0, 3.0
    valve = {"hysteresis": 0.0, "opening_limit": 9.0, "bandwidth_hz": hz, "damping_ratio": ratio, "stiction": 0.0}
    p = SimpleNamespace(valve_slew_rate=1e5, **{f"valve_{name}": value for name, value in valve.items()})
    s = SimpleNamespace(play=0.0, spool=0.0, v_spool=0.0)
    for n in range(4000):
        command = rate * n * SUBSTEP
        move_spool.py_func(p, s, command, SUBSTEP)
    assert (command - s.spool) / rate == pytest.approx(ratio / (np.pi * hz) - effects.LEAD, rel=1e-6)


def test_parameters_are_those_of_diagnosis_json():
    rng = np.random.default_rng(0)
    overrides, parameters = effects.valve_deadband(0.004, "pressure", rng)
    assert (overrides["valve"]["overlap"], parameters) == (0.004 * effects.KP, {"half_width": 0.004})
    _, parameters = effects.command_delay(0.005, "pressure", rng)  # the sound spool's 2ζ/ω counts as delay
    assert parameters["delay_s"] == pytest.approx(0.005 + 0.2 / (np.pi * 1000.0) - 5.0e-5)
    overrides, _ = effects.coulomb_friction(12.0, "load_cell", rng)  # two pistons at the sprocket
    assert 2.0 * effects.RADIUS * overrides["cylinder"]["coulomb_friction"] == pytest.approx(12.0)
    overrides, _ = effects.viscous_friction(30.0, "load_cell", rng)
    assert 2.0 * effects.RADIUS**2 * overrides["cylinder"]["viscous_friction"] == pytest.approx(30.0)
    overrides, _ = effects.orifice_flow(2000.0, "pressure", rng)
    force = overrides["cylinder"]["area_a"] * (effects.PRESSURE - effects.RETURN_PRESSURE)
    assert effects.RADIUS * force == pytest.approx(2000.0)
    overrides, _ = effects.valve_lag(0.005, "pressure", rng)
    valve = overrides["valve"]
    assert 2.0 * valve["damping_ratio"] / (2.0 * np.pi * valve["bandwidth_hz"]) == pytest.approx(0.005)


@pytest.mark.parametrize("slope", [0.4, -0.6])
def test_slope_of_the_stiffness_is_that_of_the_chambers(robot, slope):
    overrides, _ = effects.position_dependent_stiffness(slope, "pressure", np.random.default_rng(0))
    joint = build_schedule(robot, PlantConfig(sound_machine()).merged(PlantConfig(overrides)))[0].joint[0]

    def stiffness(q: float) -> float:
        x = 0.5 * joint["cylinder_stroke"] + effects.RADIUS * q
        a = joint["cylinder_dead_volume_a"] + joint["cylinder_area_a"] * x
        b = joint["cylinder_dead_volume_b"] + joint["cylinder_area_b"] * (joint["cylinder_stroke"] - x)
        return joint["fluid_bulk_modulus"] * (1.0 / a + 1.0 / b)

    assert (stiffness(1e-4) - stiffness(-1e-4)) / 2e-4 / stiffness(0.0) == pytest.approx(slope, rel=1e-3)
    sound = build_schedule(robot, PlantConfig(sound_machine()))[0].joint[0]
    volume = sound["cylinder_dead_volume_a"] + 0.5 * sound["cylinder_area_a"] * sound["cylinder_stroke"]
    assert stiffness(0.0) == pytest.approx(2.0 * sound["fluid_bulk_modulus"] / volume)


def test_velocity_is_that_of_the_interval_which_begins():
    assert interval_velocity(np.array([0.0, 0.001, 0.003]), 1000.0) == pytest.approx([1.0, 2.0, 2.0])


def test_log_keeps_nothing_that_gives_an_effect_away():
    columns = {"time": np.arange(3) / 1e3, "supply/pressure": np.zeros(3), "foot/LF/contact": np.zeros(3)}
    for signal in ("position", "velocity", "effort", "position_command", "valve_command", "pressure_a", "pressure_b"):
        columns[f"joint/LFK/{signal}"] = np.arange(3.0)
    kept = logged(columns, ("LFK",), False, 1000.0)
    signals = {"position", "velocity", "effort", "position_command"}
    assert set(kept) == {"time", "foot/LF/contact", *(f"joint/LFK/{signal}" for signal in signals)}
    assert "joint/LFK/pressure_a" in logged(columns, ("LFK",), True, 1000.0)


def test_trot_reaches_its_feet_and_differs_by_seed(robot):
    pitch, knee = joint_angles(0.1, -0.7)
    foot = (-0.45 * np.sin(pitch) - 0.45 * np.sin(pitch + knee), -0.45 * np.cos(pitch) - 0.45 * np.cos(pitch + knee))
    assert foot == pytest.approx((0.1, -0.7))
    assert Trot(robot, 1).gait_hz != Trot(robot, 2).gait_hz


def gap(robot, overrides: dict) -> float:
    """Held-out free-run error of the paper's model on a short gantry trial, N·m."""
    trials = []
    for seed, (seconds, split) in enumerate(((3.0, "fit"), (2.0, "heldout"))):
        plant = Plant(robot, PlantConfig(overrides), seed=seed, base="fixed")
        run = plant.run(excitation(robot, "multisine", seconds, seed), seconds)
        columns = logged(run.columns, robot.joints, False, run.rate_hz)
        signal = [
            np.stack([columns[f"joint/{joint}/{name}"] for joint in robot.joints], axis=1)
            for name in ("position", "velocity", "effort", "position_command")
        ]
        trials.append(Trial(f"{seed}", split, None, Trajectory(run.time, robot.joints, *signal)))
    log_set = LogSet("", "", "", None, None, "position", None, 1000.0, robot.joints, tuple(trials))
    model, heldout = fit_actuator(log_set).model, trials[1].trajectory
    return float(np.sqrt(np.mean((free_run(heldout, model) - heldout.effort) ** 2)))


def test_sound_machine_has_no_gap_and_an_effect_is_one(robot):
    assert gap(robot, sound_machine()) < 1.06 * TORQUE_NOISE
    deadband, _ = effects.valve_deadband(0.0026, "pressure", np.random.default_rng(0))
    with_deadband = PlantConfig(sound_machine()).merged(PlantConfig(deadband)).overrides
    assert gap(robot, with_deadband) > 1.7 * TORQUE_NOISE
