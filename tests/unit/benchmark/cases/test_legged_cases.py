"""Withheld cases of legged machines: always the same, readable, and wrong in what they say."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from hqpipe.benchmark.cases.legged.draw import draw_machine, with_settings
from hqpipe.benchmark.cases.legged.effects import RECIPES
from hqpipe.benchmark.cases.legged.outside import OUTSIDE, ordinary
from hqpipe.benchmark.cases.legged.record import record, simulate
from hqpipe.benchmark.cases.legged.robots import ROBOTS, biped
from hqpipe.benchmark.cases.legged_cases import EXCLUSIVE, KINDS, cases, plant, write
from hqpipe.benchmark.score.truth import read_answers
from hqpipe.errors import UsageError
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.writer import LogSetWriter
from hqpipe.stages.blind import make as blind_make
from hqpipe.stages.blind.legged import legged_answer, make_legged_case

ALL = {**RECIPES, **OUTSIDE}


def short(machine, seconds: float = 2.0):
    """The machine with one trial of hanging and one of standing legs."""
    free = next(trial for trial in machine.trials if trial.motion == "multisine")
    stand = next(trial for trial in machine.trials if trial.motion == "tread")
    chosen = zip((free, stand), ("fit", "heldout"), strict=True)
    return replace(machine, trials=tuple(replace(trial, seconds=seconds, split=split) for trial, split in chosen))


def drawn(source: str = "load_cell", seed: int = 0):
    """A short biped stand without noise whose torque comes from this sensor."""
    machine = short(draw_machine(biped(), np.random.default_rng(seed)))
    logger = replace(
        machine.logger, every=1, effort_source=source, torque_noise=0.0, pressure_noise=0.0, policy_ticks=1
    )
    return replace(machine, logger=logger)


def effort(machine, j: int = 1, trial: int = 0) -> np.ndarray:
    return record(machine, machine.trials[trial])[f"joint/{machine.names[j]}/effort"]


@cache
def sound_effort() -> np.ndarray:
    return effort(drawn())


def digests(folder: Path) -> dict[str, str]:
    return {p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.rglob("*.*")}


def test_same_seed_same_answers_and_another_seed_others():
    first, again, other = (json.dumps([legged_answer(case) for case in cases(24, seed)]) for seed in (5, 5, 6))
    assert first == again != other


def test_same_seed_same_bytes(tmp_path):
    for name in "ab":
        case = cases(9, 4)[2]
        write(replace(case, machine=short(case.machine)), tmp_path / name, LogSetWriter)
    assert digests(tmp_path / "a") == digests(tmp_path / "b")


def test_kinds_come_in_their_shares_and_robots_in_turn():
    many = cases(120, 3)
    assert Counter(case.kind for case in many) == {kind: round(120 * share) for kind, share in KINDS.items()}
    assert set(Counter(case.machine.robot.name for case in many).values()) == {40}


def test_each_kind_holds_what_its_name_says():
    for case in cases(90, 4):
        names = {one.effect for one in case.planted}
        assert len(names) == len(case.planted)
        assert len(names) in {"none": (0,), "mixture": (2, 3, 4)}.get(case.kind, (1,))
        assert {one.outside for one in case.planted} <= {case.kind == "outside"}
        assert not any(pair <= names for pair in EXCLUSIVE)
        assert not names & {one.effect for one in case.also}
        assert all(one.span is None or case.kind == "place" for one in case.planted)
        assert all(RECIPES[name].source in (None, case.machine.logger.effort_source) for name in names & set(RECIPES))


def test_places_are_legs_kinds_single_joints_groups_and_spans():
    many = cases(80, 7, ("place",))
    spans = [one.span for case in many for one in case.planted if one.span]
    assert any(start == 0.0 for start, _ in spans) and any(stop == 1.0 for _, stop in spans)
    assert all(0.0 <= start < stop <= 1.0 for start, stop in spans)
    assert {one.scope for case in many for one in case.planted} == {"machine", "group", "joint"}


def test_an_unknown_kind_is_refused():
    with pytest.raises(UsageError, match="no such kind"):
        cases(3, 1, ("singel",))


def test_answers_state_numbers_of_every_joint():
    for case in cases(60, 8):
        for effect in legged_answer(case)["effects"]:
            assert set(effect["per_joint"]) == set(effect["joints"]) <= set(case.machine.names)
            assert effect["ordinary"] == (effect["effect"] not in {one.effect for one in case.planted})
            assert all(value is None or np.isfinite(value) for value in effect["parameters"].values())


def test_an_effect_that_sound_joints_share_is_listed_once_for_all_of_them():
    case = next(c for c in cases(120, 2) if any(one.effect == "valve_lag" for one in c.planted))
    (lag,) = [one for one in (*case.planted, *case.also) if one.effect == "valve_lag"]
    assert lag.joints == case.machine.names
    slow = [lag.parameters[name]["time_constant_s"] for name in lag.settings]
    others = [lag.parameters[name]["time_constant_s"] for name in lag.joints if name not in lag.settings]
    assert not others or min(slow) > max(others)
    stated = {effect["effect"]: effect["faulty_joints"] for effect in legged_answer(case)["effects"]}
    assert set(stated["valve_lag"]) == set(lag.settings)
    assert stated["orifice_flow"] == list(case.machine.names)


def test_folder_is_read_by_the_score(tmp_path, monkeypatch):
    """Logs, truth sets and answers of a mixture; the machine without effects keeps its own gaps."""
    (case,) = cases(1, 11, ("mixture",))
    case = replace(case, machine=short(case.machine, 1.0))
    make_legged_case(case, tmp_path)
    blind_make._write_answers(tmp_path, 1, 11, ("mixture",), [case], blind_make.LEGGED)
    (answer,) = read_answers(tmp_path)
    assert {one.effect for one in answer.sought} == {one.effect for one in case.planted}
    found = read_log_set(tmp_path / case.name)
    assert found.joints == case.machine.names and len(found.fit) == len(found.heldout) == 1
    assert (tmp_path / answer.truth["all"]).is_dir()
    assert all((tmp_path / place).is_dir() for place in answer.truth["without"].values())


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_sound_machine_follows_and_holds(robot):
    machine = short(draw_machine(robot(), np.random.default_rng(1)))
    for trial in machine.trials:
        wanted, kept, feet = simulate(machine, trial)
        assert np.isfinite(kept).all()
        assert np.abs(wanted - kept[:, :, 0]).max() < 0.4
        assert np.abs(kept[:, :, 2]).max() < 1.1 * machine.top_torque.max()
        assert (feet[:, :, 2].max() > 100.0) == (trial.plate > 0.0)
        assert kept[:, :, 6].min() > 0.9 * float(machine.supplies[0]["pressure"])


def test_same_trial_without_effects_is_the_sound_one():
    machine = drawn()
    planted = plant(machine, RECIPES["valve_deadband"], "large", machine.names[:1], np.random.default_rng(0))
    case = replace(cases(1, 1, ("none",))[0], machine=machine, planted=(planted,))
    assert np.array_equal(effort(case.faulty(("valve_deadband",))), effort(machine))
    assert not np.array_equal(effort(case.faulty(), 0), effort(machine, 0))


@pytest.mark.parametrize("name", [name for name in ALL if name != "position_dependent_stiffness"])
def test_every_effect_shows_in_torque(name):
    """A typical one moves the torque of its joint by more than 1 % of what the torque varies by."""
    recipe, machine = ALL[name], drawn()
    planted = plant(machine, recipe, "typical", machine.names, np.random.default_rng(2))
    changed, sound = effort(with_settings(machine, planted.settings)), sound_effort()
    assert np.sqrt(np.mean((changed - sound) ** 2)) > 0.01 * np.std(sound)


def test_an_effect_acts_in_its_span_alone():
    machine = drawn("pressure")
    planted = plant(machine, RECIPES["torque_bias"], "large", machine.names, np.random.default_rng(2), span=(0.25, 0.5))
    case = replace(cases(1, 1, ("none",))[0], machine=machine, planted=(planted,))
    change = effort(case.faulty()) - effort(machine)
    size = abs(planted.parameters[machine.names[1]]["nm"])
    assert np.allclose(np.abs(change[500:1000]), size) and not change[:500].any() and not change[1000:].any()


def test_friction_shows_in_the_load_cell_and_is_ordinary_there():
    assert "coulomb_friction" in ordinary(drawn("load_cell"))
    assert "coulomb_friction" not in ordinary(drawn("pressure"))


def test_an_open_centre_is_ordinary_unless_the_lands_were_made_to_overlap():
    seen = {True: 0, False: 0}
    for case in cases(60, 3, ("single", "mixture")):
        lapped = {joint for one in case.planted if one.effect == "valve_deadband" for joint in one.joints}
        open_ones = [one for one in case.also if one.effect == "valve_underlap"]
        expected = [name for name in case.machine.names if name not in lapped]
        assert [list(one.joints) for one in open_ones] == ([expected] if expected else [])
        seen[bool(lapped)] += 1
    assert all(seen.values())
