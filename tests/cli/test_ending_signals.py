"""SIGTERM, SIGHUP and Ctrl-C end the command in order, whenever they come."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest
from test_processes import SLOW, TOY, start

CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}
LINE = "interrupted: nothing half-made was kept; the same command goes on from here"

COMPUTING = """
import ctypes, threading
from concurrent.futures import ThreadPoolExecutor
import toy_pipeline

def run(context):
    with ThreadPoolExecutor(1) as pool:
        pool.submit(ctypes.CDLL(None).sleep, 600)
        print("computing", flush=True)
        threading.Event().wait()

def swallow(context):
    print("computing", flush=True)
    try:
        threading.Event().wait()
    except:
        threading.Event().wait()

import sys
sys.modules["toy_numbers"].run = {"run": run, "swallow": swallow}[sys.argv.pop(1)]
toy_pipeline.main(toy_pipeline.TABLE)
"""

IMPORTING = """
import sys, time
from hqpipe.cli import main
from toy_pipeline import TABLE

class Finder:
    def find_spec(self, name, path, target=None):
        if name == "hqpipe.pipeline.executor":
            print("importing", flush=True)
            time.sleep(600)

sys.meta_path.insert(0, Finder())
sys.argv = ["hqpipe", "run", "all"]
main(TABLE)
"""


def lines(process: subprocess.Popen) -> list[str]:
    """What the process says on standard error, but for what the stages say."""
    _, err = process.communicate(timeout=60)
    return [line for line in err.splitlines() if ": started" not in line and "chatter" not in line]


@pytest.mark.parametrize(("number", "code"), CODES.items(), ids=lambda value: str(value))
def test_a_signal_ends_the_command_with_one_line_and_its_code(toy, number, code):
    process = start(toy, "run", "all", *SLOW)
    process.send_signal(number)
    assert lines(process) == [LINE]
    assert process.returncode == code
    assert not list(toy.artifacts.glob("store/.tmp-*"))


@pytest.mark.parametrize("pause_s", [0.0, 0.005, 0.02, 0.05])
def test_a_second_signal_changes_nothing(toy, pause_s):
    process = start(toy, "run", "all", *SLOW)
    process.send_signal(signal.SIGTERM)
    for _ in range(3):
        time.sleep(pause_s)
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    assert lines(process) == [LINE]
    assert process.returncode in (130, 143)  # which of two that came at once is up to the system
    assert not list(toy.artifacts.glob("store/.tmp-*"))


@pytest.mark.parametrize("number", CODES)
def test_a_signal_during_imports(toy, number):
    path = {"PYTHONPATH": str(TOY.parent)}
    process = subprocess.Popen(
        [sys.executable, "-c", IMPORTING],
        cwd=toy.root,
        env=os.environ | path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert process.stdout.readline() == "importing\n"
    process.send_signal(number)
    assert lines(process) == [LINE]
    assert process.returncode == CODES[number]


@pytest.mark.parametrize("how", ["run", "swallow"])
def test_what_does_not_let_go_is_left_behind(toy, how):
    """A thread that computes cannot be stopped, and a library may catch everything."""
    process = subprocess.Popen(
        [sys.executable, "-c", COMPUTING, how, "run", "all"],
        cwd=toy.root,
        env=os.environ | {"PYTHONPATH": str(TOY.parent)},
        stderr=subprocess.PIPE,
        text=True,
    )
    while "computing" not in process.stderr.readline():
        assert process.poll() is None
    process.terminate()
    assert lines(process)[-1] == LINE
    assert process.returncode == 143
    assert toy("run", "all").code == 0
    assert not list(toy.artifacts.glob("store/.tmp-*"))


def test_an_ignored_hangup_stays_ignored(toy):
    command = [sys.executable, str(TOY), "run", "all", *SLOW]
    with subprocess.Popen(
        command,
        cwd=toy.root,
        stderr=subprocess.DEVNULL,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN),
    ) as process:
        while not list(toy.artifacts.glob("store/.tmp-*/half.txt")):
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signal.SIGHUP)
        (step,) = toy.artifacts.glob("scratch/*/step")
        seen = step.read_text()
        while step.read_text() in ("", seen):
            assert process.poll() is None
            time.sleep(0.02)
        process.terminate()
    assert process.returncode == 143


def test_a_terminal_that_closes_ends_the_command(toy):
    """With the bar on it: the terminal is gone when the command tidies up."""
    import pty

    ours, theirs = pty.openpty()
    command = [sys.executable, str(TOY), "run", "all", *SLOW]

    def take_terminal() -> None:
        os.setsid()
        import fcntl
        import termios

        fcntl.ioctl(theirs, termios.TIOCSCTTY, 0)

    process = subprocess.Popen(
        command, cwd=toy.root, stdin=theirs, stdout=theirs, stderr=theirs, preexec_fn=take_terminal
    )
    os.close(theirs)
    while not list(toy.artifacts.glob("store/.tmp-*/half.txt")):
        assert process.poll() is None
        time.sleep(0.02)
    os.close(ours)
    assert process.wait(60) == 129
    assert not list(toy.artifacts.glob("store/.tmp-*"))
