"""A new effect is one file and one line: fitted, replayed, reported, explained and simulated with no other file touched."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import toy_effects

from hqpipe.machine import add_effect

HERE = Path(__file__).parent
TRUTH = {("pilot_sag", "share"): 0.6, ("pilot_sag", "time_s"): 0.2, ("metering_notches", "doubled_at"): 0.15}


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What a process of its own finds, whose table of effects has the two."""
    folder = tmp_path_factory.mktemp("toy")
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": str(HERE)}
    command = [sys.executable, HERE / "toy_diagnosis.py", folder]
    result = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return json.loads((folder / "result.json").read_text())


def test_it_is_found_where_it_is_and_its_numbers_are_fitted(found):
    assert [(c["effect"], c["joints"]) for c in found["causes"]] == [("pilot_sag", ["a"]), ("metering_notches", ["b"])]
    for cause in found["causes"]:
        assert cause["layer"] == "actuator" and cause["parameters"]
        for name, number in cause["parameters"].items():
            assert number["value"] == pytest.approx(TRUTH[cause["effect"], name], rel=0.02)


def test_the_replay_with_it_leaves_noise(found):
    gap = found["gap"]
    assert gap["after"] < 1.05 * gap["noise_floor"] < 0.1 * gap["before"]


def test_the_page_says_what_it_is_and_what_to_do(found):
    assert found["explained"] == [True, True]


def test_the_simulator_steps_it_alone_and_in_a_batch_as_in_a_window(found):
    assert found["stepped"]["batch"] < 1e-9 and found["stepped"]["window"] < 1e-9


def test_the_actuator_file_keeps_it(found):
    assert found["kept"] == ["metering_notches", "pilot_sag"]


def test_an_effect_that_comes_too_late_is_refused():
    import hqpipe.machine.layout  # noqa: F401 (what composes the chain)

    with pytest.raises(RuntimeError, match="metering_notches' comes too late"):
        add_effect(toy_effects.NOTCHES)
