"""Joints in different units: the answer does not depend on the unit that a joint is recorded in."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from layer_cases import layer_found, log_set, made_up, toy
from planted_logs import logs_of, size
from tallies import JOINTS, tally

from hqpipe.gap.answer.gap_entry import gap_entry, undeclared
from hqpipe.gap.answer.schema import read_diagnosis
from hqpipe.gap.diagnosis import diagnose, write_diagnosis
from hqpipe.gap.residuals.joint_scale import MIN_EXCITATION, joint_scale, pooled
from hqpipe.gap.residuals.layer_errors import layer_errors
from hqpipe.gap.residuals.locate import locate, telling
from hqpipe.layers.actuator.record import draws_of
from hqpipe.logs.joint_kinds import PRISMATIC, REVOLUTE
from hqpipe.machine import EFFECTS

KEPT = ("command_delay", "valve_lag", "valve_deadband", "coulomb_friction")
WITHOUT = tuple(name for name in EFFECTS if name not in KEPT)
SLIDES = np.array(
    [1.0, 1e-3, 1e-3]
)  # m per rad of a rack with a radius of 1 mm; the force is then 1000 times the torque
FORCE = 1.0 / SLIDES
SIZES = ("before", "after", "noise_floor", "persistence")


def in_other_units(logs, length=SLIDES, force=FORCE, declared=True):
    """The same machine with lengths of joints times `length` and efforts times `force`, (J,) each."""

    def changed(t):
        scaled = {name: getattr(t, name) * length for name in ("position", "velocity", "position_command")}
        return replace(t, effort=t.effort * force, **scaled)

    kinds = [REVOLUTE if factor == 1.0 else PRISMATIC for factor in length]
    trials = tuple(replace(trial, trajectory=changed(trial.trajectory)) for trial in logs.trials)
    return replace(logs, trials=trials, kinds=dict(zip(logs.joints, kinds, strict=True)) if declared else {})


@pytest.fixture(scope="module")
def logs():
    """A deadband in one joint of three, a delay in another."""
    return logs_of([size("command_delay"), size("valve_deadband"), {}])


@pytest.fixture(scope="module")
def found(logs):
    return diagnose(logs, without=WITHOUT)


def answer_of(content):
    causes = {(c["effect"], tuple(c["joints"])) for c in content["causes"]}
    return content["verdict"], causes, {(p["joint"], p["regime"]) for p in content["where"]}


@pytest.mark.parametrize("declared", [True, False])
def test_a_machine_in_mixed_units_is_answered_as_in_one(logs, found, declared, tmp_path):
    other = diagnose(in_other_units(logs, declared=declared), without=WITHOUT)
    assert answer_of(other.content) == answer_of(found.content)
    assert answer_of(found.content)[1] == {("command_delay", logs.joints[:1]), ("valve_deadband", logs.joints[1:2])}
    one, two = found.content["gap"], other.content["gap"]
    assert two["normalised"] == pytest.approx(one["normalised"], rel=0.01)
    assert two["shrink"] == pytest.approx(one["shrink"], abs=0.01)
    assert two["unit"] is None and [two[name] for name in SIZES] == [None] * 4
    assert one["unit"] == "N·m" and one["before"] > 0.0
    for a, b, force in zip(one["joints"], two["joints"], FORCE, strict=True):
        assert [b[name] for name in SIZES] == pytest.approx([force * a[name] for name in SIZES], rel=0.02)
    units = [entry["unit"] for entry in two["joints"]]
    assert units == (["N·m", "N", "N"] if declared else ["N·m"] * 3)
    assert any("type: prismatic" in text for text in other.content["warnings"]) != declared
    (width,) = [c["parameters"]["half_width"] for c in other.content["causes"] if c["effect"] == "valve_deadband"]
    assert width["unit"] == ("m" if declared else "rad") and width["value"] == pytest.approx(2e-5, rel=0.05)
    write_diagnosis(other, tmp_path)
    assert read_diagnosis(tmp_path / "diagnosis.json")["gap"]["unit"] is None


@pytest.mark.parametrize("seed", range(5))
def test_the_place_does_not_depend_on_units(seed):
    sums = tally(1, ("direction", "extending"), 400.0)
    sums.square[:, 2] *= 3.0
    unit = 10.0 ** np.random.default_rng(seed).uniform(-4, 4, 3)
    other = replace(sums, square=sums.square * unit[:, None] ** 2)
    floor, scale = np.full(3, 4.2), np.array([50.0, 80.0, 20.0])
    a, b = locate(sums, floor, JOINTS, scale), locate(other, floor * unit**2, JOINTS, scale * unit)
    assert [(p.joint, p.regime) for p in telling(a)] == [(p.joint, p.regime) for p in telling(b)]
    assert [p.share for p in telling(a)] == pytest.approx([p.share for p in telling(b)])
    normalised = [{(p.joint, p.family, p.regime): p.normalised for p in places} for places in (a, b)]
    assert normalised[0] == pytest.approx(normalised[1])
    first = b[0]
    assert first.rmse == pytest.approx(a[0].rmse * unit[JOINTS.index(first.joint)])
    plain = locate(other, floor * unit**2, JOINTS, np.ones(3))
    assert [p.share for p in plain if p.family == "all"] != pytest.approx([p.share for p in b if p.family == "all"])


def test_a_scale_is_the_spread_about_the_mean_and_no_less_than_noise_makes():
    wave, noise = np.sin(np.arange(5000) / 80.0), np.random.default_rng(0).normal(size=5000)
    assert joint_scale([3.0 * wave]) == pytest.approx(3.0 / np.sqrt(2.0), rel=0.01)
    assert joint_scale([3.0 * wave + 1e4]) == pytest.approx(joint_scale([3.0 * wave]), rel=1e-6), "a load, or a bias"
    assert joint_scale([wave, wave + 10.0]) > 4.0, "trials apart from each other"
    assert joint_scale([50.0 + 0.1 * noise]) == pytest.approx(MIN_EXCITATION * 0.1, rel=0.05), "it does not move"
    assert joint_scale([np.full(50, 7.0)]) == 7.0 and joint_scale([np.zeros(50)]) == np.inf
    assert pooled(np.array([4.0, 9.0, 5.0]), np.array([2.0, 3.0, np.inf])) == pytest.approx(np.sqrt(2.0 / 3.0))


def test_the_scale_of_a_joint_comes_from_its_fit_trials():
    model = toy("hip", 0, seconds=6.0)
    louder = replace(model.heldout, output=9.0 * model.heldout.output)
    expected = np.std(model.fit.output)
    for heldout in (model.heldout, louder):
        model.heldout = heldout
        errors = layer_errors(layer_found(made_up(model, 1.0, 1.0)), log_set([model]))
        assert errors.scale == pytest.approx([expected])


def entry(kinds, scale, joints=("swing", "boom")):
    log_set = SimpleNamespace(kinds=kinds, joints=joints, control_mode="position")
    squares = {name: np.where(np.isfinite(scale), np.square(scale), 1.0) * 0.01 for name in SIZES}
    return gap_entry(log_set, squares, np.asarray(scale)), undeclared(log_set, np.asarray(scale))


def test_a_size_in_a_unit_needs_a_common_unit():
    mixed, told = entry({"swing": REVOLUTE, "boom": PRISMATIC}, [100.0, 90.0])
    assert mixed["unit"] is None and mixed["before"] is None and not told
    assert mixed["normalised"]["before"] == pytest.approx(0.1)
    both, told = entry({"swing": PRISMATIC, "boom": PRISMATIC}, [1e5, 90.0])
    assert (
        both["unit"] == "N"
        and both["before"] == pytest.approx(0.1 * np.sqrt(np.mean(np.square([1e5, 90.0]))))
        and not told
    )
    alike, told = entry({}, [100.0, 90.0])
    assert alike["unit"] == "N·m" and alike["joints"][0]["type"] is None and not told
    unlike, told = entry({}, [1e5, 90.0])
    assert unlike["unit"] is None and "swing and boom differ 1,111-fold" in told[0]
    still, _ = entry({}, [100.0, np.inf])
    assert still["joints"][1]["scale"] is None and still["joints"][1]["normalised"]["before"] is None


def test_the_flow_of_mixed_joints_counts_them_alike(logs):
    slides = [False, True, True]
    other = [t.trajectory for t in in_other_units(logs).fit]
    one = [t.trajectory for t in logs.fit]
    assert all(np.array_equal(w, np.ones(3)) for w in (draws_of(one, [True] * 3)[0], draws_of(one, [False] * 3)[0]))
    weight, opened = draws_of(other, slides)
    speed = np.sqrt(np.mean(np.concatenate([t.velocity for t in other]) ** 2, axis=0))
    assert weight[0] == 1.0 and weight[1:] * speed[1:] == pytest.approx(np.full(2, speed[0]))
    error = np.sqrt(np.mean(np.concatenate([t.position_command - t.position for t in other]) ** 2, axis=0))
    assert opened * error == pytest.approx(np.full(3, opened[0] * error[0]))
