"""The blind score on made-up diagnoses: what counts as right, and what does not."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import permutations

import pytest
from blind_cases import ALL, LEG, cause, diagnosis, effect, judged, place

from hqpipe.benchmark.score.all_cases import MEASURES, calibration, confusion, detection, score
from hqpipe.benchmark.score.share import tally
from hqpipe.benchmark.score.truth import ANSWERS, FORMAT, extra_error, read_answers, shown, true_shares, true_shrink
from hqpipe.errors import LogError

TOP, EXACT, QUIET, UNKNOWN, PLACE, SHRINK = (text for text, *_ in MEASURES)


def aim(cases: list, measure: str) -> dict:
    return next(row for row in score(cases)["aims"] if row["measure"] == measure)


def share(cases: list, measure: str) -> tuple[int, int, int]:
    """Right, strictly right, of."""
    row = aim(cases, measure)
    return row["right"], row["strict"]["right"], row["of"]


def test_top_cause_of_a_typical_single():
    backlash = [effect("backlash")]
    right = judged("single", backlash, diagnosis(cause("backlash"), cause("valve_lag")))
    second = judged("single", backlash, diagnosis(cause("valve_lag"), cause("backlash")))
    confused = judged("single", backlash, diagnosis(cause("valve_lag", confused_with=["backlash"])))
    silent = judged("single", backlash, diagnosis())
    assert share([right, second, confused, silent], TOP) == (2, 1, 4)


def test_small_and_large_singles_do_not_count_for_the_top_cause():
    small = judged("single", [effect("backlash", size="small")], diagnosis())
    assert share([small], TOP) == (0, 0, 0)
    assert aim([small], TOP)["met"] is None


def test_a_set_that_the_logs_cannot_tell_from_the_cause_is_opened():
    case = judged(
        "single", [effect("backlash")], diagnosis(cause("valve_lag", confused_with=[["backlash", "channel_skew"]]))
    )
    assert case.exact() and not case.exact(strict=True)


def test_exact_set_of_a_mixture():
    pair = [effect("backlash"), effect("torque_bias", LEG)]
    both = cause("backlash"), cause("torque_bias", LEG)
    split = cause("backlash", ALL[:6]), cause("backlash", ALL[6:]), cause("torque_bias", LEG)
    cases = [
        judged("mixture", pair, diagnosis(*both)),
        judged("mixture", pair, diagnosis(*split)),
        judged("mixture", pair, diagnosis(both[0])),
        judged("mixture", pair, diagnosis(*both, cause("valve_lag"))),
        judged("mixture", pair, None, error="it broke"),
    ]
    assert [case.exact() for case in cases] == [True, True, False, False, False]
    assert share(cases, EXACT) == (2, 2, 5)


def test_one_name_does_not_stand_for_two_effects():
    pair = [effect("backlash"), effect("torque_bias")]
    case = judged("mixture", pair, diagnosis(cause("backlash", confused_with=["torque_bias"])))
    assert not case.exact()


def test_false_alarm_is_a_name_and_strictly_any_other_verdict():
    cases = [
        judged("none", [], diagnosis()),
        judged("none", [], diagnosis(verdict="unknown")),
        judged("none", [], diagnosis(cause("backlash"))),
    ]
    assert share(cases, QUIET) == (2, 1, 3)


def test_effect_outside_the_library_must_be_unknown_without_a_name():
    ripple = [effect("supply_ripple", outside=True)]
    cases = [
        judged("outside", ripple, diagnosis(verdict="unknown")),
        judged("outside", ripple, diagnosis(verdict="no_gap")),
        judged("outside", ripple, diagnosis(cause("backlash"), verdict="unknown")),
        judged("outside", ripple, diagnosis(cause("backlash"))),
    ]
    assert share(cases, UNKNOWN) == (1, 1, 4)


def test_effect_left_out_of_the_library_must_be_unknown_too():
    left_out = {"without": ("backlash",)}
    unknown = judged("single", [effect("backlash")], diagnosis(verdict="unknown"), **left_out)
    named = judged("single", [effect("backlash")], diagnosis(cause("valve_lag")), **left_out)
    assert share([unknown, named], UNKNOWN) == (1, 1, 2)
    assert share([unknown, named], TOP)[2] == 0


def test_beside_known_effects_a_remainder_must_be_admitted():
    pair = [effect("backlash"), effect("torque_bias")]
    known = cause("torque_bias")
    remainder = {"above_noise": True, "where": []}
    admitted = judged("mixture", pair, diagnosis(known, unexplained=remainder), without=("backlash",))
    denied = judged("mixture", pair, diagnosis(known), without=("backlash",))
    assert share([admitted, denied], UNKNOWN) == (1, 1, 2)


@pytest.mark.parametrize(
    ("true", "said", "right", "strictly"),
    [
        (("LFK",), ("LFK",), True, True),
        (("LFK",), ("RFK",), False, False),
        (LEG, LEG[:2], False, False),
        (LEG, ALL, False, False),
        (ALL, ALL[:10], True, False),
        (ALL, ALL[:9], False, False),
    ],
)
def test_place_is_the_joints_of_the_cause(true, said, right, strictly):
    case = judged("place", [effect("backlash", true)], diagnosis(cause("backlash", said)))
    assert (case.place_is_right(), case.place_is_right(strict=True)) == (right, strictly)


def test_joints_of_the_confused_name_belong_to_the_effect():
    causes = cause("torque_bias", ALL[:6]), cause("position_bias", ALL[6:], confused_with=["torque_bias"])
    case = judged("single", [effect("torque_bias")], diagnosis(*causes))
    assert case.place_is_right() and case.place_is_right(strict=True) is False


def test_joints_without_a_gap_need_not_be_named():
    with_effect = {"all": 10.0} | {joint: 12.0 if joint.endswith("K") else 4.1 for joint in ALL}
    gaps = {"with": with_effect, "all": dict.fromkeys(("all", *ALL), 4.0)}
    saturated = effect("flow_saturation")
    assert shown(gaps, saturated) == {joint for joint in ALL if joint.endswith("K")}
    knees = tuple(joint for joint in ALL if joint.endswith("K"))
    assert judged("single", [saturated], diagnosis(cause("flow_saturation", knees)), gaps=gaps).place_is_right()
    assert judged("single", [saturated], diagnosis(cause("flow_saturation")), gaps=gaps).place_is_right()


def test_place_of_an_unknown_effect_is_where_the_gap_is():
    leg = [effect("hysteresis", LEG, outside=True)]
    found = diagnosis(verdict="unknown", where=[place("LFK", 0.6), place("RFK", 0.2)])
    missed = diagnosis(verdict="unknown", where=[place("LFK", 0.4), place("RFK", 0.3)])
    nowhere = diagnosis(verdict="unknown")
    assert [judged("outside", leg, content).place_is_right() for content in (found, missed, nowhere)] == [
        True,
        False,
        False,
    ]


def test_place_says_nothing_where_the_unknown_effect_is_everywhere():
    content = diagnosis(verdict="unknown", where=[place("LFK")])
    assert judged("outside", [effect("hysteresis", outside=True)], content).place_is_right() is None


@pytest.mark.parametrize(("quarter", "right"), [("quarter_2", True), ("quarter_4", False), ("reversal", False)])
def test_place_of_a_time_span_is_its_quarter(quarter, right):
    content = diagnosis(cause("backlash"), where=[place("LFK", 0.4), place("LFK", 0.3, quarter)])
    case = judged("place", [effect("backlash", span=(0.3, 0.6))], content)
    assert case.place_is_right() is right


def test_parameters_are_compared_with_the_true_ones():
    claims = {
        "delay_s": {"value": 0.0052, "unit": "s", "ci95": [0.0049, 0.0055]},
        "other": {"value": 1.0, "unit": "1", "ci95": [0.0, 2.0]},
    }
    planted = effect("command_delay", parameters={"delay_s": 0.005})
    case = judged("single", [planted], diagnosis(cause("command_delay", parameters=claims)))
    (row,) = case.parameters()
    assert (row["error"], row["close"], row["covered"]) == (pytest.approx(0.04), True, True)
    planted = effect("command_delay", parameters={"delay_s": -0.006})
    (row,) = judged("single", [planted], diagnosis(cause("command_delay", parameters=claims))).parameters()
    assert (row["error"], row["close"], row["covered"]) == (pytest.approx(11.2 / 6.0), False, False)


def test_time_spans_have_no_parameters():
    claim = {"delay_s": {"value": 1.0, "unit": "s", "ci95": [0.0, 2.0]}}
    planted = effect("command_delay", parameters={"delay_s": 1.0}, span=(0.2, 0.5))
    assert not list(judged("place", [planted], diagnosis(cause("command_delay", parameters=claim))).parameters())


def gaps(with_all: float, none: float, **others: float) -> dict:
    sets = {"with": with_all, "all": none} | others
    return {name: {"all": value} | dict.fromkeys(ALL, value) for name, value in sets.items()}


def test_true_shrink_and_shapley_shares_of_two():
    pair = gaps(10.0, 4.0, without_a=7.0, only_b=7.0, without_b=9.0, only_a=9.0)
    assert true_shrink(pair) == pytest.approx(0.6)
    # a takes 0.3 first and 0.5 last; b 0.1 and 0.3
    assert true_shares(pair, ["a", "b"]) == pytest.approx({"a": 0.4, "b": 0.2})
    assert true_shares(pair, ["a", "b", "c", "d"]) == {}


def test_shapley_shares_of_three():
    worth = {"a": 0.1, "b": 0.2, "c": 0.3, "ab": 0.35, "ac": 0.5, "bc": 0.45, "abc": 0.7}
    left = {name: 10.0 * (1.0 - value) for name, value in worth.items()}
    sets = {"without_a": left["a"], "without_b": left["b"], "without_c": left["c"]}
    sets |= {"only_a": left["bc"], "only_b": left["ac"], "only_c": left["ab"]}
    shares = true_shares(gaps(10.0, left["abc"], **sets), ["a", "b", "c"])
    expected = dict.fromkeys("abc", 0.0)
    for order in permutations("abc"):  # the definition
        for count, name in enumerate(order):
            before, after = "".join(sorted(order[:count])), "".join(sorted(order[: count + 1]))
            expected[name] += (worth[after] - worth.get(before, 0.0)) / 6.0
    assert shares == pytest.approx(expected)


def test_an_effect_that_makes_no_gap_need_not_be_named_but_may_be():
    pair = [effect("backlash"), effect("torque_bias", ("LFK",))]
    known = gaps(10.0, 4.0, without_torque_bias=10.0, only_backlash=10.0, only_torque_bias=4.1, without_backlash=4.1)
    silent = judged("mixture", pair, diagnosis(cause("backlash")), gaps=known)
    bold = judged("mixture", pair, diagnosis(cause("backlash"), cause("torque_bias")), gaps=known)
    wrong = judged("mixture", pair, diagnosis(cause("torque_bias")), gaps=known)
    assert (silent.exact(), bold.exact(), wrong.exact()) == (True, True, False)


def test_a_gain_of_the_sensor_makes_no_gap_and_must_be_named_all_the_same():
    case = judged("place", [effect("torque_scale", ("LFK",))], diagnosis(), gaps=gaps(4.1, 4.1))
    assert not case.exact()


@pytest.mark.parametrize("offset", ["position_bias", "torque_bias"])
def test_an_offset_need_not_be_named_where_an_integrator_has_taken_it_up(offset):
    everywhere = [effect("integral_action"), effect(offset, LEG)]
    silent = judged("mixture", everywhere, diagnosis(cause("integral_action")))
    bold = judged("mixture", everywhere, diagnosis(cause("integral_action"), cause(offset, LEG)))
    other = judged("mixture", everywhere, diagnosis(cause("integral_action"), cause("valve_lag", LEG)))
    assert (silent.exact(), bold.exact(), other.exact()) == (True, True, False)
    assert silent.needed == (everywhere[0],)
    beside = judged(
        "mixture", [effect("integral_action", LEG), effect(offset)], diagnosis(cause("integral_action", LEG))
    )
    assert not beside.exact()
    outside = tuple(joint for joint in ALL if joint not in LEG)
    causes = cause("integral_action", LEG), cause(offset, outside)
    assert replace(beside, content=diagnosis(*causes)).place_is_right(strict=True)
    arm = replace(silent, answer=replace(silent.answer, machine="arm"))
    assert not arm.exact()  # whose integrator is in front of the encoder's offset


def test_shrink_counts_only_where_the_set_is_exact():
    planted = [effect("backlash")]
    cases = [
        judged("single", planted, diagnosis(cause("backlash")), gaps=gaps(10.0, 5.0)),
        judged("single", planted, diagnosis(cause("backlash")), gaps=gaps(10.0, 4.0)),
        judged("single", planted, diagnosis(cause("valve_lag")), gaps=gaps(10.0, 5.0)),
    ]
    assert share(cases, SHRINK) == (1, 1, 2)


def test_calibration_of_probabilities():
    planted = [effect("backlash")]
    cases = [
        judged("single", planted, diagnosis(cause("backlash", probability=0.9))),
        judged("single", planted, diagnosis(cause("valve_lag", probability=0.7))),
    ]
    found = calibration(cases)
    assert found["brier"] == pytest.approx((0.1**2 + 0.7**2) / 2)
    assert [entry["of"] for entry in found["bins"]] == [0, 0, 0, 1, 1]
    assert [entry["share"] for entry in found["bins"]][3:] == [0.0, 1.0]


def test_detection_by_effect_and_size():
    cases = [
        judged("single", [effect("backlash", size="small")], diagnosis()),
        judged("single", [effect("backlash", size="large")], diagnosis(cause("backlash"))),
        judged("single", [effect("valve_lag", size="large")], diagnosis(cause("backlash"))),
    ]
    found = {(row["effect"], row["size"]): (row["right"], row["of"]) for row in detection(cases)}
    assert found["any", "small"] == (0, 1)
    assert found["any", "large"] == (1, 2)
    assert found["backlash", "large"] == (1, 1)


def test_confusion_of_first_names():
    cases = [
        judged("none", [], diagnosis()),
        judged("single", [effect("backlash")], diagnosis(cause("valve_lag"))),
        judged("single", [effect("backlash")], diagnosis(cause("backlash"))),
    ]
    assert confusion(cases) == {
        "truth": ["backlash", "(no effect)"],
        "named": ["backlash", "valve_lag", "(no name)"],
        "counts": [[1, 1, 0], [0, 0, 1]],
    }


def test_every_miss_is_listed_with_truth_and_answer():
    cases = [
        judged("none", [], diagnosis(), case="case_000"),
        judged("single", [effect("backlash", LEG)], diagnosis(cause("valve_lag", ("RFK",))), case="case_001"),
        judged("single", [effect("backlash", size="small")], diagnosis(), case="case_002"),
        judged("none", [], None, error="ValueError: it broke", case="case_003"),
    ]
    listed = {row["case"]: row for row in score(cases)["misses"]}
    assert set(listed) == {"case_001", "case_002", "case_003"}
    assert listed["case_001"]["truth"] == "backlash (typical) in LFR, LFP, LFK"
    assert listed["case_001"]["answer"] == "explained: valve_lag 0.95 in RFK"
    assert TOP in listed["case_001"]["missed"]
    assert listed["case_003"]["answer"] == "failed: ValueError: it broke"


def test_score_is_json():
    case = judged("single", [effect("backlash")], diagnosis(cause("backlash")), gaps=gaps(10.0, 5.0))
    assert json.loads(json.dumps(score([case]), allow_nan=False))["cases"] == 1


def test_an_aim_that_nothing_was_tried_for_is_not_judged():
    assert tally([]) == {"right": 0, "of": 0, "share": None, "ci95": [0.0, 1.0]}
    assert {row["met"] for row in score([judged("none", [], diagnosis())])["aims"]} == {None, True}


def test_answers_are_read_and_checked(tmp_path):
    planted = {
        "effect": "backlash",
        "layer": "actuator",
        "outside": False,
        "joints": ["LFK"],
        "scope": "joint",
        "size": "small",
        "span": [0.2, 0.5],
        "parameters": {"gap": 0.01, "other": None},
    }
    entry = {"case": "case_000", "kind": "place", "effects": [planted], "truth": {"all": "truth/case_000/all"}}
    path = tmp_path / ANSWERS
    path.write_text(json.dumps({"format": FORMAT, "answers": [entry]}))
    (answer,) = read_answers(tmp_path)
    assert answer.effects[0].parameters == {"gap": 0.01}
    assert answer.effects[0].span == (0.2, 0.5)
    del entry["truth"]
    path.write_text(json.dumps({"format": FORMAT, "answers": [entry]}))
    with pytest.raises(LogError, match=r"answers\[0\] has no 'truth'"):
        read_answers(tmp_path)
    path.write_text(json.dumps({"format": "hqpipe-blind/0", "answers": []}))
    with pytest.raises(LogError, match="expected hqpipe-blind/1"):
        read_answers(tmp_path)
    with pytest.raises(LogError, match="hqpipe blind make"):
        read_answers(tmp_path / "absent")


def test_extra_error_adds_in_squares():
    assert extra_error(gaps(5.0, 4.0)) == pytest.approx(0.75)
    assert extra_error(gaps(3.9, 4.0)) == 0.0
    assert extra_error(None) is None and extra_error({"with": {"all": 4.0}}) is None


def test_faint_cases_count_for_the_limit_of_detection_alone():
    clear = [
        judged("single", [effect("backlash")], diagnosis(cause("backlash")), gaps=gaps(10.0, 5.0), case="case_000"),
        judged("none", [], diagnosis(), case="case_001"),
    ]
    claim = {"delay_s": {"value": 0.009, "unit": "s", "ci95": [0.008, 0.01]}}
    planted = effect("command_delay", size=None, factor=0.5, parameters={"delay_s": 0.001})
    faint = [
        judged("faint", [planted], content, gaps=gaps(5.0, 4.0), case=f"case_{i + 2:03d}")
        for i, content in enumerate(
            (diagnosis(cause("valve_lag", LEG)), diagnosis(cause("command_delay", parameters=claim)), None)
        )
    ]
    alone, both = score(clear), score([*clear, *faint], faint)
    assert alone["limit"] is None
    for key in ("calibration", "detection", "confusion", "parameters", "shrink"):
        assert both[key] == alone[key]
    assert both["aims"][:-1] == alone["aims"]
    assert both["aims"][-1]["measure"].startswith("smallest effect named 9 times in 10")
    assert (both["cases"], [row["case"] for row in both["failed"]]) == (5, ["case_004"])
    more = {row["measure"]: (row["right"], row["of"]) for row in both["more"]}
    assert more["diagnosis finished"] == (4, 5)
    assert more["nothing false named beside a faint effect"] == (1, 2)
    for row in alone["more"][:5]:
        assert row in both["more"]
    missed = {row["case"]: row for row in both["misses"]}
    assert set(missed) == {"case_002", "case_004"}
    assert missed["case_002"]["truth"] == "command_delay (0.50 × small) in all joints"


def test_oracle_of_mixtures_tells_what_these_logs_hide():
    planted = [effect("backlash"), effect("valve_lag")]
    half = diagnosis(cause("backlash"))
    whole = diagnosis(cause("backlash"), cause("valve_lag"))
    cases = [judged("mixture", planted, half, case=f"case_{i:03d}") for i in range(2)]
    oracle = [judged("mixture", planted, content, case=f"case_{i:03d}") for i, content in enumerate((half, whole))]
    found = score(cases, oracle)
    more = {row["measure"]: (row["right"], row["of"]) for row in found["more"]}
    assert more["exact set, mixtures of 2–4, by an oracle that knows which effects it may be"] == (1, 2)
    hidden = {row["case"]: "the oracle misses the set too" in row["missed"] for row in found["misses"]}
    assert hidden == {"case_000": True, "case_001": False}
    assert not any("oracle" in row["measure"] for row in score(cases)["more"])


def test_oracle_of_places_tells_what_these_logs_hide():
    """Three joints of twelve left out, by the diagnosis or by both; a case without the oracle is not compared."""
    some = diagnosis(cause("backlash", ALL[:9]))
    answers = (some, some, diagnosis(cause("backlash")), some)
    cases = [judged("single", [effect("backlash")], said, case=f"case_{i:03d}") for i, said in enumerate(answers)]
    seen = (some, diagnosis(cause("backlash")), diagnosis(cause("backlash")))
    oracle = [judged("single", [effect("backlash")], said, case=f"case_{i:03d}") for i, said in enumerate(seen)]
    found = score(cases, oracle)
    more = {row["measure"]: (row["right"], row["of"]) for row in found["more"]}
    assert more["place right by that oracle, which is not asked for effects outside the library"] == (2, 3)
    assert more["place right in the same cases"] == (1, 3)
    hidden = {row["case"]: "the oracle misses the place too" in row["missed"] for row in found["misses"]}
    assert hidden == {"case_000": True, "case_001": False, "case_003": False}
    assert share(cases, PLACE) == (1, 1, 4)


@pytest.mark.parametrize(("left", "refuted"), [(1.04, False), (1.06, True)])
def test_a_name_that_fits_as_well_as_the_withheld_effect_is_told_apart_from_one_that_does_not(left, refuted):
    truth = [effect("command_delay", LEG)]
    said = judged(
        "single", truth, diagnosis(cause("valve_lag", LEG)), without=("command_delay",), left=dict.fromkeys(LEG, left)
    )
    oracle = judged(
        "single", truth, diagnosis(cause("command_delay", LEG)), without=("valve_lag",), left=dict.fromkeys(LEG, 1.0)
    )
    result = score([said], [oracle])
    (row,) = [row for row in result["more"] if row["measure"].startswith("the same, or a name that leaves no more")]
    assert (row["right"], row["of"]) == (0 if refuted else 1, 1)
    assert ("leaves no more error" in result["misses"][0]["missed"]) != refuted
