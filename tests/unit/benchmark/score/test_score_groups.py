"""Families, effects, earlier logs, baselines and utility on made-up diagnoses."""

from __future__ import annotations

import json

import pytest
from blind_cases import ALL, cause, diagnosis, effect, place

from hqpipe.benchmark.score.all_cases import MEASURES, score
from hqpipe.benchmark.score.baselines import DRAWS, null_answers, random_answers
from hqpipe.benchmark.score.case import Judged
from hqpipe.benchmark.score.groups import CHANGE_MEASURES, baselines, effects, families
from hqpipe.benchmark.score.truth import ANSWERS, FORMAT, Answer, read_answers
from hqpipe.benchmark.score.utility import MOST_SETS, OUTSIDE, ambiguity_set, repair_utility, utility
from hqpipe.errors import LogError

JOINTS = ("shoulder", "elbow")
LIBRARY = frozenset({"backlash", "command_delay", "coulomb_friction", "torque_limit", "gain_error"})
CHANGED, UNCHANGED = (text for text, *_ in CHANGE_MEASURES)


def judged(kind: str, planted: list, content: dict | None, machine: str = "servo", **more) -> Judged:
    answer = Answer(
        more.pop("case", "case_000"), kind, tuple(planted), {"all": None}, machine, more.pop("reference", None)
    )
    said = content if content is None else content | {"logs": {"joints": list(JOINTS)}}
    return Judged(answer, said, library=more.pop("library", LIBRARY), **more)


def found(rows: list[dict], measure: str) -> tuple[int, int, int]:
    row = next(row for row in rows if row["measure"] == measure)
    return row["right"], row["strict"]["right"], row["of"]


def test_change_is_exact_and_no_change_is_no_gap():
    friction = [effect("coulomb_friction", ("elbow",))]
    cases = [
        judged("change", friction, diagnosis(cause("coulomb_friction", ("elbow",)))),
        judged("change", friction, diagnosis(cause("backlash", confused_with=["coulomb_friction"]))),
        judged("change", friction, diagnosis(cause("coulomb_friction"), cause("backlash"))),
        judged("change", friction, diagnosis()),
        judged("change", [], diagnosis()),
        judged("change", [], diagnosis(verdict="unknown")),
        judged("change", [], diagnosis(cause("backlash"))),
        judged("change", [], None, error="it broke"),
    ]
    result = score(cases)
    assert found(result["aims"], CHANGED) == (2, 1, 4)
    assert found(result["aims"], UNCHANGED) == (1, 1, 4)
    missed = [UNCHANGED in row["missed"] for row in result["misses"]]
    assert missed.count(True) == 2  # the diagnosis that failed is told as such


def test_without_earlier_logs_there_is_no_aim_for_changes():
    assert [row["measure"] for row in score([judged("none", [], diagnosis())])["aims"]][: len(MEASURES)] == [
        text for text, *_ in MEASURES
    ]
    assert not any("change" in row["measure"] for row in score([judged("none", [], diagnosis())])["aims"])


def test_change_needs_its_earlier_logs(tmp_path):
    entry = {"case": "case_000", "kind": "change", "effects": [], "truth": {"all": None}}
    content = {"format": FORMAT, "machine": "arm", "answers": [entry]}
    (tmp_path / ANSWERS).write_text(json.dumps(content))
    with pytest.raises(LogError, match=r"answers\[0\] is a change without 'reference'"):
        read_answers(tmp_path)
    entry["reference"] = "reference/case_000"
    (tmp_path / ANSWERS).write_text(json.dumps(content))
    (answer,) = read_answers(tmp_path)
    assert (answer.machine, answer.reference) == ("arm", "reference/case_000")


def test_a_case_may_name_another_machine_than_its_folder(tmp_path):
    entry = {"case": "case_000", "kind": "none", "effects": [], "truth": {"all": None}}
    answers = [entry | {"family": "servo"}, entry]
    (tmp_path / ANSWERS).write_text(json.dumps({"format": FORMAT, "machine": "arm", "answers": answers}))
    assert [answer.machine for answer in read_answers(tmp_path)] == ["servo", "arm"]
    (tmp_path / ANSWERS).write_text(json.dumps({"format": FORMAT, "answers": [entry]}))
    assert [answer.machine for answer in read_answers(tmp_path)] == ["quadruped"]


def test_all_joints_are_those_of_the_logs():
    both = judged("single", [effect("backlash", JOINTS)], diagnosis(cause("backlash", JOINTS)))
    assert both.truth_text() == "backlash (typical) in all joints"
    assert both.answer_text() == "explained: backlash 0.95 in all joints"
    one = judged("single", [effect("backlash", ("elbow",))], diagnosis(cause("backlash", ("elbow",))))
    assert one.truth_text().endswith("in elbow") and one.answer_text().endswith("in elbow")
    alone = Judged(one.answer, one.content | {"logs": {"joints": ["elbow"]}})
    assert alone.truth_text().endswith("in elbow") and alone.answer_text().endswith("in elbow")


def test_place_of_an_unknown_effect_in_all_joints_of_the_logs_says_nothing():
    content = diagnosis(verdict="unknown", where=[place("elbow")])
    everywhere = judged("outside", [effect("hysteresis", JOINTS, outside=True)], content)
    somewhere = judged("outside", [effect("hysteresis", ("elbow",), outside=True)], content)
    assert everywhere.place_is_right() is None and somewhere.place_is_right() is True


def test_families_are_scored_apart():
    backlash = [effect("backlash", JOINTS)]
    cases = [
        judged("single", backlash, diagnosis(cause("backlash", JOINTS, probability=0.9))),
        judged("single", backlash, diagnosis(cause("gain_error", JOINTS, confused_with=["backlash"]))),
        judged("single", backlash, diagnosis(), machine="arm"),
        judged("none", [], diagnosis(), machine="arm"),
    ]
    rows = {row["family"]: row for row in families(cases, MEASURES)}
    assert {name: row["cases"] for name, row in rows.items()} == {"servo": 2, "arm": 2}
    assert found(rows["servo"]["measures"], "effects named") == (2, 1, 2)
    assert found(rows["arm"]["measures"], "effects named") == (0, 0, 1)
    assert found(rows["arm"]["measures"], "no false alarm on logs with no effect") == (1, 1, 1)
    assert rows["servo"]["probability"] == pytest.approx(0.45)
    assert rows["arm"]["probability"] == 0.0


def test_effects_are_scored_apart():
    claim = {"delay_s": {"value": 0.0052, "unit": "s", "ci95": [0.0049, 0.0055]}}
    delay = effect("command_delay", JOINTS, parameters={"delay_s": 0.005})
    cases = [
        judged("single", [delay], diagnosis(cause("command_delay", JOINTS, parameters=claim))),
        judged("single", [delay], diagnosis(cause("backlash", JOINTS))),
        judged("outside", [effect("hysteresis", JOINTS, outside=True)], diagnosis(verdict="unknown")),
        judged("outside", [effect("hysteresis", JOINTS, outside=True)], diagnosis()),
    ]
    rows = {row["effect"]: row for row in effects(cases)}
    assert set(rows) == {"command_delay", "backlash", "hysteresis"}
    named = rows["command_delay"]
    assert (named["cases"], named["named"]["right"], named["falsely"]) == (2, 1, 0)
    assert named["parameters"]["median_error"] == pytest.approx(0.04)
    assert (named["parameters"]["close"]["right"], named["parameters"]["covered"]["right"]) == (1, 1)
    assert (rows["backlash"]["cases"], rows["backlash"]["falsely"]) == (0, 1)
    assert rows["hysteresis"]["outside"] and rows["hysteresis"]["named"]["right"] == 1


def test_a_parameter_that_is_zero_has_no_relative_error():
    planted = effect("backlash", JOINTS, parameters={"gap": 0.0})
    claim = {"gap": {"value": 0.1, "unit": "rad", "ci95": [0.0, 0.2]}}
    assert not list(judged("single", [planted], diagnosis(cause("backlash", JOINTS, parameters=claim))).parameters())


def test_utility_of_one_diagnosis():
    assert repair_utility({"a"}, {"a"}, 10) == 1.0
    assert repair_utility(set(), set(), 10) == 1.0
    # one missed among ten: (10 + 1)/2 = 5.5 tests in the mean
    assert repair_utility(set(), {"a"}, 10) == pytest.approx(1.0 - 5.5 / 10)
    # one false name costs one test, the missed one is among nine: 5
    assert repair_utility({"b"}, {"a"}, 10) == pytest.approx(1.0 - (1.0 + 5.0) / 10)
    # everything named: nine false among ten are found after 9·11/10 tests
    assert repair_utility(set("abcdefghij"), {"a"}, 10) == pytest.approx(1.0 - 9.9 / 10)


def test_utility_pays_for_the_size_of_the_ambiguity_set():
    backlash = [effect("backlash", JOINTS)]

    def of(*others: str) -> float:
        return utility(judged("single", backlash, diagnosis(cause("backlash", JOINTS, confused_with=list(others)))))

    assert of() == 1.0
    assert 1.0 > of("gain_error") > of("gain_error", "torque_limit") > 0.0
    components = len(LIBRARY) + 1
    assert of("gain_error") == pytest.approx(0.5 + 0.5 * repair_utility({"x"}, {"y"}, components))


def test_utility_of_what_the_library_does_not_hold_is_admitting_it():
    unknown = [effect("hysteresis", JOINTS, outside=True)]
    assert utility(judged("outside", unknown, diagnosis(verdict="unknown"))) == 1.0
    assert utility(judged("outside", unknown, diagnosis())) < 1.0
    assert utility(judged("none", [], diagnosis(verdict="unknown"))) < 1.0
    assert utility(judged("none", [], None)) == 0.0


def test_utility_of_an_effect_that_makes_no_gap_counts_neither_way():
    same = {"all": 4.0} | dict.fromkeys(JOINTS, 4.0)
    silent, bold = (
        judged("single", [effect("backlash", JOINTS)], content, gaps={"with": same, "all": same})
        for content in (diagnosis(), diagnosis(cause("backlash", JOINTS)))
    )
    assert utility(silent) == utility(bold) == 1.0


def test_ambiguity_set_opens_names_and_sets_of_names():
    causes = cause("backlash", confused_with=[["gain_error", "torque_limit"]]), cause("command_delay")
    sets = ambiguity_set(judged("mixture", [], diagnosis(*causes, verdict="unknown")))
    assert set(sets) == {
        frozenset({"backlash", "command_delay", OUTSIDE}),
        frozenset({"gain_error", "torque_limit", "command_delay", OUTSIDE}),
    }


def test_a_large_ambiguity_set_is_drawn_and_drawn_alike():
    names = [f"effect_{i}" for i in range(9)]
    causes = [cause(f"cause_{i}", confused_with=names) for i in range(6)]
    case = judged("mixture", [effect("cause_0", JOINTS)], diagnosis(*causes))
    assert len(ambiguity_set(case)) == MOST_SETS
    assert utility(case) == utility(case)


def test_null_and_random_know_nothing():
    planted = [effect("backlash", JOINTS)]
    cases = [judged("single", planted, diagnosis(cause("backlash", JOINTS)), case=f"case_{i:03d}") for i in range(20)]
    cases += [judged("none", [], diagnosis()) for _ in range(20)]
    assert all(case.verdict == "no_gap" and not case.causes for case in null_answers(cases))
    drawn = random_answers(cases)
    assert len(drawn) == DRAWS * len(cases)
    rate = 20 / (40 * len(LIBRARY))
    assert sum(len(case.causes) for case in drawn) / (len(drawn) * len(LIBRARY)) == pytest.approx(rate, rel=0.15)
    rows = {row["answers"]: row for row in baselines(cases, MEASURES[:4])}
    assert found(rows["null"]["measures"], "no false alarm on logs with no effect") == (20, 20, 20)
    assert found(rows["null"]["measures"], "single effect, typical size: it is the top cause")[0] == 0
    assert rows["diagnosis"]["utility"] == 1.0 > rows["null"]["utility"]
    assert rows["random"]["utility"] < 1.0
    assert baselines(cases, MEASURES[:4]) == baselines(cases, MEASURES[:4])


def test_random_says_unknown_as_often_as_there_is_something_unknown():
    cases = [judged("outside", [effect("hysteresis", JOINTS, outside=True)], diagnosis()) for _ in range(3)]
    assert {case.verdict for case in random_answers(cases)} == {"unknown"}
    assert {case.verdict for case in random_answers([judged("none", [], diagnosis())])} == {"no_gap"}


def test_effects_that_cannot_be_seen_and_those_that_are_not_asked_for():
    same = {"all": 4.0} | dict.fromkeys(JOINTS, 4.0)
    more = {"all": 8.0} | dict.fromkeys(JOINTS, 8.0)
    hidden = judged("single", [effect("backlash", JOINTS)], diagnosis(), gaps={"with": same, "all": same})
    missing = judged("single", [effect("voltage_sag", JOINTS)], diagnosis(), gaps={"with": more, "all": same})
    result = score([hidden, missing])
    assert found(result["aims"], "single effect, typical size: it is the top cause") == (0, 0, 1)
    assert (result["families"][0]["hidden"], result["families"][0]["not_asked"]) == (1, 1)
    (miss,) = result["misses"]
    assert "voltage_sag is not asked for in these logs" in miss["missed"]
    quadruped = Judged(hidden.answer.__class__("case_000", "single", (effect("backlash"),), {}), diagnosis())
    assert found(score([quadruped])["aims"], "single effect, typical size: it is the top cause") == (0, 0, 1)


def test_what_every_machine_has_may_be_named_and_need_not_be():
    usual = effect("coulomb_friction", JOINTS, ordinary=True)
    backlash = effect("backlash", JOINTS)
    own, friction, false = cause("backlash", JOINTS), cause("coulomb_friction", JOINTS), cause("gain_error", JOINTS)
    said = (diagnosis(own), diagnosis(friction, own), diagnosis(friction), diagnosis(false, friction, own))
    cases = [judged("single", [backlash, usual], content) for content in said]
    assert [case.exact() for case in cases] == [True, True, False, False]
    assert [case.top_is_right() for case in cases] == [True, True, False, False]
    assert [utility(case) for case in cases[:2]] == [1.0, 1.0]
    sound = [judged("none", [usual], content) for content in (diagnosis(), diagnosis(friction), diagnosis(false))]
    assert found(score(sound)["aims"], "no false alarm on logs with no effect") == (2, 2, 3)
    assert not judged("none", [usual], diagnosis(verdict="unknown")).alarms_rightly(strict=True)
    assert [row["effect"] for row in effects(cases)] == ["backlash", "gain_error"]
    changed = judged("change", [usual], diagnosis())
    assert found(score([changed])["aims"], UNCHANGED) == (1, 1, 1)


def test_what_every_machine_has_counts_where_its_own_gap_is_known():
    def gap(size: float) -> dict:
        return {"all": size} | dict.fromkeys(JOINTS, size)

    both = [effect("backlash", JOINTS), effect("coulomb_friction", JOINTS, ordinary=True)]
    gaps = {"with": gap(9.0), "all": gap(4.0), "only_backlash": gap(6.0), "without_backlash": gap(8.0)}
    gaps |= {"only_coulomb_friction": gap(8.0), "without_coulomb_friction": gap(6.0)}
    own, friction = cause("backlash", JOINTS), cause("coulomb_friction", JOINTS)
    half, whole = (judged("single", both, d, gaps=gaps) for d in (diagnosis(own), diagnosis(friction, own)))
    assert (half.exact(), whole.exact()) == (False, True)
    assert half.top_is_right() and whole.top_is_right()
    assert {row["effect"]: row["named"]["right"] for row in effects([half])} == {"backlash": 1, "coulomb_friction": 0}
    assert [row["of"] for row in score([whole])["aims"] if row["measure"].startswith("claimed shrink")] == [1]
    gaps |= {"only_coulomb_friction": gap(4.1)}
    assert judged("single", both, diagnosis(own), gaps=gaps).exact()  # too little to make a gap


def test_of_what_every_joint_has_the_faulty_ones_must_be_named():
    planted = effect("position_bias", JOINTS, faulty=("elbow",))
    said = [cause("position_bias", joints) for joints in (("elbow",), JOINTS, ("shoulder",))]
    cases = [judged("place", [planted], diagnosis(one)) for one in said]
    assert [case.place_is_right() for case in cases] == [True, True, False]
    assert cases[0].truth_text() == "position_bias (typical) in elbow"
    gap = {"all": 4.0, "shoulder": 9.0, "elbow": 2.0}  # the sound joint's motion changed too
    gaps = {"with": gap, "all": gap | {"shoulder": 3.0}}
    assert judged("place", [planted], diagnosis(said[0]), gaps=gaps).place_is_right() is True


def test_parameters_of_joints_that_differ():
    per_joint = {"shoulder": {"gap": 0.02}, "elbow": {"gap": 0.03}}
    planted = effect("backlash", JOINTS, parameters={"gap": 0.025}, per_joint=per_joint)
    claims = [{"gap": {"value": value, "unit": "rad", "ci95": [0.0, 1.0]}} for value in (0.02, 0.03)]
    causes = [cause("backlash", (joint,), parameters=claim) for joint, claim in zip(JOINTS, claims, strict=True)]
    assert [row["error"] for row in judged("single", [planted], diagnosis(*causes)).parameters()] == [0.0, 0.0]
    (row,) = judged("single", [planted], diagnosis(cause("backlash", JOINTS, parameters=claims[0]))).parameters()
    assert row["true"] == pytest.approx(0.025)


def test_parameters_of_a_change_are_what_was_added():
    planted = effect("coulomb_friction", JOINTS, parameters={"friction_nm": 0.5})
    claim = {"value": 1.25, "unit": "N·m", "ci95": [1.0, 1.5], "reference": 0.75}
    content = diagnosis(cause("coulomb_friction", JOINTS, parameters={"friction_nm": claim}))
    (row,) = judged("change", [planted], content).parameters()
    assert (row["value"], row["ci95"], row["error"], row["covered"]) == (0.5, [0.25, 0.75], 0.0, True)
    claim["reference"] = None  # the effect was absent
    assert next(judged("change", [planted], content).parameters())["error"] == pytest.approx(1.5)
    assert next(judged("single", [planted], content).parameters())["value"] == 1.25


def test_numbers_of_joints_and_ordinary_effects_are_read(tmp_path):
    entry = {"effect": "backlash", "layer": "servo", "outside": False, "joints": ["elbow"], "scope": "joint"}
    entry |= {"size": None, "span": None, "parameters": {"gap": 0.02, "other": None}, "ordinary": True}
    entry |= {"per_joint": {"elbow": {"gap": 0.02, "other": None}}, "faulty_joints": ["elbow"]}
    case = {"case": "case_000", "kind": "none", "effects": [entry], "truth": {"all": None}, "family": "servo"}
    (tmp_path / ANSWERS).write_text(json.dumps({"format": FORMAT, "answers": [case]}))
    (answer,) = read_answers(tmp_path)
    assert answer.effects[0].per_joint == {"elbow": {"gap": 0.02}}
    assert answer.effects[0].faulty == ("elbow",)
    assert answer.sought == () and answer.names == {"backlash"}


def test_quadruped_cases_are_a_family_of_their_own():
    case = Judged(Answer("case_000", "single", (effect("backlash"),), {"all": None}), diagnosis(cause("backlash", ALL)))
    result = score([case])
    assert [row["family"] for row in result["families"]] == ["quadruped"]
    assert json.loads(json.dumps(result, allow_nan=False))["effects"][0]["effect"] == "backlash"
