"""hqpipe blind: cases that are complete are kept, half-made ones are not, and a diagnosis sees its case alone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hqpipe.benchmark.score.truth import read_answers
from hqpipe.cli import run_cli
from hqpipe.errors import UsageError
from hqpipe.machine import EFFECTS
from hqpipe.plant.cases import Case, cases
from hqpipe.stages import STAGES
from hqpipe.stages.blind import machine as blind_machine
from hqpipe.stages.blind import make as blind_make
from hqpipe.stages.blind import score as blind_score


@pytest.fixture
def simulated(monkeypatch) -> list[tuple[str, tuple[str, ...]]]:
    """Writes an empty log set instead of simulating; returns what was asked for."""
    asked = []

    def fake(case: Case, robot: Path, folder: Path, leave_out=(), gait=None) -> int:
        asked.append((case.name, tuple(leave_out)))
        folder.mkdir(parents=True)
        (folder / "logset.yaml").write_text(f"{case.name} {sorted(leave_out)} {gait}")
        return 3

    monkeypatch.setattr(blind_machine, "simulate", fake)
    monkeypatch.setattr(blind_make, "in_processes", in_this_process)
    return asked


def in_this_process(task, calls, workers, report=None):
    return [task(*arguments) for arguments in calls.values()]


def make(out: Path, count: int = 12, seed: int = 1) -> int:
    return blind_make.make(count, seed, out, 1, lambda *_: None)


def test_cases_lie_apart_from_their_answers(tmp_path, simulated):
    assert make(tmp_path) == 12
    planned = {case.name: case for case in cases(12, 1)}
    for name, case in planned.items():
        assert [path.name for path in (tmp_path / name).iterdir()] == ["logset.yaml"]
        sets = {path.name for path in (tmp_path / "truth" / name).glob("*")}
        assert sets == set(blind_make.truth_sets(case))
    answers = json.loads((tmp_path / "answers.json").read_text(encoding="utf-8"))["answers"]
    assert [answer["case"] for answer in answers] == list(planned)
    for truth in (answer["truth"] for answer in answers):
        for path in [truth["all"], *truth["without"].values(), *truth["only"].values()]:
            assert path is None or (tmp_path / path).is_dir()


def test_the_machine_without_an_effect_walks_like_the_one_with_it(tmp_path, simulated):
    make(tmp_path)
    left_out = [path.read_text() for path in tmp_path.glob("truth/*/*/logset.yaml")]
    assert left_out and all(text.endswith(" 3") for text in left_out)


def test_complete_cases_are_kept_and_half_made_ones_done_again(tmp_path, simulated):
    make(tmp_path)
    whole = {path: path.read_text() for path in tmp_path.rglob("logset.yaml")}
    case = next(case for case in cases(12, 1) if case.planted).name
    (tmp_path / case / "logset.yaml").unlink()
    (tmp_path / case).rmdir()  # as after an interruption: the truth is there, the case is not
    (tmp_path / blind_make.HALF_MADE / case / "logs").mkdir(parents=True)
    simulated.clear()
    assert make(tmp_path) == 1
    assert {name for name, _ in simulated} == {case}
    assert {path: path.read_text() for path in tmp_path.rglob("logset.yaml")} == whole
    assert not (tmp_path / blind_make.HALF_MADE).exists()


def test_other_cases_are_not_mixed_in(tmp_path, simulated):
    make(tmp_path)
    with pytest.raises(UsageError, match=r"belongs to other cases than --cases 12 --seed 2"):
        make(tmp_path, seed=2)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_truth_of_a_mixture_leaves_out_all_each_and_all_but_each(count):
    mixture = next(case for case in cases(60, 1) if len(case.planted) == count)
    names = {planted.effect for planted in mixture.planted}
    sets, truth = blind_make.truth_sets(mixture), blind_make.answer(mixture)["truth"]
    left_out = {f"truth/{mixture.name}/{folder}": set(effects) for folder, effects in sets.items()}
    assert left_out[truth["all"]] == names
    assert {name: left_out[path] for name, path in truth["without"].items()} == {name: {name} for name in names}
    assert {name: left_out[path] for name, path in truth["only"].items()} == {name: names - {name} for name in names}


def test_a_full_disk_is_no_failure_of_the_diagnosis(tmp_path, monkeypatch):
    def fail(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hqpipe.logs.log_set.read_log_set", fail)
    with pytest.raises(OSError, match="No space"):
        blind_score.diagnose_case(tmp_path / "case_000", tmp_path / "diagnosis" / "case_000", ())
    assert not (tmp_path / "diagnosis" / "case_000").exists()


@pytest.mark.parametrize("text", ["", "{", "\xff", "[" * 100_000])
def test_a_damaged_diagnosis_is_made_again(tmp_path, monkeypatch, text):
    asked = []
    monkeypatch.setattr(blind_score, "in_processes", lambda task, calls, *options: asked.extend(calls))
    output = tmp_path / "diagnosis" / "case_000"
    output.mkdir(parents=True)
    (output / "diagnosis.json").write_bytes(text.encode("latin-1"))
    blind_score.diagnose_all([(tmp_path / "case_000", output, ())], 1, lambda *report: None)
    assert len(asked) == 1


def test_a_diagnosis_that_fails_is_kept_as_such_and_tried_again(tmp_path):
    case = tmp_path / "case_000"
    case.mkdir()
    output = tmp_path / "diagnosis" / "case_000"
    blind_score.diagnose_case(case, output, ())
    assert "LogError" in json.loads((output / "failed.json").read_text())["error"]
    assert not (output / "diagnosis.json").exists()
    blind_score.diagnose_case(case, output, ())
    assert [path.name for path in output.iterdir()] == ["failed.json"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["make", "--cases", "0", "--out", "x"], "0"),
        (["make"], "--out"),
        (["score", "absent"], "absent"),
    ],
)
def test_wrong_usage_is_exit_2(tmp_path, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(tmp_path)
    assert run_cli(STAGES, ["blind", *arguments]) == 2
    assert said in capsys.readouterr().err


def test_a_folder_without_answers_says_what_is_missing(tmp_path, capsys):
    assert run_cli(STAGES, ["blind", "score", str(tmp_path)]) == 1
    assert "hqpipe blind make" in capsys.readouterr().err


def test_cases_that_are_not_made_and_effects_that_none_has(tmp_path, simulated):
    make(tmp_path)
    (tmp_path / "case_003" / "logset.yaml").unlink()
    (tmp_path / "case_003").rmdir()
    with pytest.raises(UsageError, match="1 cases are not made, the first is case_003"):
        blind_score.score_folder(tmp_path, (), 1, lambda *_: None)
    with pytest.raises(UsageError, match="--without backlas"):
        blind_score.score_folder(tmp_path, ("backlas",), 1, lambda *_: None)


def content(verdict: str = "no_gap") -> str:
    unexplained = {"above_noise": False, "where": []}
    gap = {"shrink": 0.0, "shrink_ci95": [0.0, 0.0]}
    return json.dumps({"verdict": verdict, "gap": gap, "where": [], "causes": [], "unexplained": unexplained})


def test_score_writes_both_files_and_missed_aims_are_exit_4(tmp_path, simulated, monkeypatch, capsys):
    make(tmp_path)
    for case in cases(12, 1):
        output = tmp_path / "diagnosis" / case.name
        output.mkdir(parents=True)
        (output / "diagnosis.json").write_text(content())
        gaps = {name: dict.fromkeys(("all", *case_joints(case)), 4.0) for name in ("with", *gap_names(case))}
        (tmp_path / "truth" / case.name).mkdir(parents=True, exist_ok=True)
        (tmp_path / "truth" / case.name / "true_gaps.json").write_text(json.dumps(gaps))
    assert run_cli(STAGES, ["blind", "score", str(tmp_path), "--workers", "1", "--json"]) == 4
    shown = capsys.readouterr()
    answer, score = json.loads(shown.out), json.loads((tmp_path / "score.json").read_text(encoding="utf-8"))
    assert (answer["ok"], answer["exit_code"]) == (False, 4) and "aims are missed" in answer["error"]["message"]
    assert {name: value for name, value in answer.items() if name not in ("ok", "exit_code", "error")} == score
    assert "aims are missed" in shown.err
    assert "<svg" in (tmp_path / "score.html").read_text(encoding="utf-8")


def case_joints(case: Case) -> set[str]:
    return {joint for planted in case.planted for joint in planted.joints}


def gap_names(case: Case) -> set[str]:
    truth = blind_make.answer(case)["truth"]
    return set(blind_score.gap_sets(truth)) if truth["all"] else set()


def test_faint_cases_tell_their_factor_and_the_usual_ones_do_not(tmp_path, simulated):
    blind_make.make(5, 1, tmp_path / "faint", 1, lambda *_: None, ("faint",))
    make(tmp_path / "usual")
    faint, usual = (json.loads((tmp_path / name / "answers.json").read_text()) for name in ("faint", "usual"))
    assert faint["kinds"] == ["faint"] and "kinds" not in usual
    assert all(effect["factor"] > 0.0 for answer in faint["answers"] for effect in answer["effects"])
    assert not any("factor" in effect for answer in usual["answers"] for effect in answer["effects"])
    told = [[e.factor for e in a.effects] for a in read_answers(tmp_path / "faint")]
    assert told == [[p.factor for p in case.planted] for case in cases(5, 1, ("faint",))]
    assert {e.factor for a in read_answers(tmp_path / "usual") for e in a.effects} == {None}
    with pytest.raises(UsageError, match="--cases 5 --seed 1 --kind none of this version"):
        blind_make.make(5, 1, tmp_path / "faint", 1, lambda *_: None, ("none",))


def test_a_kind_that_does_not_exist_is_exit_2(tmp_path, capsys):
    arguments = ["blind", "make", "--cases", "2", "--kind", "feint", "--out", str(tmp_path / "x")]
    assert run_cli(STAGES, arguments) == 2
    assert "--kind feint" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


def test_faint_cases_are_diagnosed_again_with_the_true_effect_alone(tmp_path, simulated, monkeypatch):
    blind_make.make(3, 1, tmp_path, 1, lambda *_: None, ("faint",))
    asked = []

    def diagnosed(case, output, without):
        asked.append((output.relative_to(tmp_path).as_posix(), without))
        output.mkdir(parents=True)
        (output / "diagnosis.json").write_text(content())

    monkeypatch.setattr(blind_score, "in_processes", in_this_process)
    monkeypatch.setattr(blind_score, "diagnose_case", diagnosed)
    monkeypatch.setattr(blind_score, "_gaps", lambda *_: {})
    result = blind_score.score_folder(tmp_path, (), 1, lambda *_: None)
    planted = {case.name: case.planted[0].effect for case in cases(3, 1, ("faint",))}
    assert asked[:3] == [(f"diagnosis/{name}", ()) for name in planted]
    for (place, without), (name, effect) in zip(asked[3:], planted.items(), strict=True):
        assert place == f"oracle/{name}"
        assert set(EFFECTS) - set(without) == {effect}
    assert result["limit"]["cases"] == 3 and result["aims"][-1]["met"] is None
    assert "Limit of detection" in (tmp_path / "score.html").read_text(encoding="utf-8")
    with pytest.raises(UsageError, match="no case has this effect"):
        blind_score.score_folder(tmp_path, (next(iter(planted.values())),), 1, lambda *_: None)
