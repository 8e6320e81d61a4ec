"""The gate of validate, without a plant: what is asked of a walk, and what is said of one that misses it."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest
from pydantic import ValidationError

from hqpipe.stages import validate
from hqpipe.stages.validate import Params, failure, missed, walk_checks, walk_limits
from hqpipe.stages.walks.scenarios import SCENARIOS


def row(name: str, falls: int = 0, **worst) -> dict:
    scenario = SCENARIOS[name]
    values = {"drift": 0.01, "speed_error": 0.01, "yaw_error": 0.01, **worst}
    return {"scenario": name, "title": scenario.title, "walks": 4, "falls": falls, "worst": values, "mean": values}


def judged(one: dict, **params) -> list[str]:
    one["limits"] = walk_limits(SCENARIOS[one["scenario"]], Params(**params))
    return [failure(*check) for check in missed(walk_checks(one))]


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_good_walk_passes_and_a_fall_does_not(name):
    assert judged(row(name)) == []
    (said,) = judged(row(name, falls=1))
    assert said.startswith(f"{name} (") and said.endswith("4 walks): falls: 1, expected at most 0")
    assert judged(row(name, falls=1), walk_falls=1) == []


def test_every_scenario_has_the_limits_that_mean_something_there():
    asked = {name: set(walk_limits(scenario, Params())) - {"falls"} for name, scenario in SCENARIOS.items()}
    assert asked["stand"] == {"drift"}
    assert asked["turn_05"] == {"drift", "yaw_error"}
    assert all(asked[name] == {"drift", "speed_error"} for name in asked if name not in ("stand", "turn_05"))


def test_more_is_granted_beyond_the_paper_s_speed_and_less_to_a_robot_that_stands():
    assert judged(row("forward_13", speed_error=0.08)) == []
    (said,) = judged(row("forward_10", speed_error=0.08))
    assert "speed error, m/s: 0.08, expected at most 0.05" in said
    assert judged(row("forward_10", drift=0.5)) == []
    assert "drift, m: 0.5, expected at most 0.1" in judged(row("stand", drift=0.5))[0]
    assert judged(row("stand", drift=0.5), walk_drift=10.0) == [], "both follow the limit of the caller"


def test_where_all_fell_there_is_nothing_to_pass():
    said = judged(row("turn_05", falls=4, drift=None, yaw_error=None))
    assert len(said) == 3 and sum("none finished" in line for line in said) == 2


def test_an_unknown_scenario_is_refused_with_a_near_match():
    with pytest.raises(ValidationError, match="did you mean 'low_supply'"):
        Params(scenarios=["stand", "lowsupply"])


@pytest.fixture
def run(monkeypatch, tmp_path):
    """`validate.run` on rows that are given instead of walked; returns the metrics, validation.json and what was asked."""
    from hqpipe.rl import onnx_session
    from hqpipe.stages.output import figures

    def go(rows: list[dict], **params):
        asked = {}

        def walked(policy, robot, names, seeds, first_seed, plant, workers, progress, **more):
            asked.update(names=names, seeds=seeds, first_seed=first_seed, **more)
            rows[0]["columns"] = {"time": None}
            return rows

        torque = {"rmse": 1.0, "nrmse": 0.1, "persistence_rmse": 2.0, "noise_floor": 0.5}
        monkeypatch.setattr(validate, "run_scenarios", walked)
        monkeypatch.setattr(validate, "_torque_error", lambda context: torque)
        monkeypatch.setattr(validate, "_parity", lambda context: 1e-6)
        monkeypatch.setattr(onnx_session, "latency", lambda path: {"median_us": 12.34, "p99_us": 56.78})
        monkeypatch.setattr(figures, "draw_walk", lambda folder, name, columns, robot: asked.update(drawn=name))
        context = SimpleNamespace(
            params=Params(**params),
            seed=1,
            workers=1,
            robot=None,
            inputs={"onnx": tmp_path},
            output=tmp_path,
            progress=None,
        )
        metrics = validate.run(context)
        return metrics, (tmp_path / "validation.json").read_text(encoding="utf-8"), asked

    return go


def test_the_gate_names_what_was_missed(run, capsys):
    rows = [row("stand"), row("turn_05", yaw_error=0.2)]
    metrics, text, asked = run(rows, scenarios=["stand", "turn_05"], walk_seeds=3, walk_seconds=9.0)
    assert asked == {
        "names": ["stand", "turn_05"],
        "seeds": 3,
        "first_seed": 1500,
        "seconds": 9.0,
        "shown": ("stand",),
        "drawn": "stand",
    }
    assert metrics["gate"]["passed"] is False
    (said,) = metrics["gate"]["failures"]
    assert said.startswith("turn_05") and said.endswith("rad/s: 0.2, expected at most 0.05")
    report = json.loads(text)
    assert [each["scenario"] for each in report["scenarios"]] == ["stand", "turn_05"]
    assert "12.34" not in text and "56.78" not in text, "the same bytes on any machine"
    assert "turn_05" in capsys.readouterr().err


def test_forward_10_is_drawn_where_it_is_walked(run):
    metrics, _, asked = run([row("forward_10"), row("stand")], scenarios=["forward_10", "stand"])
    assert metrics["gate"] == {"passed": True, "failures": []}
    assert asked["drawn"] == "forward_10"
