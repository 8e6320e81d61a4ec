"""Exit codes and messages when something goes wrong, and what is left behind."""

from __future__ import annotations

import pytest
import toy_pipeline


def leftovers(toy) -> list:
    return list(toy.artifacts.rglob(".tmp-*"))


def test_unexpected_exception_is_one_line_with_the_place(toy):
    answer = toy("run", "all", "--set", "square_up.fault=unexpected")
    assert answer.code == 1
    assert "square-up failed: ZeroDivisionError: a fault of the stage" in answer.err
    assert "toy_pipeline.py:" in answer.err and "Traceback" not in answer.err
    assert (toy.artifacts / "numbers").exists() and not (toy.artifacts / "squares").exists()
    assert not leftovers(toy)


def test_the_place_is_in_our_code_and_not_in_a_library(toy, monkeypatch):
    import statistics

    import toy_square

    def run(context):
        return statistics.mean([])

    monkeypatch.setattr(toy_square, "run", run)
    toy("numbers")
    answer = toy("square-up")
    assert answer.code == 1 and "StatisticsError" in answer.err and "statistics.py" not in answer.err
    assert "cli/test_failures.py:" in answer.err and "--traceback" in answer.err


def test_traceback_on_request(toy, monkeypatch):
    monkeypatch.setenv("HQPIPE_TRACEBACK", "1")
    assert "Traceback" in toy("run", "all", "--set", "square_up.fault=unexpected").err


def test_expected_error_names_the_stage(toy):
    answer = toy("run", "all", "--set", "square_up.fault=expected", "--json")
    assert answer.code == 1
    assert answer.data["error"]["message"] == "square-up: column 'time' is missing"
    assert answer.data["error"]["exit_code"] == 1
    assert answer.actions == {"numbers": "ran"}


def test_interrupt_leaves_nothing_half_made(toy):
    toy("numbers")
    answer = toy("square-up", "--set", "fault=interrupt")
    assert answer.code == 130
    assert "interrupted" in answer.err
    assert not leftovers(toy) and not (toy.artifacts / "squares").exists()


@pytest.mark.parametrize(("fault", "message"), [("link", "symbolic link"), ("empty", "wrote no file")])
def test_output_that_cannot_be_kept(toy, fault, message):
    answer = toy("run", "all", "--set", f"square_up.fault={fault}")
    assert answer.code == 1 and message in answer.err
    assert not leftovers(toy) and not (toy.artifacts / "squares").exists()


def test_missed_gate_keeps_the_artifact_and_exits_4_every_time(toy):
    toy.edit("report: {}", "report: {limit: 10}")
    for action in ("ran", "kept"):
        answer = toy("run", "all", "--json")
        assert answer.code == 4
        assert answer.actions["report"] == action
        assert "16.0 above 10.0" in answer.data["error"]["message"]
    assert (toy.artifacts / "report" / "report.txt").exists()
    assert "gate missed" in toy("status").out


@pytest.mark.parametrize("bad", [[], {"gate": {"passed": "yes"}}, {"a": {"b": object()}}])
def test_metrics_of_the_wrong_form(toy, monkeypatch, bad):
    import toy_numbers

    def run(context):
        (context.output / "a").write_text("a")
        return bad

    monkeypatch.setattr(toy_numbers, "run", run)
    answer = toy("numbers")
    assert answer.code == 1 and "expected" in answer.err
    assert not (toy.artifacts / "numbers").exists()


def test_unknown_command_and_option(toy):
    answer = toy("square_up")
    assert answer.code == 2 and "did you mean 'square-up'" in answer.err
    assert toy("numbers", "--no-such-option").code == 2


def test_outside_a_project(toy, tmp_path_factory, monkeypatch):
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    answer = toy("status")
    assert answer.code == 2 and "hqpipe init DIR" in answer.err


def test_project_root_is_found_from_below(toy, monkeypatch):
    monkeypatch.chdir(toy.root / "robot" / "toy")
    assert toy("run", "all").code == 0
    assert (toy.root / "artifacts" / "report").exists()


def test_unexpected_error_of_a_command(toy, monkeypatch):
    monkeypatch.setattr(toy_pipeline.TABLE["numbers"].__class__, "load_params", lambda self: 1 / 0)
    answer = toy("status")
    assert answer.code == 1 and "ZeroDivisionError" in answer.err and "Traceback" not in answer.err
