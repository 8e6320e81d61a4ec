"""Withheld cases of servos, arms and cylinders: always the same, readable, and with effects that show in the logs."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from hqpipe.benchmark.cases.changes import FRICTION, NOTHING, WARMTH
from hqpipe.benchmark.cases.cylinder import effects as cylinder_effects
from hqpipe.benchmark.cases.cylinder import machine as cylinder
from hqpipe.benchmark.cases.cylinder import record as cylinder_record
from hqpipe.benchmark.cases.cylinder.effects import LOAD, SPOOL
from hqpipe.benchmark.cases.cylinder.hydraulics import opening, run_cylinders, two_sided
from hqpipe.benchmark.cases.electric import effects as electric_effects
from hqpipe.benchmark.cases.electric import machine as electric
from hqpipe.benchmark.cases.electric import record as electric_record
from hqpipe.benchmark.cases.families import FAMILIES, MACHINES
from hqpipe.benchmark.cases.force_cylinder import effects as force_effects
from hqpipe.benchmark.cases.force_cylinder import machine as force_cylinder
from hqpipe.benchmark.cases.force_cylinder import record as force_record
from hqpipe.benchmark.cases.joint_cases import EXCLUSIVE, KINDS, cases, write
from hqpipe.errors import UsageError
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.writer import LogSetWriter
from hqpipe.stages.blind.joints import joint_answer, make_joint_case
from hqpipe.stages.blind.make import make, truth_sets

MODULES = {
    "servo": (electric, electric_effects, electric_record.record),
    "arm": (electric, electric_effects, electric_record.record),
    "cylinder": (cylinder, cylinder_effects, cylinder_record.record),
    "torque_cylinder": (cylinder, force_effects, force_record.record),
}
EFFECTS = [
    (family, key)
    for family, (_, effects, _) in MODULES.items()
    for key, recipe in effects.RECIPES.items()
    if "cylinder" in family or family in recipe.families
]


def short(case, seconds: float = 3.0):
    """The case with two short trials, which are enough to be read."""
    trials = tuple(
        replace(trial, seconds=seconds, split=split)
        for trial, split in zip(case.machine.trials[:2], ("fit", "heldout"), strict=True)
    )
    earlier = tuple(replace(trial, seed=trial.seed + 1) for trial in trials)
    return replace(case, machine=replace(case.machine, trials=trials), earlier=earlier)


def digests(folder: Path) -> dict[str, str]:
    return {p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.rglob("*.*")}


def drawn(family: str, key: str, seed: int = 0):
    """A machine that shows an effect, and the generator to plant it with."""
    effects = FAMILIES[family].effects
    for attempt in range(500):
        rng = np.random.default_rng([seed, attempt])
        machine = FAMILIES[family].draw(rng)
        if key in effects.possible(machine, effects.RECIPES[key].outside) and len(machine.names) < 4:
            return machine, rng
    raise AssertionError(f"no {family} shows {key}")


def test_same_seed_same_answers_and_another_seed_others():
    first, again, other = (json.dumps([joint_answer(c) for c in cases(18, s)]) for s in (5, 5, 6))
    assert first == again != other


@pytest.mark.parametrize("family", MACHINES)
def test_same_seed_same_bytes(tmp_path, family):
    for name in "ab":
        write(short(cases(3, 5, family)[1]), tmp_path / name, LogSetWriter)
    assert digests(tmp_path / "a") == digests(tmp_path / "b")


def test_kinds_and_families_come_in_their_shares():
    many = cases(120, 3)
    assert Counter(case.kind for case in many) == {kind: round(120 * share) for kind, share in KINDS.items()}
    assert Counter(case.family for case in many) == {"servo": 40, "arm": 40, "cylinder": 30, "torque_cylinder": 10}


def test_each_kind_holds_what_its_name_says():
    for case in cases(90, 4):
        about = [one for one in case.planted if not one.ordinary]
        assert len({one.effect for one in case.planted}) == len(case.planted)
        assert len(about) in {"none": (0,), "mixture": (2, 3)}.get(case.kind, (1,))
        assert {one.outside for one in about} <= {case.kind == "outside"}
        slow = about and about[0].effect == SPOOL  # every other spool has its own lag
        assert case.kind != "place" or slow or (about[0].scope == "joint" and len(case.machine.names) > 1)
        assert not any(pair <= {one.effect for one in about} for pair in EXCLUSIVE)
        ordinary = (SPOOL, LOAD) if "cylinder" in case.family else (FRICTION,)
        assert all(one.effect in ordinary and one.scope == "machine" for one in case.planted if one.ordinary)


def test_every_spool_has_a_lag_that_is_named_rightly():
    for case in cases(40, 4, "cylinder"):
        (lag,) = [one for one in case.planted if one.effect == SPOOL]
        assert lag.joints == case.machine.names
        slowest = 0.02 if case.family == "cylinder" else 0.002
        planted = {name for name, fields in lag.settings.items() if fields["lag"] > slowest}
        assert lag.ordinary == (not planted)


def test_what_shows_under_load_alone_is_planted_beside_a_load():
    loaded = [
        case
        for case in cases(120, 8, "cylinder", ("single", "mixture"))
        if {one.effect for one in case.planted} & {"leakage", "counterbalance"}
    ]
    assert len(loaded) > 5
    for case in loaded:
        assert case.machine.logger.pressures and LOAD in {one.effect for one in case.planted}


def test_a_dead_time_differs_by_direction():
    """A step of the command into each direction is answered later by what the truth says."""
    machine, rng = drawn("cylinder", "dead_time_asymmetry")
    planted = cylinder_effects.plant(machine, "dead_time_asymmetry", "large", machine.names, rng)
    faulty = cylinder.with_settings(machine, planted.settings)
    late = cylinder_record.dead_times(faulty) * cylinder.STEP
    for j, name in enumerate(machine.names):
        assert late.min() >= 0.0
        assert late[j, 0] - late[j, 1] == pytest.approx(planted.parameters[name]["difference_s"])
    sent = np.r_[np.zeros(100), np.ones(100), -np.ones(100)]
    reached = np.array([two_sided(sent, i, np.array([30, 10]), 0.0) for i in range(300)])
    assert np.flatnonzero(reached > 0.0)[0] == 130
    assert np.flatnonzero(reached < 0.0)[0] == 230  # until then the late side still holds against the early one


def test_a_deadband_with_a_jump_opens_by_the_jump():
    axis = cylinder.draw_cylinder(np.random.default_rng(1)).axes[:1].copy()
    axis["neutral"], axis["overlap"], axis["edge_jump"] = 0.0, 0.05, 0.03
    assert opening(axis[0], 0.0499, 0.0) == 0.0 == opening(axis[0], -0.0499, 0.0)
    assert opening(axis[0], 0.0501, 0.0) == pytest.approx(0.0301)
    assert opening(axis[0], -0.0501, 0.0) == pytest.approx(-0.0301)


def test_a_worn_piston_lets_the_load_down():
    """Commands at the neutral point: the load sinks as fast as the oil leaks past the piston."""
    machine, rng = drawn("cylinder", "leakage")
    planted = cylinder_effects.plant(machine, "leakage", "large", machine.names, rng)
    (_, load) = cylinder_effects.with_load(machine, (planted,), rng)
    sound = cylinder.with_settings(machine, load.settings)
    sunk = {}
    for which in (sound, cylinder.with_settings(sound, planted.settings)):
        place = np.full((20000, len(machine.names)), 0.5 * machine.axes["stroke"])
        axes = which.axes.copy()
        axes["neutral"] = axes["loop_gain"] = axes["feedforward"] = 0.0
        kept = np.empty((2000, len(machine.names), 6))
        late, lost = np.zeros((len(axes), 2), dtype=np.int64), np.zeros(place.shape, dtype=np.bool_)
        resolution, supply = np.full(len(axes), 1e-6), np.array(which.supply)
        run_cylinders(axes, supply, place, 0 * place, lost, late, resolution, 1e-4, 100, 10, place[0], kept)
        sunk[which is sound] = kept[0, :, 0] - kept[-1, :, 0]
    assert (sunk[False] > 3.0 * np.abs(sunk[True])).all()


def test_a_load_holding_valve_makes_the_lowering_independent_of_the_load():
    machine, rng = drawn("cylinder", "counterbalance", 2)
    planted = cylinder_effects.plant(machine, "counterbalance", "large", machine.names, rng)
    spreads = []
    for fields in ({}, planted.settings):
        speeds = []
        for share in (0.1, 0.35):
            load = {name: {"load_share": share, "load_angle": 1.2} for name in machine.names}
            axes = cylinder.with_settings(cylinder.with_settings(machine, load), fields).axes.copy()
            axes["neutral"] = axes["loop_gain"] = 0.0
            axes["feedforward"] = 1.0
            start = 0.7 * axes["stroke"]
            speed = np.full((6000, len(axes)), -0.3)
            kept = np.empty((600, len(axes), 6))
            late, lost = np.zeros((len(axes), 2), dtype=np.int64), np.zeros(speed.shape, dtype=np.bool_)
            resolution, supply = np.full(len(axes), 1e-6), np.array(machine.supply)
            run_cylinders(axes, supply, speed, speed, lost, late, resolution, 1e-4, 100, 10, start, kept)
            speeds.append(kept[300:, :, 1].mean(axis=0))
        spreads.append(np.abs(speeds[1] / speeds[0] - 1.0))
    assert (spreads[1] < 0.5 * spreads[0]).all()


def test_half_of_the_electric_cases_have_ordinary_friction():
    others = [
        case
        for case in cases(300, 2)
        if case.family in ("servo", "arm")
        and case.kind in ("single", "place", "outside")
        and FRICTION not in {one.effect for one in case.planted if not one.ordinary}
    ]
    share = np.mean([any(one.ordinary for one in case.planted) for case in others])
    assert 0.4 < share < 0.6


def test_numbers_scatter_between_joints():
    spreads = []
    for case in cases(60, 7, "arm", ("single",)):
        for one in case.planted:
            values = [numbers["coefficient"] for numbers in one.parameters.values() if "coefficient" in numbers]
            if len(values) > 2:
                spreads.append((max(values) - min(values)) / np.mean(values))
    assert spreads and max(spreads) < 0.32 and np.mean(spreads) > 0.05


@pytest.mark.parametrize("kind", ["none", "single", "mixture", "place", "outside", "change"])
@pytest.mark.parametrize("family", MACHINES)
def test_log_sets_are_read_and_say_nothing_of_the_effect(tmp_path, family, kind):
    case = short(cases(2, 11, family, (kind,))[0])
    make_joint_case(case, tmp_path)
    log_set = read_log_set(tmp_path / case.name)
    assert log_set.joints == case.machine.names
    assert {trial.split for trial in log_set.trials} == {"fit", "heldout"}
    text = (tmp_path / case.name / "logset.yaml").read_text(encoding="utf-8")
    assert not any(one.effect in text for one in case.planted)
    truth = joint_answer(case)["truth"]
    for path in [truth["all"], *truth["without"].values(), *truth["only"].values()]:
        assert path is None or read_log_set(tmp_path / path).joints == case.machine.names
    if kind == "change":
        assert read_log_set(tmp_path / f"{case.name}_reference").joints == case.machine.names


@pytest.mark.parametrize("family", MACHINES)
def test_the_truth_without_effects_is_the_sound_machine(tmp_path, family):
    case = short(cases(4, 9, family, ("mixture",))[0])
    make_joint_case(case, tmp_path)
    write(replace(case, planted=()), tmp_path / "sound", LogSetWriter)
    assert digests(tmp_path / "truth" / case.name / "all") == digests(tmp_path / "sound")
    assert set(truth_sets(case)) == {path.name for path in (tmp_path / "truth" / case.name).iterdir()}


@pytest.mark.parametrize(("family", "key"), EFFECTS)
def test_an_effect_of_typical_size_changes_the_log_by_more_than_the_sensor_noise(family, key):
    model, effects, record = MODULES[family]
    machine, rng = drawn(family, key)
    planted = effects.plant(machine, key, "typical", machine.names, rng)
    faulty, largest = model.with_settings(machine, planted.settings), 0.0
    for trial in machine.trials:
        sound, other = record(machine, trial), record(faulty, trial)
        for j, name in enumerate(machine.names):
            assert all(np.isfinite(column).all() for column in other.values())
            if family == "torque_cylinder":
                noise, channel = 2.0**0.5 * machine.effort_noise[j] * machine.radius_of(j), "effort"
            elif family == "cylinder":
                noise = 2.0**0.5 * (machine.logger.noise + machine.logger.resolution) / machine.radius_of(j)
                channel = "position"
            elif family == "servo":
                noise, channel = machine.logger.resolution[j], "position"
            else:
                noise, channel = 2.0**0.5 * machine.logger.effort_noise[j] * machine.logger.effort_scale[j], "effort"
            change = other[f"joint/{name}/{channel}"] - sound[f"joint/{name}/{channel}"]
            largest = max(largest, float(np.sqrt(np.mean(change**2))) / noise)
    assert largest > (1.2 if family == "arm" else 2.0)  # in the fault's own trials the noise is drawn alike


@pytest.mark.parametrize("seed", range(6))
def test_a_servo_follows_its_command(seed):
    machine = electric.draw_servo(np.random.default_rng([seed, 40]))
    for trial in machine.trials:
        columns = electric_record.record(replace(machine, logger=replace(machine.logger, jitter=0.0)), trial)
        for name, room in zip(machine.names, machine.rooms, strict=True):
            error = columns[f"joint/{name}/position"] - columns[f"joint/{name}/position_command"]
            assert np.sqrt(np.mean(error**2)) < 0.5 * room.swing


@pytest.mark.parametrize("seed", range(4))
def test_a_sound_cylinder_moves_in_proportion_to_its_command(seed):
    machine = cylinder.draw_cylinder(np.random.default_rng([seed, 41]))
    while machine.stops:
        seed += 100
        machine = cylinder.draw_cylinder(np.random.default_rng([seed, 41]))
    columns = cylinder_record.record(machine, machine.trials[0])
    lag = np.median(np.diff(columns["time"]))
    for name in machine.names:
        travel = columns[f"joint/{name}/position"]
        command = columns[f"joint/{name}/valve_command"]
        # integral of the command, which needs no differentiation of the position
        rows = np.column_stack([np.cumsum(command) * lag, columns["time"], np.ones_like(command), command])
        left = travel - rows @ np.linalg.lstsq(rows, travel, rcond=None)[0]
        assert np.sqrt(np.mean(left**2)) < 0.05 * np.ptp(travel)


def test_a_sound_cylinder_commanded_in_force_is_a_force_loop_of_first_order():
    """With the speed as a second input, as the loop lacks a little of what the moving piston needs."""
    left = []
    for seed in range(6):
        machine = force_cylinder.draw_force_cylinder(np.random.default_rng([seed, 42]))
        rows = force_record.run(machine, machine.trials[0])
        for j, stroke in enumerate(machine.axes["stroke"]):
            free = (rows[:, j, 0] > 1e-6) & (rows[:, j, 0] < stroke - 1e-6)
            free = np.convolve(free, np.ones(300) / 300.0, "same") > 0.999
            force, errors = rows[free, j, 6], []
            for rate in np.geomspace(40.0, 400.0, 20):
                asked, speed = (lagged(rows[:, j, column], rate)[free] for column in (4, 1))
                terms = np.column_stack([speed, np.ones_like(speed)])
                coefficients = np.linalg.lstsq(terms, force - asked, rcond=None)[0]
                errors.append(np.std(force - asked - terms @ coefficients) / np.std(force))
            left.append(min(errors))
    assert np.median(left) < 0.12


def lagged(signal, rate):
    share = 1.0 - np.exp(-rate * 1e-3)
    return lfilter([share], [1.0, share - 1.0], signal, zi=[(1.0 - share) * signal[0]])[0]


def test_pistons_rest_on_their_ends_between_strokes():
    resting = []
    for seed in range(12):
        machine = force_cylinder.draw_force_cylinder(np.random.default_rng([seed, 43]))
        if machine.stops:
            place = np.concatenate([force_record.run(machine, trial)[:, 0, 0] for trial in machine.trials])
            resting.append(np.mean((place <= 0.0) | (place >= machine.axes["stroke"][0])))
    assert resting and max(resting) > 0.03


def test_recordings_of_one_machine_differ_by_what_has_changed_and_by_the_ordinary():
    many = cases(48, 6, "joints", ("change",))
    assert np.mean([case.change == NOTHING for case in many]) >= 0.25
    for case in many:
        assert bool(case.planted) == (case.change != NOTHING)
        assert 0.0 < abs(case.viscosity - 1.0) <= WARMTH
        assert {trial.seed for trial in case.earlier}.isdisjoint(trial.seed for trial in case.machine.trials)
        assert [(t.names, t.seconds) for t in case.earlier] != [(t.names, t.seconds) for t in case.machine.trials]
        before, later = case.faulty(before=True), case.faulty()
        assert before.names == later.names
        for one in case.planted:
            for name, fields in one.settings.items():
                rows = "axes" if case.family == "cylinder" else "joints"
                j, grown = later.names.index(name), [f for f in fields if f in getattr(later, rows).dtype.names]
                assert all(getattr(later, rows)[f][j] == fields[f] for f in grown)


def test_what_was_there_before_stays_where_the_change_is_left_out():
    case = next(c for c in cases(20, 6, "servo", ("change",)) if c.change == FRICTION)
    (before,) = case.reference
    left = case.faulty(leave_out=(FRICTION,))
    assert left.joints["coulomb"].tolist() == [before.settings[name]["coulomb"] for name in left.names]
    added = case.planted[0].mean()["friction_nm"]
    scale = float(left.logger.effort_scale[0])
    grown = np.mean(case.faulty().joints["coulomb"] - left.joints["coulomb"])
    assert scale == 1.0 and added == pytest.approx(grown)


def test_friction_really_sticks():
    machine, _ = drawn("servo", "coulomb_friction", 3)
    strong = {name: {"coulomb": 50.0 * machine.torque[j]} for j, name in enumerate(machine.names)}
    columns = electric_record.record(electric.with_settings(machine, strong), machine.trials[0])
    for name in machine.names:
        assert np.ptp(columns[f"joint/{name}/position"]) <= 2.0 * machine.logger.resolution.max()


def test_made_cases_are_kept_and_other_machines_are_refused(tmp_path, monkeypatch):
    from hqpipe.benchmark.cases import joint_cases as module

    small = [short(case, 2.0) for case in cases(3, 5, "joints", ("none",))]
    monkeypatch.setattr(module, "cases", lambda *_: small)
    monkeypatch.setattr(
        "hqpipe.stages.blind.make.in_processes", lambda task, calls, *_: [task(*c) for c in calls.values()]
    )
    assert make(3, 5, tmp_path, 1, lambda *_: None, ("none",), "joints") == 3
    assert make(3, 5, tmp_path, 1, lambda *_: None, ("none",), "joints") == 0
    with pytest.raises(UsageError, match="belongs to other cases"):
        make(3, 5, tmp_path, 1, lambda *_: None, ("none",), "arm")


def test_unknown_kinds_are_refused():
    with pytest.raises(UsageError, match="--kind singel.* did you mean 'single'"):
        cases(3, 1, "joints", ("singel",))


def test_nothing_that_is_judged_is_imported():
    code = "import sys, hqpipe.benchmark.cases.joint_cases, hqpipe.benchmark.cases.electric.record; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    judged = ("benchmark.score", "gap", "identify", "layers", "effects", "kernels", "actuators")
    assert not [name for name in loaded if name.startswith(tuple(f"hqpipe.{room}" for room in judged))]
