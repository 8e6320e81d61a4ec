"""Trainings of compare side by side: the same bytes, progress that adds up, divergence, and an end with their parent."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import compare_parent
import pytest
from process_tree import children, runs

from hqpipe.logs import size
from hqpipe.stages.comparison.controllers import Controller
from hqpipe.stages.comparison.train import REPORT, Trained, fit_into_memory, train_all
from hqpipe.system.durable import CHECKSUMS

DEADLINE_S = 120.0


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name not in (REPORT, CHECKSUMS)}


def trained(folder: Path, workers: int, controllers: list[Controller], said: list) -> list[Trained]:
    context = compare_parent.context(folder, workers, lambda *given: said.append(given))
    return train_all(context, controllers, [1], context.progress)


def test_results_do_not_depend_on_what_is_trained_beside_or_on_the_workers(tmp_path):
    controllers, said = compare_parent.controllers(), []
    alone = trained(tmp_path / "one", 1, controllers, [])
    beside = trained(tmp_path / "two", 4, controllers, said)  # two at a time with two workers each
    for one, other in zip(alone, beside, strict=True):
        assert one.name == other.name and files(one.folder) == files(other.folder)
    assert {"policy.safetensors", "metrics.csv"} <= set(files(beside[0].folder))
    done = [done for done, _, _ in said]
    assert done == sorted(done) and done[-1] == 2.0 and {total for _, total, _ in said} == {2}
    assert {note.split(", seed 1")[0] for _, _, note in said} == {each.title for each in controllers}


def test_what_is_there_counts_as_done_and_one_that_diverges_does_not_end_the_others(tmp_path):
    torque, stiff = compare_parent.controllers()
    trained(tmp_path, 1, [torque], [])
    diverging = Controller("fitted", "position", compare_parent.Diverging.of(stiff.actuator))
    said: list[tuple[float, float, str]] = []
    found = trained(tmp_path, 2, [torque, stiff, diverging], said)
    assert [each.diverged for each in found] == [None, None, "the training diverged"]
    assert (found[2].folder / "metrics.csv").read_text(encoding="utf-8") == "step\n1\n"
    assert min(done for done, _, _ in said) > 1.0 and said[-1][:2] == (3.0, 3)
    said.clear()
    assert [each.diverged for each in trained(tmp_path, 2, [diverging, stiff], said)] == ["the training diverged", None]
    assert not said


def test_no_more_run_at_a_time_than_fit_into_memory(monkeypatch):
    training = compare_parent.context(Path(), 1, None, num_envs=400, ppo={}).params.training
    for gigabytes, count in ((1, 1), (8, 1), (16, 3), (64, 15)):
        monkeypatch.setattr(size, "memory_bytes", lambda gigabytes=gigabytes: gigabytes * 10**9)
        assert fit_into_memory(training) == count


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_all_end_with_their_parent(tmp_path, number):
    command = [sys.executable, compare_parent.__file__, str(tmp_path)]
    hears = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}  # a job in the background ignores it
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
    with subprocess.Popen(command, **streams, **hears) as parent:
        assert parent.stdout.readline() == "training\n"
        everyone = children(parent.pid)
        assert len(everyone) >= 2
        parent.send_signal(number)
        deadline = time.monotonic() + DEADLINE_S
        while any(map(runs, everyone)):
            assert time.monotonic() < deadline, "a process stayed behind"
            time.sleep(0.05)
    assert not list(tmp_path.glob("*/files"))
    assert len(list(tmp_path.glob("*/scratch"))) == 2
