"""The answer of a layer as a whole: content, files, page; from joints whose truth is known."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from layer_cases import cause, held, layer_found, layer_joints, log_set, made_up, number, toy

from hqpipe.gap.answer.diagnosis_files import FILE, TABLE, TRACES, write_diagnosis
from hqpipe.gap.answer.layer_experiment import _BETWEEN, next_experiment
from hqpipe.gap.answer.schema import read_diagnosis
from hqpipe.gap.change.since import EarlierLogs
from hqpipe.gap.layer_diagnosis import Since, familiar_errors, known_then, layer_diagnosis
from hqpipe.identify.identify import identify
from hqpipe.machine import EFFECTS
from hqpipe.report.diagnosis_page import write_page


@pytest.fixture(scope="module")
def machine():
    return [
        toy("hip", 1, coulomb_friction=0.6),
        toy("knee", 2, coulomb_friction=0.61, viscous_friction=0.3),
        toy("foot", 3),
    ]


@pytest.fixture(scope="module")
def found(machine):
    return layer_diagnosis(None, log_set(machine), identify(layer_joints(machine)))


def named(content):
    return {(item["effect"], tuple(item["joints"])) for item in content["causes"]}


def test_planted_friction_is_named_with_its_size(found):
    content = found.content
    assert content["verdict"] == "explained"
    assert named(content) == {("coulomb_friction", ("hip", "knee")), ("viscous_friction", ("knee",))}
    friction = next(item for item in content["causes"] if item["effect"] == "coulomb_friction")["parameters"][
        "friction_nm"
    ]
    assert friction["value"] == pytest.approx(0.6, rel=0.03) and friction["unit"] == "N·m"
    assert friction["joints"]["knee"]["value"] == pytest.approx(0.61, rel=0.05)
    gap = content["gap"]
    assert gap["layer"] == "joint_motion" and gap["unit"] == "N·m" and gap["after"] == pytest.approx(0.1, rel=0.1)
    assert gap["shrink"] == pytest.approx(1.0 - gap["normalised"]["after"] / gap["normalised"]["before"], abs=1e-3)
    assert sum(item["shrink"] for item in content["causes"]) == pytest.approx(gap["shrink"], abs=1e-3)
    assert content["where"][0]["joint"] == "knee" and content["next_experiment"] is None


def test_what_was_tried_has_a_score_and_a_reason(found):
    (spring,) = found.content["effects_considered"]
    assert spring["effect"] == "spring" and spring["reason"] and spring["shrink"] is None and spring["score"] >= 0.0


def test_files_are_read_back_and_drawn(found, tmp_path):
    write_diagnosis(found, tmp_path)
    assert read_diagnosis(tmp_path / FILE)["gap"] == found.content["gap"]
    with (tmp_path / TABLE).open(encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream) if row["trial"] == "all"]
    whole = {row["joint"]: row for row in rows if row["family"] == "all"}
    assert {row["family"] for row in rows} == {"all", "direction", "reversal", "speed", "time_span"}
    for entry in found.content["gap"]["joints"]:
        row = whole[entry["joint"]]
        assert float(row["rmse"]) == pytest.approx(entry["before"], rel=1e-4) and row["unit"] == entry["unit"]
        assert float(row["rmse_persistence"]) == pytest.approx(entry["persistence"], rel=1e-4)
    traces = json.loads((tmp_path / TRACES).read_text(encoding="utf-8"))["joints"]
    assert set(traces) == {"hip", "knee", "foot"} and traces["hip"]["restarts"] == []
    page = write_page(tmp_path).read_text(encoding="utf-8")
    assert "torque that the motion asks for" in page and "Joint by joint" in page


def test_a_position_is_drawn_with_its_command(tmp_path):
    model = toy("hip", 4)
    model.unit = "rad"
    logs = log_set([model])
    trials = [replace(t, trajectory=replace(t.trajectory, position_command=t.trajectory.position)) for t in logs.trials]
    logs = replace(logs, trials=tuple(trials), control_mode="position", effort_source=None)
    made = made_up(model, 1.0, 0.1, causes=[cause("coulomb_friction", number("friction_nm", 0.5, 0.1))])
    found = layer_found(made, layer="servo", metric="free_run_rmse")
    write_diagnosis(layer_diagnosis(None, logs, found), tmp_path)
    traces = json.loads((tmp_path / TRACES).read_text(encoding="utf-8"))["joints"]
    assert len(traces["hip"]["restarts"]) >= 2 and traces["hip"]["command"] == traces["hip"]["position"]
    page = write_page(tmp_path).read_text(encoding="utf-8")
    assert "position error is explained" in page and "position of the model running free" in page
    assert '"yaxis2"' not in page, "position and command share an axis"


def test_masked_samples_break_the_line_and_count_nowhere(machine):
    model = toy("hip", 1, coulomb_friction=0.6)
    keep = (model.heldout.time % 2.0) < 1.0
    arrays = {
        name: getattr(model.heldout, name)[keep] for name in ("trial", "time", "position", "velocity", "output", "held")
    }
    model.heldout, model._heldout = replace(model.heldout, **arrays), model._heldout[:, keep]
    both = [model, machine[2]]
    content = layer_diagnosis(None, log_set([machine[0], machine[2]]), identify(layer_joints(both)))
    rows = {row.before.joint: row.before for row in content.table if (row.trial, row.before.family) == ("all", "all")}
    assert rows["hip"].samples == keep.sum() and rows["foot"].samples == len(keep)
    trace = content.traces["joints"]["hip"]
    assert len(trace["time"]) == len(trace["before"])


def test_without_held_out_trials_the_fit_is_judged_and_that_is_told():
    model = toy("hip", 1, coulomb_friction=0.6)
    empty = {
        name: getattr(model.heldout, name)[:0] for name in ("trial", "time", "position", "velocity", "output", "held")
    }
    model.heldout, model._heldout = replace(model.heldout, files=(), **empty), model._heldout[:, :0]
    content = layer_diagnosis(None, log_set([model], heldout=False), identify(layer_joints([model]))).content
    assert content["verdict"] == "explained" and named(content) == {("coulomb_friction", ("hip",))}
    assert any("no held-out trial" in text for text in content["warnings"])


def test_notes_of_several_joints_are_one_warning_and_left_joints_are_told():
    models = [toy(name, seed, seconds=6.0) for seed, name in enumerate(("hip", "knee"))]
    for model in models:
        model.notes = ("the unit of its torque is unknown",)
    made = layer_found(*(made_up(m, 1.0, 1.0) for m in models), left={"foot": "does not move"}, warnings=("coarse",))
    logs = log_set([*models, toy("foot", 3, seconds=6.0)])
    content = layer_diagnosis(None, logs, made, warnings=["before"]).content
    assert content["warnings"][:4] == [
        "before",
        "coarse",
        "hip, knee: the unit of its torque is unknown",
        "foot left out: does not move",
    ]
    assert content["logs"]["joints"] == ["hip", "knee"]
    assert [(item["joints"], item["kind"]) for item in content["left_out"]] == [(["foot"], "not_judged")]


def test_a_prediction_that_runs_away_is_told():
    model = toy("hip", 0, seconds=6.0)
    made = made_up(model, 1.0, 1.0)
    made.base.heldout[:60] = np.nan
    content = layer_diagnosis(None, log_set([model]), layer_found(made)).content
    assert any("the prediction runs away in 5.0% of the samples" in text for text in content["warnings"])
    assert content["gap"]["before"] > content["gap"]["after"]


def test_a_prediction_on_its_way_to_infinity_counts_as_one_that_is_there():
    model = toy("hip", 0, seconds=6.0)
    made = made_up(model, 1.0, 1.0)
    made.base.heldout[:60] = np.geomspace(1e120, 1e300, 60)
    content = layer_diagnosis(None, log_set([model]), layer_found(made)).content
    assert any("the prediction runs away in 5.0% of the samples" in text for text in content["warnings"])
    assert content["gap"]["before"] < 100.0
    assert not any("inf" in text for text in content["warnings"])


def test_a_lost_sign_is_a_cause_of_its_own():
    model = toy("hip", 0, seconds=6.0)
    model.unsigned = True
    content = layer_diagnosis(None, log_set([model]), layer_found(made_up(model, 0.1, 0.1))).content
    assert named(content) == {("unsigned_sensor", ("hip",))} and content["causes"][0]["layer"] == "sensing"
    assert content["verdict"] == "explained"


def answered(now, found, then):
    """diagnosis.json of what was found to have changed since the joints of `then`."""
    since = Since(EarlierLogs(log_set(then)), familiar_errors(found, layer_joints(then)))
    return layer_diagnosis(None, log_set(now), found, since).content


def test_a_sign_that_was_lost_before_is_no_change():
    then, now = (toy("hip", seed, seconds=6.0) for seed in (11, 1))
    now.unsigned = True
    found = identify(layer_joints([now]), reference=layer_joints([then]))
    for known, causes in (((), {("unsigned_sensor", ("hip",))}), (("hip",), set())):
        since = Since(EarlierLogs(log_set([then])), np.zeros(1), known)
        assert named(layer_diagnosis(None, log_set([now]), found, since).content) == causes


def test_only_what_changed_since_is_a_cause():
    then = [toy("hip", 11, coulomb_friction=0.6), toy("foot", 13)]
    now = [toy("hip", 1, coulomb_friction=0.9), toy("foot", 3, viscous_friction=0.4)]
    past, present = layer_joints(then), layer_joints(now)
    content = answered(now, identify(present, reference=past), then)
    assert named(content) == {("coulomb_friction", ("hip",)), ("viscous_friction", ("foot",))}
    parameters = {item["effect"]: item["parameters"] for item in content["causes"]}
    friction = parameters["coulomb_friction"]["friction_nm"]
    assert friction["value"] == pytest.approx(0.9, rel=0.03) and friction["reference"] == pytest.approx(0.6, rel=0.03)
    assert parameters["viscous_friction"]["nm_s_per_rad"]["reference"] is None
    assert content["reference"]["kind"] == "logs"


def test_a_joint_that_errs_as_it_did_has_not_changed():
    then, now = (toy("hip", seed, coulomb_friction=0.6) for seed in (11, 1))
    past, present = layer_joints([then]), layer_joints([now])
    found = identify(present, reference=past)
    (joint,) = found.found
    claimed = replace(joint, causes=(cause("coulomb_friction", number("friction_nm", 0.61, 0.01, reference=0.6)),))
    content = answered([now], replace(found, found=(claimed,)), [then])
    assert content["verdict"] == "no_gap" and content["causes"] == []
    reasons = {row["effect"]: row["reason"] for row in content["effects_considered"]}
    assert reasons["coulomb_friction"] == "the reference missed its own logs by as much"


def test_nothing_changed_although_the_model_misses_the_machine():
    then, now = ([held(replace_unknown(seed))] for seed in (11, 1))
    past, present = layer_joints(then), layer_joints(now)
    content = answered(now, identify(present, reference=past), then)
    assert content["verdict"] == "no_gap" and content["causes"] == []
    assert content["gap"]["before"] > 2.0 * content["gap"]["noise_floor"]


def replace_unknown(seed):
    from layer_cases import ToyJoint

    made = ToyJoint("hip", {"coulomb_friction": 0.6}, seed=seed, unknown=0.4)
    for name in ("fit", "heldout"):
        setattr(made, name, replace(getattr(made, name), held=getattr(made, name).output.copy()))
    return made


def test_numbers_in_other_units_are_not_compared():
    then, now = toy("hip", 11), toy("hip", 1)
    then.unit = "A"
    past = layer_joints([then])
    joints = known_then(layer_joints([now]), past, EarlierLogs(log_set([then])))
    assert joints.models == () and "N·m here and in A in the reference" in joints.left["hip"]
    then.unit, then.base = now.unit, (replace(now.base[0], unit="s²"), *now.base[1:])
    joints = known_then(layer_joints([now]), past, EarlierLogs(log_set([then])))
    assert "kg·m² here and in s² in the reference" in joints.left["hip"]


@pytest.mark.parametrize(
    ("pair", "words"),
    [
        (("coulomb_friction", "viscous_friction"), "two speeds"),
        (("load_dependent_friction", "coulomb_friction"), "known load"),
        (("command_delay", "channel_skew"), "pushes by hand"),
        (("voltage_sag", "torque_limit"), "two supplies"),
    ],
)
def test_the_next_experiment_tells_what_is_confused(pair, words):
    causes = [{"effect": pair[0], "joints": ["hip"], "confused_with": [pair[1]]}]
    text = next_experiment("servo", causes, False, [], "hip")
    assert words in text and pair[0] in text and pair[1] in text


def test_what_an_effect_shows_as_is_a_kind_with_an_experiment():
    kinds = set().union(*(kinds for kinds, _ in _BETWEEN))
    assert all(kinds >= set(effect.shows_as) for effect in EFFECTS.values())


def test_the_next_experiment_follows_what_is_left():
    assert next_experiment("servo", [], False, [], "hip") is None
    rest = [{"signal": "position", "joints": ["knee"], "share": 0.3}]
    assert "whole range" in next_experiment("joint_motion", [], True, rest, "hip")
    assert "motor current" in next_experiment("servo", [], True, [], "hip")
    rest = [{"signal": "way since the last reversal", "joints": ["knee"], "share": 0.9}]
    text = next_experiment("joint_motion", [], True, rest, "knee")
    assert "amplitudes" in text and "known to the layer joint motion" in text


def test_the_next_experiment_fits_the_kind_of_the_joint():
    def text(*kinds):
        return next_experiment("joint_motion", [], True, [], "boom", kinds=dict(kinds))

    assert "axis" not in text(("boom", "prismatic")) and "a known mass on it" in text(("boom", "prismatic"))
    assert "a known distance from the axis, slowly" in text(("boom", "revolute"))
    assert "of a joint that turns" in text()
    causes = [{"effect": "payload", "joints": ["boom"], "confused_with": ["armature"]}]
    told = next_experiment("joint_motion", causes, False, [], "boom", kinds={"boom": "prismatic"})
    assert "a known mass on it" in told


def test_shares_sum_to_one_in_each_family(found):
    for family in ("direction", "reversal", "speed", "time_span"):
        rows = [r.before.share for r in found.table if (r.trial, r.before.family) == ("all", family)]
        assert np.sum(rows) == pytest.approx(1.0, abs=1e-6)
