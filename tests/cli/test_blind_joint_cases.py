"""hqpipe blind score on cases of servos and arms: layers, earlier logs, libraries of the oracle."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hqpipe.benchmark.score.truth import ANSWERS, FORMAT
from hqpipe.errors import UsageError
from hqpipe.machine import EFFECTS
from hqpipe.stages.blind import score as blind_score

LIBRARY = ("coulomb_friction", "torque_limit", "voltage_sag")


def planted(name: str, outside: bool = False) -> dict:
    place = {"effect": name, "layer": "servo", "outside": outside, "joints": ["j0"], "scope": "machine"}
    return place | {"size": "typical", "span": None, "parameters": {}}


def cause(name: str) -> dict:
    place = {"effect": name, "layer": "servo", "joints": ["j0"], "scope": "machine", "probability": 0.9}
    return place | {"parameters": {}, "shrink": 0.5, "shrink_ci95": [0.4, 0.6], "confused_with": []}


def content(*names: str) -> str:
    return json.dumps(
        {
            "verdict": "explained" if names else "no_gap",
            "logs": {"joints": ["j0"]},
            "gap": {"shrink": 0.5, "shrink_ci95": [0.4, 0.6]},
            "where": [],
            "causes": [cause(name) for name in names],
            "unexplained": {"above_noise": False, "where": []},
        }
    )


@pytest.fixture
def folder(tmp_path) -> Path:
    """A single effect, a sound machine, a change and no change."""
    truth = {"all": "truth/case_000/all", "without": {}, "only": {}}
    none = {"all": None, "without": {}, "only": {}}
    answers = [
        {"case": "case_000", "kind": "single", "effects": [planted("torque_limit")], "truth": truth},
        {"case": "case_001", "kind": "none", "effects": [], "truth": none},
        {"case": "case_002", "kind": "change", "effects": [planted("coulomb_friction")], "truth": truth},
        {"case": "case_003", "kind": "change", "effects": [], "truth": none},
    ]
    for number in (2, 3):
        answers[number]["reference"] = f"reference/case_00{number}"
        (tmp_path / answers[number]["reference"]).mkdir(parents=True)
    for entry in answers:
        (tmp_path / entry["case"]).mkdir()
    (tmp_path / ANSWERS).write_text(json.dumps({"format": FORMAT, "machine": "servo", "answers": answers}))
    return tmp_path


@pytest.fixture
def asked(monkeypatch) -> list[tuple]:
    """Replaces diagnosis, libraries and gaps; returns what was asked for."""
    said = {"case_000": ("torque_limit",), "case_002": ("coulomb_friction",)}
    calls: list[tuple] = []

    def diagnosed(case, output, without, reference=None):
        calls.append((f"{output.parent.name}/{output.name}", without, reference and reference.name))
        output.mkdir(parents=True)
        (output / "diagnosis.json").write_text(content(*said.get(case.name, ())))

    def in_this_process(task, calls, workers, report=None):
        return [task(*arguments) for arguments in calls.values()]

    def gaps(places, layers):
        calls.append(("gaps", tuple(places), layers))
        return {name: {"all": 1.0 + (name == "with"), "j0": 1.0 + (name == "with")} for name in places}

    monkeypatch.setattr(blind_score, "in_processes", in_this_process)
    monkeypatch.setattr(blind_score, "diagnose_case", diagnosed)
    monkeypatch.setattr("hqpipe.benchmark.score.layer.library_of", lambda folder: LIBRARY)
    monkeypatch.setattr("hqpipe.benchmark.score.layer.layer_gaps", gaps)
    return calls


def score(folder: Path) -> dict:
    return blind_score.score_folder(folder, (), 1, lambda *_: None)


def test_earlier_logs_go_to_the_diagnosis_of_their_case_alone(folder, asked):
    score(folder)
    assert asked[:4] == [
        ("diagnosis/case_000", (), None),
        ("diagnosis/case_001", (), None),
        ("diagnosis/case_002", (), "case_002"),
        ("diagnosis/case_003", (), "case_003"),
    ]


def test_oracle_has_the_true_effects_of_the_layers_alone(folder, asked):
    score(folder)
    (oracle,) = [call for call in asked if call[0].startswith("oracle/")]
    assert oracle[0] == "oracle/case_000"
    assert (set(EFFECTS) | set(LIBRARY)) - set(oracle[1]) == {"torque_limit"}


def test_gaps_are_those_of_the_layer_and_not_of_changes(folder, asked):
    score(folder)
    assert [call for call in asked if call[0] == "gaps"] == [("gaps", ("with", "all"), ("servo",))]
    kept = json.loads((folder / "truth" / "case_000" / "true_gaps.json").read_text())
    assert kept["with"] == {"all": 2.0, "j0": 2.0}
    asked.clear()
    assert score(folder)["cases"] == 4
    assert asked == []  # diagnoses, libraries and gaps are kept


def test_scored_by_family_with_both_kinds_of_changes(folder, asked):
    result = score(folder)
    aims = {row["measure"]: (row["right"], row["of"]) for row in result["aims"]}
    assert aims["change since earlier logs: exactly what changed is named"] == (1, 1)
    assert aims["no change since earlier logs: no gap"] == (1, 1)
    assert aims["single effect, typical size: it is the top cause"] == (1, 1)
    (family,) = result["families"]
    assert (family["family"], family["cases"], family["utility"]) == ("servo", 4, 1.0)
    assert [row["answers"] for row in result["baselines"]] == ["diagnosis", "null", "random"]
    assert result["misses"] == []
    assert "By family of machines" in (folder / "score.html").read_text(encoding="utf-8")


def test_earlier_logs_that_are_not_made(folder, asked):
    (folder / "reference" / "case_003").rmdir()
    with pytest.raises(UsageError, match="1 cases are not made, the first is reference/case_003"):
        score(folder)


def test_diagnosis_of_a_change_is_given_its_earlier_logs(folder, monkeypatch):
    given = []

    def diagnose(log_set, without, earlier):
        given.append((log_set, without, earlier))
        raise ValueError("far enough")

    monkeypatch.setattr("hqpipe.logs.log_set.read_log_set", lambda path: path.name)
    monkeypatch.setattr("hqpipe.gap.diagnosis.diagnose", diagnose)
    monkeypatch.setattr(blind_score, "_earlier", lambda reference: ("earlier", reference.name))
    for number, reference in ((1, None), (2, folder / "reference" / "then")):
        blind_score.diagnose_case(folder / f"case_00{number}", folder / "out" / str(number), ("backlash",), reference)
    assert given == [
        ("case_001", ("backlash",), None),
        ("case_002", ("backlash",), ("earlier", "then")),
    ]
